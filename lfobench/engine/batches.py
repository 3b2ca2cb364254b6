"""Batches as a function of (seed, stage, step): the same on every device, alone or beside other seeds."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import torch

from lfobench.contract.method import Batch, Stage
from lfobench.data.firewall import Table, View
from lfobench.randomness import Randomness

if TYPE_CHECKING:
    from torch import Tensor

Draw: TypeAlias = "Callable[[Tensor], Tensor]"


class Draws:
    """Buffers of drawn numbers for the steps ``[first, first + chunk)``.

    Attributes:
        chunk: steps drawn at once.
        within: int64 ``[1]``, the running step's place among them.
    """

    def __init__(self, randomness: Randomness, chunk: int) -> None:
        self.randomness = randomness
        self.chunk = chunk
        self.within = torch.zeros(1, dtype=torch.int64, device=randomness.device)
        self._steps = torch.arange(chunk, device=randomness.device)
        self._offsets = torch.arange(chunk, device=randomness.device)
        self._buffers: dict[tuple[str, int], tuple[Draw, Tensor]] = {}
        self._chunk = self._next = -1

    @property
    def kinds(self) -> int:
        """Number of different draws that the steps have asked for so far."""
        return len(self._buffers)

    def move_to(self, step: int, refill: Callable[[], None]) -> None:
        """Make `step` the running one.

        Args:
            step: updates of the stage before it.
            refill: does what `self.refill` does; called where a chunk begins.
        """
        chunk, within = divmod(step, self.chunk)
        if chunk != self._chunk:
            self._chunk = chunk
            torch.add(self._offsets, chunk * self.chunk, out=self._steps)
            refill()
        if step != self._next or within == 0:
            self.within.fill_(within)
        self._next = step + 1

    def advance(self) -> None:
        """The end of a step, as a tensor operation: the next one is running."""
        self.within.add_(1)

    def refill(self) -> None:
        """Draw every buffer for the chunk's steps."""
        for draw, buffer in self._buffers.values():
            buffer.copy_(draw(self._steps))

    def buffer(self, name: str, size: int, draw: Draw) -> Tensor:
        """Draws for every step of the chunk, ``[chunk, ...]``; drawn when first asked for."""
        if (name, size) not in self._buffers:
            self._buffers[name, size] = (draw, draw(self._steps))
        return self._buffers[name, size][1]

    def now(self, name: str, size: int, draw: Draw) -> Tensor:
        """The running step's entry of such a buffer."""
        return self.buffer(name, size, draw).index_select(0, self.within)[0]


class RunningStep:
    """The draws of the running step as a method sees them.

    Its purposes are apart from the engine's: the words that chose a batch's rows would tell where they lie.

    Attributes:
        phase: see `lfobench.randomness.StepRandomness`.
    """

    def __init__(self, draws: Draws, phase: int) -> None:
        self._draws = draws
        self.phase = phase

    def normal(self, purpose: str, *shape: int) -> Tensor:
        """float32 standard normal ``[S, *shape]``."""
        size, randomness = math.prod(shape), self._draws.randomness
        name = f"update: {purpose}"
        drawn = self._draws.now(f"normal {name}", size, lambda steps: randomness.normal(name, steps, size))
        return drawn.view(-1, *shape)

    def uniform(self, purpose: str, *shape: int) -> Tensor:
        """float32 in (0, 1), ``[S, *shape]``."""
        size, randomness = math.prod(shape), self._draws.randomness
        name = f"update: {purpose}"
        drawn = self._draws.now(f"uniform {name}", size, lambda steps: randomness.uniform(name, steps, size))
        return drawn.view(-1, *shape)


CHUNK = 64


class StageSampler:
    """Chooses the rows of one stage's batches.

    In a method's last stage offline rows are drawn from those that training samples; an earlier stage sees all
    rows, because the released discriminator's negatives do.

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
    """Reason why a stage cannot draw its batches, or None."""
    if stage.offline_batch and not offline.sampled:
        return f"stage '{stage.name}' needs offline rows and the data holds none"
    if stage.expert_batch and not expert.sampled:
        return f"stage '{stage.name}' needs expert rows and the data holds none"
    return None
