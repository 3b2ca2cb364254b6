"""Batches as a function of (seed, stage, step): the same on every device, alone or beside other seeds."""

from __future__ import annotations

import torch
from torch import Tensor

from lfobench.contract.method import Batch, Stage
from lfobench.contract.randomness import Randomness
from lfobench.data.firewall import Table, View

CHUNK = 64


class StageSampler:
    """Draws the batches of one stage, indices for `CHUNK` steps at a time.

    In a method's last stage offline rows are drawn from those that training samples; an earlier stage sees all
    rows, because the released discriminator's negatives do (methods.md 2.6).
    """

    def __init__(self, view: View, stage: Stage, randomness: Randomness) -> None:
        self._view = view
        self._stage = stage
        self._randomness = randomness
        self._offline_rows = view.offline.sampled if stage.steps is None else view.offline.rows
        self._chunk = self._epoch = -1
        self._offline = self._initial = self._expert = self._order = torch.empty(0)

    def batches(self, step: int) -> tuple[Batch, Batch]:
        """Offline and expert batch ``[S, B, ...]`` of one step of the stage."""
        chunk, within = divmod(step, CHUNK)
        if chunk != self._chunk:
            self._chunk = chunk
            self._draw(torch.arange(chunk * CHUNK, (chunk + 1) * CHUNK, device=self._randomness.device))
        stage, view = self._stage, self._view
        offline: Batch = {}
        if stage.offline_batch:
            offline = view.offline.batch(self._offline[within])
            if view.initial.fields:
                offline = {**offline, **view.initial.batch(self._initial[within])}
        expert: Batch = {}
        if stage.expert_batch:
            row = self._epoch_rows(step) if stage.expert_epochs else self._expert[within]
            expert = view.expert.batch(row)
        return offline, expert

    def _draw(self, steps: Tensor) -> None:
        stage, view = self._stage, self._view
        if stage.offline_batch:
            self._offline = self._integers("offline", steps, stage.offline_batch, self._offline_rows)
            if view.initial.fields:
                self._initial = self._integers("initial", steps, stage.offline_batch, view.initial.sampled)
        if stage.expert_batch and not stage.expert_epochs:
            self._expert = self._integers("expert", steps, stage.expert_batch, view.expert.sampled)

    def _integers(self, part: str, steps: Tensor, count: int, bound: int) -> Tensor:
        return self._randomness.integers(f"{self._stage.name}: {part} rows", steps, count, bound)

    def _epoch_rows(self, step: int) -> Tensor:
        """Rows of a shuffled pass over the expert table; the last batch of a pass is short."""
        rows, batch = self._view.expert.sampled, self._stage.expert_batch
        epoch, within = divmod(step, -(-rows // batch))
        if epoch != self._epoch:
            self._epoch = epoch
            self._order = self._randomness.permutation(f"{self._stage.name}: expert pass", epoch, rows)
        return self._order[:, within * batch : (within + 1) * batch]


def check_tables(stage: Stage, offline: Table, expert: Table) -> str | None:
    """Why a stage cannot draw its batches, or None."""
    if stage.offline_batch and not offline.sampled:
        return f"stage '{stage.name}' needs offline rows and the data holds none"
    if stage.expert_batch and not expert.sampled:
        return f"stage '{stage.name}' needs expert rows and the data holds none"
    return None
