"""Policies, each with its regression on actions: a deterministic tanh policy and two Gaussian ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import torch

from lfobench.contract.method import Metrics, Shapes
from lfobench.nn.networks import Adam, Network, SeedVector
from lfobench.randomness import StepRandomness

if TYPE_CHECKING:
    from torch import Tensor

_HALF_LOG_TWO_PI = 0.5 * math.log(2.0 * math.pi)


def normal_log_density(value: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Log-density of a diagonal Gaussian, summed over the last axis: ``[..., act] -> [...]``."""
    standardized = (value - mean) * torch.exp(-log_std)
    return (-0.5 * standardized.square() - log_std - _HALF_LOG_TWO_PI).sum(-1)


def squared_error(action: Tensor, prediction: Tensor) -> Tensor:
    """Squared error per row, summed over action dimensions: ``[S, B, act] -> [S, B]``."""
    return (action - prediction).square().sum(-1)


class DeterministicPolicy:
    """``pi(s) = tanh(MLP(s))``, trained by weighted regression: ``mean(w ||a - pi(s)||^2)``.

    Args:
        shapes: of observations and actions.
        hidden: widths of the hidden layers.
        seeds: the seed axis.
        device: where the parameters live.
        learning_rate: Adam's step size.
        cosine_steps: length of its cosine schedule; None keeps it constant.
    """

    def __init__(
        self,
        shapes: Shapes,
        hidden: Sequence[int],
        seeds: Sequence[int],
        device: torch.device,
        *,
        learning_rate: float,
        cosine_steps: int | None = None,
    ) -> None:
        def adam(parameters: Tensor) -> Adam:
            return Adam(parameters, learning_rate, cosine_steps=cosine_steps)

        self._network = Network("policy", (shapes.observation, *hidden, shapes.action), seeds, device)
        self._optimizer = adam(self._network.flat)
        self._add_parameters(SeedVector(shapes.action, len(seeds), device), adam)

    def act(self, observation: Tensor) -> Tensor:
        """Actions ``[S, N, act]``."""
        return torch.tanh(self._network(observation))

    def regress(self, observation: Tensor, action: Tensor, weight: Tensor | None = None) -> Metrics:
        """One step on the mean of ``weight * error(s, a)``; returns ``policy_loss``, ``[S]``."""
        error = self._error(observation, action)
        loss = (error if weight is None else weight * error).mean(-1)
        self._step(loss)
        return {"policy_loss": loss.detach()}

    def _add_parameters(self, per_action: SeedVector, adam: Callable[[Tensor], Adam]) -> None:
        """Parameters outside the network, where the error has some: a number per action."""

    def _error(self, observation: Tensor, action: Tensor) -> Tensor:
        """``||a - pi(s)||^2``, ``[S, B]``."""
        return squared_error(action, self.act(observation))

    def _step(self, loss: Tensor) -> None:
        self._optimizer.step(self._network.gradient(loss))


class GaussianPolicy(DeterministicPolicy):
    """``pi(.|s) = N(tanh(MLP(s)), diag sigma^2)``, trained on the weighted log-likelihood; acts by its mean.

    The log-std, one per action, is a parameter that no state changes (the policy class of the code base that DILO's
    authors started from).
    """

    LOG_STD_RANGE = (-5.0, 2.0)

    def _add_parameters(self, per_action: SeedVector, adam: Callable[[Tensor], Adam]) -> None:
        self._log_std = per_action
        self._log_std_optimizer = adam(per_action.flat)

    def _error(self, observation: Tensor, action: Tensor) -> Tensor:
        """``-log pi(a|s)``, ``[S, B]``."""
        log_std = self._log_std.values.clamp(*self.LOG_STD_RANGE)[:, None]
        return -normal_log_density(action, self.act(observation), log_std)

    def _step(self, loss: Tensor) -> None:
        (log_std_gradient,) = torch.autograd.grad(loss.sum(), self._log_std.values, retain_graph=True)
        super()._step(loss)
        self._log_std_optimizer.step(self._log_std.padded(log_std_gradient))


