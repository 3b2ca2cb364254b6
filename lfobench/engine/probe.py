"""A short measured probe: how long this machine will take and how much memory, before it starts."""

from __future__ import annotations

import itertools
import statistics
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten

from lfobench.cells.cell import Cell
from lfobench.contract.method import DataNeeds, Field, Method, Shapes, Sizes, Stage
from lfobench.contract.suite import Demonstrator, Environment, FloatArray, Operator
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.program import Program, recorder_for
from lfobench.engine.state import live_tensors
from lfobench.randomness import Randomness

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
        """Of that many seeds together, with a margin."""
        return round(MARGIN * (self.fixed + seeds * self.per_seed))


class _Peak(TorchDispatchMode):
    """Follows the tensors that operations make: bytes alive now, and at most."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.now = self.most = 0
        self._known: set[int] = set()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        for given in tree_flatten((args, kwargs))[0]:
            if isinstance(given, Tensor):
                self._follow(given.untyped_storage(), 0)
        out = func(*args, **(kwargs or {}))
        for made in tree_flatten(out)[0]:
            if isinstance(made, Tensor):
                self._follow(made.untyped_storage(), made.untyped_storage().nbytes())
        return out

    def _follow(self, storage: torch.UntypedStorage, size: int) -> None:
        key = storage._cdata
        if key in self._known:
            return
        self._known.add(key)
        self.now += size
        self.most = max(self.most, self.now)
        # Also of what was given: a later tensor may get its place.
        weakref.finalize(storage, self._drop, key, size)

    def _drop(self, key: int, size: int) -> None:
        self._known.discard(key)
        self.now -= size


def peak_bytes(work: Callable[[], object]) -> int:
    """The most that the tensors made by `work` take at once; what it was given does not count."""
    peak = _Peak()
    with peak:
        work()
    return peak.most


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
    """How many jobs may run at once: any that many of them fit; at least one."""
    largest = sorted(totals, reverse=True)
    count = 1
    while count < min(most, len(largest)) and (available is None or sum(largest[: count + 1]) <= available):
        count += 1
    return count


CPU = torch.device("cpu")
PROBE_ROWS = 4096
WORLDS = 16
PROBE_SECONDS = 0.25
WARM_UP = 2
RECORDING, RECORDED = "recording", 4
CALLS_PER_BLOCK = 4


@dataclass(frozen=True)
class Estimate:
    """Seconds of a cell's seeds trained together, were they alone on a core or device."""

    training: float
    evaluation: float

    @property
    def total(self) -> float:
        """Training and evaluation, one after the other."""
        return self.training + self.evaluation


