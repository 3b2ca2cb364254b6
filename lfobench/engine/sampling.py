"""Batches as a function of (seed, stage, step): the same on every device, alone or beside other seeds."""

from __future__ import annotations

import torch
from torch import Tensor

from lfobench.contract.method import Batch, Stage
from lfobench.contract.randomness import Randomness
from lfobench.data.firewall import Table, View
from lfobench.engine.draws import Draws

CHUNK = 64


class StageSampler:
    """Chooses the rows of one stage's batches.

    In a method's last stage offline rows are drawn from those that training samples; an earlier stage sees all
    rows, because the released discriminator's negatives do (methods.md 2.6).

    Attributes:
        draws: the stage's draws; a chunk of them holds whole passes over the expert rows.
    """

    def __init__(self, view: View, stage: Stage, randomness: Randomness) -> None:
        self._view = view
        self._stage = stage
        self._offline_rows = view.offline.sampled if stage.steps is None else view.offline.rows
        self._per_pass = -(-view.expert.sampled // stage.expert_batch) if stage.expert_epochs else 1
        self.draws = Draws(randomness, -(-CHUNK // self._per_pass) * self._per_pass)

    def expert_rows(self, step: int) -> int:
        """Expert rows of a step's batch: fewer in the last batch of a pass."""
        batch = self._stage.expert_batch
        if not self._stage.expert_epochs:
            return batch
        return min(batch, self._view.expert.sampled - step % self._per_pass * batch)

    def batches(self, expert_rows: int) -> tuple[Batch, Batch]:
        """Offline and expert batch ``[S, B, ...]`` of the running step, which has `expert_rows` of the latter."""
        stage, view = self._stage, self._view
        offline: Batch = {}
        if stage.offline_batch:
            offline = view.offline.batch(self._drawn("offline", stage.offline_batch, self._offline_rows))
            if view.initial.fields:
                initial = self._drawn("initial", stage.offline_batch, view.initial.sampled)
                offline = {**offline, **view.initial.batch(initial)}
        expert: Batch = {}
        if stage.expert_epochs:
            expert = view.expert.batch(self._of_pass(expert_rows))
        elif stage.expert_batch:
            expert = view.expert.batch(self._drawn("expert", stage.expert_batch, view.expert.sampled))
        return offline, expert

    def _drawn(self, part: str, count: int, bound: int) -> Tensor:
        name = f"{self._stage.name}: {part} rows"
        integers = self.draws.randomness.integers
        return self.draws.now(name, count, lambda steps: integers(name, steps, count, bound))

    def _of_pass(self, count: int) -> Tensor:
        """The next `count` rows of a shuffled pass over the expert table."""
        rows, within = self._view.expert.sampled, self.draws.within
        name = f"{self._stage.name}: expert pass"
        permutation = self.draws.randomness.permutation
        orders = self.draws.buffer(
            name, rows, lambda steps: permutation(name, steps[:: self._per_pass] // self._per_pass, rows)
        )
        order = orders.index_select(0, within // self._per_pass)[0]
        begin = within % self._per_pass * self._stage.expert_batch
        return order.index_select(1, begin + torch.arange(count, device=begin.device))


def check_tables(stage: Stage, offline: Table, expert: Table) -> str | None:
    """Why a stage cannot draw its batches, or None."""
    if stage.offline_batch and not offline.sampled:
        return f"stage '{stage.name}' needs offline rows and the data holds none"
    if stage.expert_batch and not expert.sampled:
        return f"stage '{stage.name}' needs expert rows and the data holds none"
    return None
