"""BCO, whose authors' code is not public: the choices of methods/bco.py, written like the other loops.

The demonstration is labelled once, between the two stages, as the formulas read: nothing in a cloning step needs the
inverse dynamics model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.authors.loop import HIDDEN, Batch, HostBuffer, HostData, Loop, adam, perceptron
from lfobench.contract.method import Shapes

INVERSE_DYNAMICS_RATE, POLICY_RATE = 3e-4, 1e-4


def inverse_dynamics(shapes: Shapes, hidden: Sequence[int], device: torch.device) -> nn.Sequential:
    """``h(s, s')``, input ``[B, 2 obs]``."""
    return perceptron((2 * shapes.observation, *hidden, shapes.action), output=nn.Tanh()).to(device)


class AuthorsBcoInverseDynamics(Loop):
    """The first stage: regression of offline actions on pairs of observations.

    Args:
        data: on the host.
        shapes: of observation and action.
        batch_size: offline rows.
        device: where the model lives.
        hidden: widths.
    """

    def __init__(
        self, data: HostData, shapes: Shapes, batch_size: int, device: torch.device, hidden: Sequence[int] = HIDDEN
    ) -> None:
        fields = ("observation", "action", "next_observation")
        self._offline = HostBuffer(data.offline, fields, device, np.random.default_rng(0))
        self._batch_size = batch_size
        self.model = inverse_dynamics(shapes, hidden, device)
        self._optimizer = adam(self.model.parameters(), INVERSE_DYNAMICS_RATE)

    def sample(self) -> tuple[Batch, Batch]:
        """Offline pairs with their actions."""
        return self._offline.sample(self._batch_size), {}

    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """One step of the model."""
        pair = torch.cat((offline["observation"], offline["next_observation"]), dim=-1)
        _regress(self._optimizer, self.model(pair), offline["action"])
        return {}

    def modules(self) -> dict[str, nn.Module]:
        """The model."""
        return {"inverse_dynamics": self.model}


class AuthorsBcoPolicy(Loop):
    """The second stage: cloning of the labelled demonstration.

    Args:
        data: on the host; its expert part is labelled here.
        shapes: of observation and action.
        batch_size: expert rows.
        device: where the policy lives.
        hidden: widths.
        model: labels the demonstration; None labels it with an untrained one.
    """

    def __init__(
        self,
        data: HostData,
        shapes: Shapes,
        batch_size: int,
        device: torch.device,
        hidden: Sequence[int] = HIDDEN,
        model: nn.Module | None = None,
    ) -> None:
        model = inverse_dynamics(shapes, hidden, device) if model is None else model
        pair = np.concatenate((data.expert["observation"], data.expert["next_observation"]), axis=-1)
        with torch.no_grad():
            label = model(torch.from_numpy(pair).to(device)).cpu().numpy()
        labelled = {"observation": data.expert["observation"], "action": label}
        self._expert = HostBuffer(labelled, tuple(labelled), device, np.random.default_rng(0))
        self._batch_size = batch_size
        self.policy = perceptron((shapes.observation, *hidden, shapes.action), output=nn.Tanh()).to(device)
        self._optimizer = adam(self.policy.parameters(), POLICY_RATE)

    def sample(self) -> tuple[Batch, Batch]:
        """Labelled expert rows."""
        return {}, self._expert.sample(self._batch_size)

    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """One step of the policy."""
        _regress(self._optimizer, self.policy(expert["observation"]), expert["action"])
        return {}

    def modules(self) -> dict[str, nn.Module]:
        """The policy."""
        return {"policy": self.policy}


def _regress(optimizer: torch.optim.Optimizer, prediction: Tensor, action: Tensor) -> None:
    loss = (action - prediction).square().sum(-1).mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
