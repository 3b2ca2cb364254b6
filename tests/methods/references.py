"""The formulas of docs/methods.md for one seed, slow and in float64: NumPy, back-propagation written out by hand.

Nothing here is taken from the package `methods`; a network is a plain list ``[W0, b0, W1, b1, ...]`` with weights
``[in, out]``, and a gradient is a list of the same shapes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Parameters = list[Array]
Rows = Mapping[str, Array]


def unflatten(flat: Array, sizes: Sequence[int]) -> Parameters:
    """The layers of one row of a flat parameter tensor; the padding behind them is dropped."""
    parameters, offset = [], 0
    for fan_in, fan_out in pairwise(sizes):
        for shape in ((fan_in, fan_out), (fan_out,)):
            count = math.prod(shape)
            parameters.append(np.array(flat[offset : offset + count], dtype=np.float64).reshape(shape))
            offset += count
    return parameters


def flatten(parameters: Sequence[Array]) -> Array:
    """All layers as one vector."""
    return np.concatenate([parameter.ravel() for parameter in parameters])


def relu(x: Array) -> Array:
    return np.maximum(x, 0.0)


def evaluate(parameters: Parameters, inputs: Array, activation: Callable[[Array], Array] = relu) -> Array:
    """Output ``[B, out]`` of a multilayer perceptron with a linear last layer."""
    hidden = inputs
    for index in range(0, len(parameters), 2):
        hidden = hidden @ parameters[index] + parameters[index + 1]
        if index + 2 < len(parameters):
            hidden = activation(hidden)
    return hidden


def pull_back(parameters: Parameters, inputs: Array, cotangent: Array) -> Parameters:
    """Gradient of ``sum(cotangent * output)`` of a ReLU network with respect to its parameters."""
    hidden, activations = inputs, [inputs]
    for index in range(0, len(parameters), 2):
        hidden = hidden @ parameters[index] + parameters[index + 1]
        if index + 2 < len(parameters):
            hidden = relu(hidden)
        activations.append(hidden)
    gradient: Parameters = [np.zeros(0)] * len(parameters)
    for index in reversed(range(0, len(parameters), 2)):
        entering = activations[index // 2]
        gradient[index] = entering.T @ cotangent
        gradient[index + 1] = cotangent.sum(0)
        cotangent = (cotangent @ parameters[index].T) * (entering > 0)
    return gradient


def numerical_gradient(loss: Callable[[Parameters], float], parameters: Parameters, step: float = 1e-6) -> Parameters:
    """Central differences, one parameter at a time."""
    gradient = [np.zeros_like(parameter) for parameter in parameters]
    for parameter, slot in zip(parameters, gradient, strict=True):
        for index in np.ndindex(*parameter.shape):
            kept = parameter[index]
            parameter[index] = kept + step
            above = loss(parameters)
            parameter[index] = kept - step
            below = loss(parameters)
            parameter[index] = kept
            slot[index] = (above - below) / (2.0 * step)
    return gradient


@dataclass
class AdamReference:
    """Adam as in Kingma and Ba 2015, algorithm 1, one parameter array at a time."""

    first: list[Array] = field(default_factory=list)
    second: list[Array] = field(default_factory=list)
    steps: int = 0

    def step(self, parameters: Parameters, gradient: Parameters, rate: float) -> None:
        if not self.first:
            self.first = [np.zeros_like(parameter) for parameter in parameters]
            self.second = [np.zeros_like(parameter) for parameter in parameters]
        self.steps += 1
        for i in range(len(parameters)):
            self.first[i] = 0.9 * self.first[i] + 0.1 * gradient[i]
            self.second[i] = 0.999 * self.second[i] + 0.001 * gradient[i] ** 2
            mean = self.first[i] / (1.0 - 0.9**self.steps)
            square = self.second[i] / (1.0 - 0.999**self.steps)
            parameters[i] = parameters[i] - rate * mean / (np.sqrt(square) + 1e-8)


# --- DILO ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DiloConstants:
    """Every number of 3.1; `conservatism` None is the objective of the paper's main text."""

    discount: float
    conservatism: float | None
    mixture: float
    backward_weight: float
    tau: float
    weight_limit: float
    value_rate: float
    policy_rate: float
    cosine_steps: int | None
    target_rate: float
    gaussian: bool