class TanhGaussianPolicy:
    """``a = tanh(u)``, ``u ~ N(mu(s), diag sigma(s)^2)``, trained on the weighted log-likelihood; acts by ``tanh(mu)``.

    The entropy is held near ``H = -dim(a)`` as in Soft Actor-Critic (Haarnoja et al. 2018), by a log-temperature l:

        L_pi = -mean(w log pi(a|s)) + exp(l) mean log pi(a~|s)          a~ a reparameterised sample of pi(.|s)
        L_l  = -l (mean log pi(a~|s) + H)

    Without the constraint only the first term remains.

    Args:
        shapes: of observations and actions.
        hidden: widths of the hidden layers.
        seeds: the seed axis.
        device: where the parameters live.
        learning_rate: Adam's step size for policy and temperature.
        entropy_constraint: whether the entropy is constrained.
    """

    MEAN_RANGE = (-7.24, 7.24)
    LOG_STD_RANGE = (-5.0, 2.0)
    ACTION_MARGIN = 1e-6

    def __init__(
        self,
        shapes: Shapes,
        hidden: Sequence[int],
        seeds: Sequence[int],
        device: torch.device,
        *,
        learning_rate: float,
        entropy_constraint: bool,
    ) -> None:
        sizes = (shapes.observation, *hidden, 2 * shapes.action)
        # Mean and log-std are two layers, drawn as such.
        self._network = Network("policy", sizes, seeds, device, initialization="xavier", merged_outputs=2)
        self._optimizer = Adam(self._network.flat, learning_rate)
        self._target_entropy = -float(shapes.action)
        self._entropy_constraint = entropy_constraint
        self._log_temperature = SeedVector(1, len(seeds), device)
        self._temperature_optimizer = Adam(self._log_temperature.flat, learning_rate)

    def _distribution(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_std = self._network(observation).chunk(2, dim=-1)
        return mean.clamp(*self.MEAN_RANGE), log_std.clamp(*self.LOG_STD_RANGE)

    def _log_density(self, pre_tanh: Tensor, action: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
        correction = torch.log(1.0 - action.square() + self.ACTION_MARGIN).sum(-1)
        return normal_log_density(pre_tanh, mean, log_std) - correction

    def log_likelihood(self, action: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
        """``log pi(a|s)`` of data actions ``[S, B, act] -> [S, B]``."""
        inside = action.clamp(-1.0 + self.ACTION_MARGIN, 1.0 - self.ACTION_MARGIN)
        pre_tanh = 0.5 * (torch.log1p(inside) - torch.log1p(-inside))
        return self._log_density(pre_tanh, inside, mean, log_std)

    def act(self, observation: Tensor) -> Tensor:
        """``tanh`` of the clamped mean, ``[S, N, act]``."""
        return torch.tanh(self._distribution(observation)[0])

    def regress(
        self, observation: Tensor, action: Tensor, randomness: StepRandomness, weight: Tensor | None = None
    ) -> Metrics:
        """One step of policy and temperature; returns ``policy_loss`` and ``entropy``, ``[S]`` each."""
        mean, log_std = self._distribution(observation)
        log_likelihood = self.log_likelihood(action, mean, log_std)
        loss = -(log_likelihood if weight is None else weight * log_likelihood).mean(-1)
        metrics = {"policy_loss": loss.detach()}
        if self._entropy_constraint:
            noise = randomness.normal("policy sample", *mean.shape[1:])
            pre_tanh = mean + torch.exp(log_std) * noise
            negative_entropy = self._log_density(pre_tanh, torch.tanh(pre_tanh), mean, log_std).mean(-1)
            loss = loss + self._log_temperature.values.detach()[:, 0].exp() * negative_entropy
            metrics["entropy"] = -negative_entropy.detach()
        gradient = self._network.gradient(loss)
        self._optimizer.step(gradient)
        if self._entropy_constraint:
            excess = (metrics["entropy"] - self._target_entropy)[:, None]
            self._temperature_optimizer.step(self._log_temperature.padded(excess))
        return metrics
