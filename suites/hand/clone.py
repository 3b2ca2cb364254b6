"""Behaviour cloning of recorded actions, as D4RL cloned its human demonstrations (arXiv:2004.07219, section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from lfobench.contract.suite import FloatArray
from suites.demonstrators.student import Student


@dataclass(frozen=True)
class CloneSettings:
    """How a clone is made; every field is on its card.

    Attributes:
        seed: decides the weights together with the library versions.
        steps: gradient steps.
        batch: rows per step.
        rate: first learning rate.
        hidden: widths of the hidden layers.
        recorded_std: of a recorded action about what was meant; the clone's own is never much less.
    """

    seed: int = 0
    steps: int = 3_000
    batch: int = 256
    rate: float = 1e-3
    hidden: tuple[int, ...] = (128, 128)
    recorded_std: float = 0.05


def clone(observations: FloatArray, actions: FloatArray, settings: CloneSettings) -> bytes:
    """The ``.safetensors`` bytes of a policy fitted to rows ``[N, obs]``, ``[N, act]``; same settings, same bytes.

    A student whose teacher is a Gaussian about every recorded action: the maximum of the actions' likelihood, but for
    the floor under its std.
    """
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    student = Student(observations, actions.shape[1], settings.hidden, squash=False)
    means = torch.from_numpy(actions)
    log_stds = torch.full_like(means, math.log(settings.recorded_std))
    student.fit([torch.from_numpy(observations), means, log_stds], settings.steps, settings.batch, settings.rate)
    return student.content()