@dataclass(frozen=True)
class DiloGradients:
    """Gradients of the three value losses, each ``[head][layer array]``, and the residuals they came from."""

    linear: list[Parameters]
    forward: list[Parameters]
    backward: list[Parameters]
    residuals: Array


def dilo_losses(
    heads: Sequence[Parameters], targets: Sequence[Parameters], offline: Rows, expert: Rows, c: DiloConstants
) -> tuple[float, float, float]:
    """L_0, L_f and L_b from their definitions."""
    beta, gamma = c.mixture, c.discount
    scale = 1.0 if c.conservatism is None else c.conservatism

    def phi(y: Array) -> Array:
        return np.where(y >= -2.0, y + y**2 / 4.0, -1.0)

    def terms(batch: Rows) -> tuple[Array, Array, Array]:
        here, there = _pairs(batch)
        online, online_there = (np.stack([evaluate(head, x)[:, 0] for head in heads]) for x in (here, there))
        frozen, frozen_there = (np.min([evaluate(head, x)[:, 0] for head in targets], 0) for x in (here, there))
        going_on = gamma * (1.0 - batch["terminated"])
        return going_on * frozen_there - online, going_on * online_there - frozen, online

    forward_o, backward_o, value_o = terms(offline)
    forward_e, backward_e, _ = terms(expert)
    linear_weight = beta * (1.0 - gamma) if c.conservatism is None else 1.0 - c.conservatism
    linear = linear_weight * value_o.mean()
    forward = scale * (beta * phi(forward_e) + (1.0 - beta) * (phi(forward_o) - forward_o)).mean()
    backward = beta * phi(backward_e) + (1.0 - beta) * (phi(backward_o) - backward_o)
    return float(linear), float(forward), float(scale * c.backward_weight * backward.mean())


def dilo_gradients(
    heads: Sequence[Parameters], targets: Sequence[Parameters], offline: Rows, expert: Rows, c: DiloConstants
) -> DiloGradients:
    """The gradients from the per-row output cotangents that 3.1 lists for a fused kernel."""
    beta, gamma, eta = c.mixture, c.discount, c.backward_weight
    scale = 1.0 if c.conservatism is None else c.conservatism
    linear_weight = beta * (1.0 - gamma) if c.conservatism is None else 1.0 - c.conservatism
    rows = len(offline["observation"])
    inputs = {"O": _pairs(offline), "E": _pairs(expert)}
    going_on = {"O": gamma * (1.0 - offline["terminated"]), "E": gamma * (1.0 - expert["terminated"])}
    frozen = {
        part: tuple(np.minimum(evaluate(targets[0], x)[:, 0], evaluate(targets[1], x)[:, 0]) for x in pair)
        for part, pair in inputs.items()
    }
    linear, forward, backward, residuals = [], [], [], []
    for head in heads:
        e_f = {p: going_on[p] * frozen[p][1] - evaluate(head, inputs[p][0])[:, 0] for p in "OE"}
        e_b = {p: going_on[p] * evaluate(head, inputs[p][1])[:, 0] - frozen[p][0] for p in "OE"}
        residuals += [e_f["O"], e_f["E"], e_b["O"], e_b["E"]]
        two_b = 2.0 * rows
        c_f_o = -scale * (1.0 - beta) / two_b * np.maximum(e_f["O"] / 2.0, -1.0)
        c_f_e = -scale * beta / two_b * np.maximum(e_f["E"] / 2.0 + 1.0, 0.0)
        c_b_o = scale * eta * (1.0 - beta) * going_on["O"] / two_b * np.maximum(e_b["O"] / 2.0, -1.0)
        c_b_e = scale * eta * beta * going_on["E"] / two_b * np.maximum(e_b["E"] / 2.0 + 1.0, 0.0)
        c_0 = np.full(rows, linear_weight / two_b)
        linear.append(pull_back(head, inputs["O"][0], c_0[:, None]))
        forward.append(
            _sum(pull_back(head, inputs["O"][0], c_f_o[:, None]), pull_back(head, inputs["E"][0], c_f_e[:, None]))
        )
        backward.append(
            _sum(pull_back(head, inputs["O"][1], c_b_o[:, None]), pull_back(head, inputs["E"][1], c_b_e[:, None]))
        )
    return DiloGradients(linear, forward, backward, np.stack(residuals))


