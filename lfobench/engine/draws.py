"""Everything random in a stage, drawn for many steps at once and read one step at a time.

The counter-based generator is a hundred small operations whatever it draws, so it draws `chunk` steps together. What it
drew lies in buffers of its own that are refilled in place, and the running step is a tensor: both are what a recorded
step, replayed, needs to read new numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from lfobench.contract.randomness import Randomness

Draw = Callable[[Tensor], Tensor]


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
        """How many different draws the steps have asked for so far."""
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

    def pass_on(self) -> None:
        """The end of a step, as a tensor operation: the next one is running."""
        self.within.add_(1)

    def refill(self) -> None:
        """Draw every buffer for the chunk's steps."""
        for draw, buffer in self._buffers.values():
            buffer.copy_(draw(self._steps))

    def buffer(self, name: str, size: int, draw: Draw) -> Tensor:
        """What `draw` gives for every step of the chunk, ``[chunk, ...]``; drawn when first asked for."""
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
        phase: see `lfobench.contract.randomness.StepRandomness`.
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
