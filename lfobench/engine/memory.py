"""Memory that a job will need, from the shapes of its data and of one step, before it starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import torch

# Libraries, allocators and graphs take more than the tensors themselves.
MARGIN = 1.5
USABLE = 0.9


@dataclass(frozen=True)
class Footprint:
    """Bytes that a job keeps at once.

    Attributes:
        fixed: whatever the seeds: the data, the process.
        per_seed: for every seed: parameters, optimiser state, what a step holds.
    """

    fixed: int
    per_seed: int

    def total(self, seeds: int) -> int:
        """Bytes of that many seeds together, with a margin."""
        return round(MARGIN * (self.fixed + seeds * self.per_seed))


@dataclass(frozen=True)
class Memory:
    """Bytes that may be planned with; None where the system does not tell.

    Attributes:
        capacity: if nobody else used the device.
        free: as things are.
    """

    capacity: int | None
    free: int | None


def memory_of(device: torch.device) -> Memory:
    """The memory of a device, less a reserve."""
    if device.type == "cuda":
        free, total = torch.cuda.mem_get_info(device)
        return Memory(round(USABLE * total), round(USABLE * free))
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return Memory(None, None)
    sizes = {line.split(":")[0]: int(line.split()[1]) * 1024 for line in lines}
    return Memory(round(USABLE * sizes["MemTotal"]), round(USABLE * sizes["MemAvailable"]))


def fitting_groups(seeds: Sequence[int], footprint: Footprint, available: int | None) -> list[tuple[int, ...]]:
    """Seeds in as few groups as fit one at a time, of nearly equal size; a seed that does not fit goes alone."""
    most = len(seeds)
    while available is not None and most > 1 and footprint.total(most) > available:
        most -= 1
    groups = -(-len(seeds) // most)
    bounds = [len(seeds) * index // groups for index in range(groups + 1)]
    return [tuple(seeds[first:last]) for first, last in pairwise(bounds)]


def fitting_together(totals: Sequence[int], available: int | None, most: int) -> int:
    """Number of jobs that may run at once: any that many of them fit; at least one."""
    largest = sorted(totals, reverse=True)
    count = 1
    while count < min(most, len(largest)) and (available is None or sum(largest[: count + 1]) <= available):
        count += 1
    return count