def dilo_combination(gradients: DiloGradients) -> list[Parameters]:
    """``grad(L_0) + g_f + (g_b - kappa g_f)`` with one kappa for both heads."""
    overlap = square = 0.0
    for g_f, g_b in zip(gradients.forward, gradients.backward, strict=True):
        for f, b in zip(g_f, g_b, strict=True):
            overlap += float((f * b).sum())
            square += float((f * f).sum())
    kappa = overlap / max(square, 1e-10)
    return [
        [zero + f + (b - kappa * f) for zero, f, b in zip(g_0, g_f, g_b, strict=True)]
        for g_0, g_f, g_b in zip(gradients.linear, gradients.forward, gradients.backward, strict=True)
    ]


def dilo_weights(heads: Sequence[Parameters], offline: Rows, c: DiloConstants) -> Array:
    """``min(exp(tau min_k V_k(s, s')), limit)``."""
    here, _ = _pairs(offline)
    value = np.minimum(evaluate(heads[0], here)[:, 0], evaluate(heads[1], here)[:, 0])
    return np.exp(np.minimum(c.tau * value, math.log(c.weight_limit)))


def regression_gradient(policy: Parameters, rows: Rows, weight: Array) -> Parameters:
    """Gradient of ``mean_i w_i sum_j (a_ij - tanh(f(s_i))_j)^2``."""
    mean = np.tanh(evaluate(policy, rows["observation"]))
    cotangent = -2.0 * weight[:, None] * (rows["action"] - mean) * (1.0 - mean**2) / len(mean)
    return pull_back(policy, rows["observation"], cotangent)


def likelihood_gradient(policy: Parameters, log_std: Array, rows: Rows, weight: Array) -> tuple[Parameters, Array]:
    """Gradient of ``-mean_i w_i log N(a_i; tanh(f(s_i)), sigma)`` in the network and in log sigma."""
    mean = np.tanh(evaluate(policy, rows["observation"]))
    z = (rows["action"] - mean) / np.exp(log_std)
    cotangent = -weight[:, None] * z / np.exp(log_std) * (1.0 - mean**2) / len(mean)
    return pull_back(policy, rows["observation"], cotangent), -(weight[:, None] * (z**2 - 1.0)).mean(0)


class DiloReference:
    """One seed of DILO: `update` follows the order of 3.1."""

    def __init__(
        self, heads: Sequence[Parameters], policy: Parameters, log_std: Array, constants: DiloConstants
    ) -> None:
        self.constants = constants
        self.heads = [[layer.copy() for layer in head] for head in heads]
        self.targets = [[layer.copy() for layer in head] for head in heads]
        self.policy, self.log_std = [layer.copy() for layer in policy], [log_std.copy()]
        self.seen_residuals: list[Array] = []
        self.seen_weights: list[Array] = []
        self._adams = [AdamReference(), AdamReference()]
        self._policy_adam, self._log_std_adam = AdamReference(), AdamReference()
        self._updates = 0

    def update(self, offline: Rows, expert: Rows) -> None:
        c = self.constants
        gradients = dilo_gradients(self.heads, self.targets, offline, expert, c)
        for head, adam, gradient in zip(self.heads, self._adams, dilo_combination(gradients), strict=True):
            adam.step(head, gradient, c.value_rate)
        weight = dilo_weights(self.heads, offline, c)
        rate = c.policy_rate
        if c.cosine_steps is not None:
            rate *= (1.0 + math.cos(math.pi * self._updates / c.cosine_steps)) / 2.0
        if c.gaussian:
            gradient, log_std_gradient = likelihood_gradient(self.policy, self.log_std[0], offline, weight)
            self._log_std_adam.step(self.log_std, [log_std_gradient], rate)
        else:
            gradient = regression_gradient(self.policy, offline, weight)
        self._policy_adam.step(self.policy, gradient, rate)
        for target, head in zip(self.targets, self.heads, strict=True):
            for i in range(len(target)):
                target[i] = (1.0 - c.target_rate) * target[i] + c.target_rate * head[i]
        self._updates += 1
        self.seen_residuals.append(gradients.residuals)
        self.seen_weights.append(weight)


# --- SMODICE ------------------------------------------------------------------------------------