class Prober:
    """Estimates cells, measuring every distinct (method, configuration, shapes) once."""

    def __init__(self, device: str) -> None:
        self._device = torch.device(device)
        self._steps: dict[tuple[str, str, Shapes, int, int], dict[str, float]] = {}
        self._simulators: dict[str, tuple[float, int, int]] = {}
        self._generation: dict[tuple[str, str], float] = {}
        self._seed_bytes: dict[tuple[str, str, str], int] = {}

    def estimate(self, cell: Cell, seeds: int, threads: int = 1) -> Estimate:
        """Training from measured updates of every stage; evaluation as if every episode ran to its horizon.

        Args:
            cell: what would be trained.
            seeds: how many train together.
            threads: of one process on a CPU.
        """
        environment, protocol = cell.task.environment, cell.protocol
        simulator_step, observation, action = self._simulator(cell)
        shapes = Shapes(observation, action)
        key = (cell.method.name, cell.config.model_dump_json(), shapes, seeds, threads)
        if key not in self._steps:
            torch.set_num_threads(threads)
            programs = _programs(cell, shapes, seeds, self._device)
            self._steps[key] = {name: _seconds_per_call(update, self._device) for name, update, _ in programs}
        sizes = Sizes(*cell.recipe.most_rows(environment.horizon))
        method = cell.method(cell.config, shapes, [0], torch.device("cpu"))
        steps = protocol.steps_for(cell.task)
        training = sum(
            self._steps[key][stage.name] * (steps if stage.steps is None else stage.steps)
            for stage in method.stages(sizes)
        )
        episodes = -(-steps // protocol.evaluation_every) * protocol.evaluation_episodes + protocol.further_episodes
        simulated = episodes * environment.horizon * seeds
        return Estimate(training, simulated * simulator_step)

    def _simulator(self, cell: Cell) -> tuple[float, int, int]:
        """Seconds per simulator step, and the lengths of observation and action."""
        environment = cell.task.environment
        if environment.name not in self._simulators:
            simulator = environment.make()
            observation, _ = simulator.reset(seed=0)
            box = environment.spaces.actions
            action = box.in_units(np.zeros(len(box.low), np.float32))
            seconds = _seconds_per_step(simulator, lambda _: action)
            if (together := environment.make_many(WORLDS)) is not None:
                seconds = _seconds_per_world(together, np.stack([action] * WORLDS))
            self._simulators[environment.name] = (seconds, len(observation), len(action))
        return self._simulators[environment.name]

    def generation(self, environment: Environment, demonstrator: Demonstrator) -> float:
        """Seconds per transition that a demonstrator generates."""
        key = (environment.name, demonstrator.fingerprint)
        if key not in self._generation:
            generator = np.random.default_rng(0)
            self._generation[key] = _seconds_per_step(
                environment.make(), lambda observation: demonstrator.act(observation, generator)
            )
        return self._generation[key]

    def recording(self, operator: Operator) -> float:
        """Seconds that an operator takes to record a few episodes; many at once take little longer."""
        key = (RECORDING, operator.fingerprint)
        if key not in self._generation:
            started = time.perf_counter()
            operator.record(RECORDED, np.random.default_rng(0))
            self._generation[key] = time.perf_counter() - started
        return self._generation[key]

    def footprint(self, cell: Cell) -> Footprint:
        """Bytes of the cell's data and of one seed's training, from their shapes and one step on a CPU."""
        _, observation, action = self._simulator(cell)
        rows = Sizes(*cell.recipe.most_rows(cell.task.environment.horizon))
        needs = cell.needs
        fields = len(needs.offline) + len(needs.expert)
        data = (rows.offline + rows.expert) * 4 * (observation + 1 + action + fields)
        key = (cell.method.name, cell.config.model_dump_json(), cell.task.environment.name)
        if key not in self._seed_bytes:
            torch.set_num_threads(1)
            programs = _programs(cell, Shapes(observation, action), 1, CPU)
            self._seed_bytes[key] = max(
                sum(tensor.nbytes for tensor in live_tensors(method).values()) + peak_bytes(update)
                for _, update, method in programs
            )
        return Footprint(fixed=data, per_seed=self._seed_bytes[key])


def _programs(
    cell: Cell, raw: Shapes, seeds: int, device: torch.device
) -> list[tuple[str, Callable[[], None], Method]]:
    """Every stage of a cell on random data: its name, a call that makes one update, and the method."""
    needs = cell.needs
    shapes = Shapes(raw.observation + int(needs.termination == "absorbing"), raw.action)
    view = random_view(needs, shapes, device)
    method: Method = cell.method(cell.config, shapes, range(seeds), device)
    randomness = Randomness(range(seeds), device)

    def updates(stage: Stage) -> Callable[[], None]:
        program = Program(method, view, stage, randomness, precision=cell.precision, recorder=recorder_for(device))
        steps = itertools.count()
        return lambda: program.update(next(steps))

    return [(stage.name, updates(stage), method) for stage in method.stages(view.sizes)]


def random_view(needs: DataNeeds, shapes: Shapes, device: torch.device, rows: int = PROBE_ROWS) -> View:
    """Random data with the fields that a method declares: `rows` of each part, none of them terminal."""
    generator = torch.Generator().manual_seed(0)
    widths = {"action": shapes.action, "terminated": 0, "label": 0}

    def column(field: Field) -> tuple[Tensor, Tensor]:
        width = widths.get(field, shapes.observation)
        size = (rows, width) if width else (rows,)
        values = torch.zeros(size) if not width else torch.rand(size, generator=generator) * 2 - 1
        return values.to(device), torch.arange(rows, device=device)

    def table(fields: tuple[Field, ...]) -> Table:
        return Table({field: column(field) for field in fields}, rows, rows)

    initial: tuple[Field, ...] = tuple(field for field in needs.offline if field == "initial_observation")
    rest: tuple[Field, ...] = tuple(field for field in needs.offline if field != "initial_observation")
    zeros = np.zeros(shapes.observation, np.float32)
    return View(table(rest), table(initial), table(needs.expert), shapes, ObservationTransform(zeros, zeros + 1, False))


def _seconds_per_step(simulator: gymnasium.Env[Any, Any], act: Callable[[FloatArray], FloatArray]) -> float:
    """Of acting in the simulator and stepping it, resets included; closes it."""
    observation, _ = simulator.reset(seed=0)

    def step() -> None:
        nonlocal observation
        observation, _, terminated, truncated, _ = simulator.step(act(np.asarray(observation, np.float32)))
        if terminated or truncated:
            observation, _ = simulator.reset()

    try:
        return _seconds_per_call(step)
    finally:
        simulator.close()


def _seconds_per_world(simulator: gymnasium.vector.VectorEnv[Any, Any, Any], action: FloatArray) -> float:
    """Of one world's step among `WORLDS` that step together; closes them."""
    try:
        simulator.reset(seed=0)
        return _seconds_per_call(lambda: simulator.step(action)) / WORLDS
    finally:
        simulator.close()


def _seconds_per_call(call: Callable[[], object], device: torch.device | None = None) -> float:
    def synchronize() -> None:
        if device is not None and device.type == "cuda":
            torch.cuda.synchronize(device)

    for _ in range(WARM_UP):
        call()
    synchronize()
    seconds: list[float] = []
    while sum(seconds) * CALLS_PER_BLOCK < PROBE_SECONDS:
        started = time.perf_counter()
        for _ in range(CALLS_PER_BLOCK):
            call()
        synchronize()
        seconds.append((time.perf_counter() - started) / CALLS_PER_BLOCK)
    # Blocks, because calls differ (delayed updates); their median, because other work interrupts some of them.
    return statistics.median(seconds)
