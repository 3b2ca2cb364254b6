"""The frozen discriminator whose logit is the reward of SMODICE's and ORIL's main stage (methods.md 3.2)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from benchmarks.authors.loop import perceptron
from lfobench.contract.method import Shapes


def discriminator(shapes: Shapes, hidden: Sequence[int], device: torch.device) -> nn.Module:
    """D(s), as initialised: what its training made of it costs a main step nothing."""
    network = perceptron((shapes.observation, *hidden, 1), activation=nn.Tanh)
    return network.to(device).requires_grad_(False)


def reward(network: nn.Module, observation: Tensor) -> Tensor:
    """``log sigma(D) - log(1 - sigma(D))``, ``[B]``; no gradient."""
    with torch.no_grad():
        probability = torch.sigmoid(network(observation).squeeze(-1))
        return torch.log(probability) - torch.log(1.0 - probability)