def discriminator_loss(parameters: Parameters, expert: Array, offline: Array, mixing: Array, penalty: float) -> float:
    """``BCE(D(expert), 1) + BCE(D(offline), 0) + penalty * mean (||grad_x D(x_mix)|| - 1)^2``."""

    def logit(x: Array) -> Array:
        return evaluate(parameters, x, np.tanh)[:, 0]

    mixed = mixing * expert + (1.0 - mixing) * offline
    slope, hidden = None, mixed
    for index in range(0, len(parameters), 2):
        hidden = hidden @ parameters[index] + parameters[index + 1]
        jacobian = np.broadcast_to(parameters[index], (len(mixed), *parameters[index].shape))
        if index + 2 < len(parameters):
            hidden = np.tanh(hidden)
            jacobian = jacobian * (1.0 - hidden**2)[:, None, :]
        slope = jacobian if slope is None else slope @ jacobian
    assert slope is not None
    norm = np.sqrt((slope[:, :, 0] ** 2).sum(1))
    classification = np.log1p(np.exp(-logit(expert))).mean() + np.log1p(np.exp(logit(offline))).mean()
    return float(classification + penalty * ((norm - 1.0) ** 2).mean())


def smodice_residual(value: Parameters, reward: Array, rows: Rows, discount: float) -> Array:
    """``e = R(s) + (1-d) gamma V(s') - V(s)``."""
    following = evaluate(value, rows["next_observation"])[:, 0]
    return reward + (1.0 - rows["terminated"]) * discount * following - evaluate(value, rows["observation"])[:, 0]


def smodice_value_gradient(
    value: Parameters, reward: Array, rows: Rows, discount: float, divergence: str
) -> Parameters:
    """Gradient of L_V through V(s_0), V(s) and V(s'); the derivative of the chi^2 term is e + 1, not truncated."""
    e = smodice_residual(value, reward, rows, discount)
    count = len(e)
    slope = np.exp(e) / np.exp(e).sum() if divergence == "kl" else (e + 1.0) / count
    start = np.full((len(rows["initial_observation"]), 1), (1.0 - discount) / len(rows["initial_observation"]))
    going_on = discount * (1.0 - rows["terminated"])
    return _sum(
        pull_back(value, rows["initial_observation"], start),
        pull_back(value, rows["observation"], -slope[:, None]),
        pull_back(value, rows["next_observation"], (going_on * slope)[:, None]),
    )


def squashed_log_density(pre_tanh: Array, action: Array, mean: Array, log_std: Array) -> Array:
    """Gaussian log-density of ``pre_tanh`` minus ``sum log(1 - a^2 + 1e-6)``."""
    normal = -((pre_tanh - mean) ** 2) / (2.0 * np.exp(2.0 * log_std)) - log_std - 0.5 * np.log(2.0 * np.pi)
    return (normal - np.log(1.0 - action**2 + 1e-6)).sum(-1)


def tanh_gaussian(policy: Parameters, observation: Array) -> tuple[Array, Array]:
    """Clamped mean and log-std."""
    mean, log_std = np.split(evaluate(policy, observation), 2, axis=-1)
    return np.clip(mean, -7.24, 7.24), np.clip(log_std, -5.0, 2.0)


def tanh_gaussian_loss(policy: Parameters, rows: Rows, weight: Array, temperature: float, noise: Array | None) -> float:
    """``-mean(w log pi(a|s)) + exp(l) mean log pi(a~|s)``; without the second term if `noise` is None."""
    mean, log_std = tanh_gaussian(policy, rows["observation"])
    inside = np.clip(rows["action"], -(1.0 - 1e-6), 1.0 - 1e-6)
    loss = -(weight * squashed_log_density(np.arctanh(inside), inside, mean, log_std)).mean()
    if noise is not None:
        loss += math.exp(temperature) * negative_entropy(policy, rows["observation"], noise)
    return float(loss)


def negative_entropy(policy: Parameters, observation: Array, noise: Array) -> float:
    """``mean log pi(a~|s)`` of the reparameterised samples that `noise` makes."""
    mean, log_std = tanh_gaussian(policy, observation)
    sample = mean + np.exp(log_std) * noise
    return float(squashed_log_density(sample, np.tanh(sample), mean, log_std).mean())


