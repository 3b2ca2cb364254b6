"""A short measured probe of how long this machine will take, and with how much memory, before anything trains.

A step of a method is measured once per configuration and shapes, a step of a simulator once per environment, and a
transition of generated data once per environment and demonstrator.
"""

from __future__ import annotations

import itertools
import statistics
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten

from lfobench.cells.cell import Cell
from lfobench.cells.recipes import most_rows
from lfobench.contract.method import DataNeeds, Field, Method, Shapes, Sizes, Stage
from lfobench.contract.suite import Demonstrator, Environment, FloatArray, ScriptedDemonstrator
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.memory import Footprint
from lfobench.engine.program import Program, recorder_for
from lfobench.engine.state import host, live_tensors
from lfobench.randomness import Randomness

if TYPE_CHECKING:
    from torch import Tensor

PROBE_ROWS = 4096
WORLDS = 16
PROBE_SECONDS = 0.05
WARM_UP = 2
RECORDED = 4
"""Episodes of a scripted demonstrator in a probe; many at once take little longer."""
CALLS_PER_BLOCK = 4


class _Peak(TorchDispatchMode):
    """Follows the tensors that operations make: bytes alive now, and at most."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.now = self.most = 0
        self._known: set[int] = set()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        for given in tree_flatten((args, kwargs))[0]:
            if isinstance(given, torch.Tensor):
                self._follow(given.untyped_storage(), 0)
        out = func(*args, **(kwargs or {}))
        for made in tree_flatten(out)[0]:
            if isinstance(made, torch.Tensor):
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
class Estimate:
    """Seconds of a cell's seeds trained together, were they alone on a core or device."""

    training: float
    evaluation: float

    @property
    def total(self) -> float:
        """Training and evaluation, one after the other."""
        return self.training + self.evaluation


class Prober:
    """Estimates cells and data, measuring every configuration of a method and every environment once."""

    def __init__(self, device: str) -> None:
        self._device = torch.device(device)
        self._steps: dict[tuple[str, str, Shapes, int, int], tuple[Method, dict[str, float]]] = {}
        self._simulator_steps: dict[str, float] = {}
        self._transitions: dict[tuple[str, str], float] = {}
        self._recordings: dict[str, float] = {}
        self._seed_bytes: dict[tuple[str, str, Shapes], int] = {}

    def estimate(self, cell: Cell, seeds: int, threads: int = 1) -> Estimate:
        """Training from measured updates of every stage; evaluation as if every episode ran to its horizon.

        Args:
            cell: what would be trained.
            seeds: how many train together.
            threads: of one process on a CPU.
        """
        environment, protocol = cell.task.environment, cell.protocol
        shapes = _shapes(environment)
        key = (cell.method.name, cell.config.model_dump_json(), shapes, seeds, threads)
        if key not in self._steps:
            torch.set_num_threads(threads)
            programs = _programs(cell, shapes, seeds, self._device)
            seconds = {name: _seconds_per_call(update, self._device) for name, update, _ in programs}
            # For its stages alone; those that were timed release their memory.
            self._steps[key] = cell.method(cell.config, shapes, [0], host()), seconds
        method, seconds = self._steps[key]
        steps = protocol.steps_for(cell.task)
        training = sum(
            seconds[stage.name] * (steps if stage.steps is None else stage.steps)
            for stage in method.stages(Sizes(*most_rows(cell.recipe, environment.horizon)))
        )
        episodes = -(-steps // protocol.evaluation_every) * protocol.evaluation_episodes + protocol.further_episodes
        return Estimate(training, episodes * environment.horizon * seeds * self._simulator_step(environment))

    def generation(self, environment: Environment, demonstrator: Demonstrator) -> float:
        """Seconds per transition that a demonstrator generates: its action, and the simulator's step."""
        key = (environment.name, demonstrator.fingerprint)
        if key not in self._transitions:
            generator = np.random.default_rng(0)
            self._transitions[key] = _seconds_per_step(
                environment.make(), lambda observation: demonstrator.act(observation, generator)
            )
        return self._transitions[key]

    def recording(self, demonstrator: ScriptedDemonstrator) -> float:
        """Seconds that a scripted demonstrator takes to record a few episodes; many at once take little longer."""
        key = demonstrator.fingerprint
        if key not in self._recordings:
            started = time.perf_counter()
            demonstrator.record(RECORDED, np.random.default_rng(0))
            self._recordings[key] = time.perf_counter() - started
        return self._recordings[key]

    def footprint(self, cell: Cell) -> Footprint:
        """Bytes of the cell's data and of one seed's training, from their shapes and one step on a CPU."""
        shapes, needs = _shapes(cell.task.environment), cell.needs
        rows = Sizes(*most_rows(cell.recipe, cell.task.environment.horizon))
        fields = len(needs.offline) + len(needs.expert)
        data = (rows.offline + rows.expert) * 4 * (shapes.observation + 1 + shapes.action + fields)
        key = (cell.method.name, cell.config.model_dump_json(), shapes)
        if key not in self._seed_bytes:
            torch.set_num_threads(1)
            self._seed_bytes[key] = max(
                sum(tensor.nbytes for tensor in live_tensors(method).values()) + peak_bytes(update)
                for _, update, method in _programs(cell, shapes, 1, host())
            )
        return Footprint(fixed=data, per_seed=self._seed_bytes[key])

    def _simulator_step(self, environment: Environment) -> float:
        if environment.name not in self._simulator_steps:
            box = environment.spaces.actions
            action = box.in_units(np.zeros(len(box.low), np.float32))
            together = environment.make_many(WORLDS)
            self._simulator_steps[environment.name] = (
                _seconds_per_step(environment.make(), lambda _: action)
                if together is None
                else _seconds_per_world(together, np.stack([action] * WORLDS))
            )
        return self._simulator_steps[environment.name]


def _shapes(environment: Environment) -> Shapes:
    spaces = environment.spaces
    return Shapes(spaces.observation, len(spaces.actions.low))


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
    """Seconds of an action and a simulator's step, resets included; closes it."""
    observation, _ = simulator.reset(seed=0)

    def step() -> None:
        nonlocal observation
        action = act(np.asarray(observation, np.float32))
        observation, _, terminated, truncated, _ = simulator.step(action)
        if terminated or truncated:
            observation, _ = simulator.reset()

    try:
        return _seconds_per_call(step)
    finally:
        simulator.close()


def _seconds_per_world(simulator: gymnasium.vector.VectorEnv[Any, Any, Any], action: FloatArray) -> float:
    """Seconds of one world's step among `WORLDS` that step together; closes them."""
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