# --- ORIL ---------------------------------------------------------------------------------------


def oril_target(actor: Parameters, critics: Sequence[Parameters], reward: Array, rows: Rows, noise: Array) -> Array:
    """``y = R(s) + (1-d) gamma min_k Q'_k(s', a')`` from the target networks."""
    smoothing = np.clip(0.2 * noise, -0.5, 0.5)
    action = np.clip(np.tanh(evaluate(actor, rows["next_observation"])) + smoothing, -1.0, 1.0)
    inputs = np.concatenate([rows["next_observation"], action], 1)
    following = np.minimum(evaluate(critics[0], inputs)[:, 0], evaluate(critics[1], inputs)[:, 0])
    return reward + (1.0 - rows["terminated"]) * 0.99 * following


def oril_critic_gradients(critics: Sequence[Parameters], rows: Rows, target: Array) -> list[Parameters]:
    """Gradient of ``sum_k mean (Q_k(s,a) - y)^2`` per critic."""
    inputs = np.concatenate([rows["observation"], rows["action"]], 1)
    return [pull_back(q, inputs, 2.0 * (evaluate(q, inputs) - target[:, None]) / len(target)) for q in critics]


def oril_actor_loss(actor: Parameters, critic: Parameters, rows: Rows, scale: float) -> float:
    """``-lam mean Q_1(s, pi(s)) + mean (pi(s) - a)^2``, the second mean over all elements."""
    action = np.tanh(evaluate(actor, rows["observation"]))
    value = evaluate(critic, np.concatenate([rows["observation"], action], 1))
    return float(-scale * value.mean() + ((action - rows["action"]) ** 2).mean())


def oril_scale(actor: Parameters, critic: Parameters, rows: Rows) -> float:
    """``2.5 / mean |Q_1(s, pi(s))|``."""
    action = np.tanh(evaluate(actor, rows["observation"]))
    value = evaluate(critic, np.concatenate([rows["observation"], action], 1))
    return float(2.5 / np.abs(value).mean())


# --- implicit Q-learning ------------------------------------------------------------------------


def expectile_gradient(value: Parameters, rows: Rows, q: Array, expectile: float) -> Parameters:
    """Gradient of ``mean |tau_e - 1[u <= 0]| u^2``, ``u = q - V(s)``."""
    u = q - evaluate(value, rows["observation"])[:, 0]
    slope = -2.0 * np.where(u > 0.0, expectile, 1.0 - expectile) * u / len(u)
    return pull_back(value, rows["observation"], slope[:, None])


def iql_weights(value: Parameters, rows: Rows, q: Array, inverse_temperature: float, limit: float) -> Array:
    """``min(exp(B (q - V(s))), limit)``."""
    return np.minimum(np.exp(inverse_temperature * (q - evaluate(value, rows["observation"])[:, 0])), limit)


def iql_critic_gradients(
    critics: Sequence[Parameters], value: Parameters, rows: Rows, reward: Array, discount: float
) -> list[Parameters]:
    """Gradient of ``sum_k mean (Q_k(s,a) - r - gamma (1-d) V(s'))^2`` per critic."""
    following = evaluate(value, rows["next_observation"])[:, 0]
    return oril_critic_gradients(critics, rows, reward + discount * (1.0 - rows["terminated"]) * following)


def _pairs(batch: Rows) -> tuple[Array, Array]:
    """``(s, s')`` and ``(s', s'')``, the inputs of V."""
    s, following, second = (batch[name] for name in ("observation", "next_observation", "second_next_observation"))
    return np.concatenate([s, following], 1), np.concatenate([following, second], 1)


def _sum(*gradients: Parameters) -> Parameters:
    return [np.sum(layers, axis=0) for layers in zip(*gradients, strict=True)]


def constants_of(config: Any) -> DiloConstants:
    """The numbers of a configuration, by their names there."""
    return DiloConstants(
        discount=config.discount,
        conservatism=config.conservatism,
        mixture=config.mixture,
        backward_weight=config.backward_weight,
        tau=config.tau,
        weight_limit=config.weight_limit,
        value_rate=config.value_learning_rate,
        policy_rate=config.policy_learning_rate,
        cosine_steps=config.policy_cosine_steps,
        target_rate=config.target_rate,
        gaussian=config.policy == "gaussian",
    )
