"""Recorded steps are the eager steps: the same draws, the same parameters."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from helpers_engine import Drifting, FakeConfig
from tape import record
from torch import Tensor

from lfobench.contract.method import Batch, DataNeeds, Field, Method, Metrics, Shapes, Stage
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.program import Program, recorder_for
from lfobench.engine.state import live_tensors
from lfobench.randomness import Randomness, StepRandomness
from lfobench.registry import load_method

CPU = torch.device("cpu")
METHODS = ("dilo", "smodice", "oril", "bco", "seabo", "bc", "bc-expert")
SEEDS = (3, 4)
SHAPES = Shapes(5, 2)


def view_for(needs: DataNeeds, device: torch.device = CPU) -> View:
    generator = np.random.default_rng(0)

    def table(fields: tuple[Field, ...], rows: int) -> Table:
        columns: dict[Field, tuple[Tensor, Tensor]] = {}
        for field in fields:
            if field == "label":
                values = generator.uniform(0.0, 1.0, rows)
            elif field == "terminated":
                values = generator.random(rows) < 0.1
            else:
                width = SHAPES.action if field == "action" else SHAPES.observation
                values = generator.uniform(-0.9, 0.9, (rows, width))
            column = torch.from_numpy(values.astype(np.float32)).to(device)
            columns[field] = (column, torch.arange(rows, device=device))
        return Table(columns, rows, rows)

    initial: tuple[Field, ...] = tuple(field for field in needs.offline if field == "initial_observation")
    offline: tuple[Field, ...] = tuple(field for field in needs.offline if field != "initial_observation")
    zeros = np.zeros(SHAPES.observation, np.float32)
    transform = ObservationTransform(zeros, zeros + 1.0, False)
    return View(table(offline, 500), table(initial, 40), table(needs.expert, 90), SHAPES, transform)


def made(name: str, preset: str, device: torch.device = CPU, **overrides: object) -> tuple[Method, View]:
    method = load_method(name)
    fields = {**method.presets[preset], **method.budgets["smoke"], **overrides}  # type: ignore[index]
    config = method.Config(**fields)
    return method(config, SHAPES, SEEDS, device), view_for(method.needs(config), device)


def run(
    name: str, preset: str, steps: int, recorder: Callable[..., object] | None, **overrides: object
) -> list[Program]:
    """Programs of every stage after `steps` updates each."""
    method, view = made(name, preset, **overrides)
    programs = []
    for stage in method.stages(view.sizes):
        program = Program(method, view, stage, Randomness(SEEDS), recorder=recorder)  # type: ignore[arg-type]
        for step in range(steps):
            program.update(step)
        programs.append(program)
    programs[-1].method = method  # type: ignore[attr-defined]
    return programs


def same(one: dict[str, Tensor], two: dict[str, Tensor]) -> bool:
    return one.keys() == two.keys() and all(torch.equal(one[name], two[name]) for name in one)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["released", "paper"])
@pytest.mark.parametrize("name", METHODS)
def test_recorded_steps_end_where_eager_ones_do(name: str, preset: str) -> None:
    """Bit for bit: the tape repeats the same operations. Short passes, delayed updates and refills included.

    A thousand for DILO; a tape is slow, and 150 hold two refills and 37 passes of a discriminator.
    """
    steps = 1000 if (name, preset) == ("dilo", "released") else 150
    eager, recorded = run(name, preset, steps, None), run(name, preset, steps, record)
    for one, two in zip(eager, recorded, strict=True):
        assert two.problem is None
        assert two.replayed > steps // 2, "most steps were replayed"
        assert one.replayed == 0
        assert same(one.metric_sums(), two.metric_sums())
    assert same(live_tensors(eager[-1].method), live_tensors(recorded[-1].method))  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_program_may_begin_anywhere_and_its_metrics_start_anew() -> None:
    method, view = made("smodice", "released")
    twin, _ = made("smodice", "released")
    stage = method.stages(view.sizes)[-1]
    straight = Program(method, view, stage, Randomness(SEEDS), recorder=record)
    for step in range(100):
        straight.update(step)
        if step == 59:
            straight.clear_metrics()
    first = Program(twin, view, stage, Randomness(SEEDS), recorder=record)
    for step in range(70):
        first.update(step)
        if step == 59:
            first.clear_metrics()
    second = Program(twin, view, stage, Randomness(SEEDS), recorder=record)
    second.add_to_metrics(first.metric_sums())
    for step in range(70, 100):
        second.update(step)
    assert same(live_tensors(method), live_tensors(twin))
    assert same(straight.metric_sums(), second.metric_sums())


class Reading(Drifting):
    """Looks at a number on the host."""

    name = "reading"

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        metrics = super().update(stage, offline, expert, randomness)
        return metrics if float(metrics["drift"][0]) < 1e9 else {}


def test_a_step_that_cannot_be_recorded_runs_eagerly_and_says_so_once() -> None:
    config = FakeConfig()
    view = view_for(Reading.needs(config))

    def trained(recorder: Callable[..., object] | None) -> tuple[Method, Program]:
        method = Reading(config, SHAPES, SEEDS, CPU)
        program = Program(method, view, Stage("drift", None, 8, 4), Randomness(SEEDS), recorder=recorder)  # type: ignore[arg-type]
        for step in range(80):
            program.update(step)
        return method, program

    calls = []

    def counting(work: Callable[[], None]) -> Callable[[], None]:
        calls.append(work)
        return record(work)

    (eager, _), (fallen_back, program) = trained(None), trained(counting)
    assert same(live_tensors(eager), live_tensors(fallen_back))
    assert len(calls) == 1, "it was tried once"
    assert program.replayed == 0
    assert program.problem is not None
    assert "Stage 'drift' ran step by step" in program.problem.what
    assert "_local_scalar_dense" in program.problem.what


def test_a_cpu_records_nothing() -> None:
    assert recorder_for(CPU) is None


@pytest.mark.parametrize("preset", ["released", "paper"])
@pytest.mark.parametrize("name", METHODS)
def test_a_step_touches_one_device_and_reads_nothing_back(
    name: str, preset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a device without memory: a tensor left on the CPU meets another device, a value read back does not exist.

    It is batched as on CUDA. The fused optimiser, which torch has for real devices only, is told to do nothing here.
    """
    optimizer = sys.modules["torch.optim.optimizer"]
    monkeypatch.setattr(optimizer, "_get_fused_kernels_supported_devices", lambda: ["meta"])
    library = torch.library.Library("aten", "IMPL", "Meta")
    library.impl("_fused_adam_.tensor_lr", lambda *arguments, **options: None)
    device = torch.device("meta")
    method, view = made(name, preset, device)
    for stage in method.stages(view.sizes):
        program = Program(method, view, stage, Randomness(SEEDS, device))
        for step in range(2 * stage.period + 3):
            program.update(step)
        for total in program.metric_sums().values():
            assert total.device == device
            assert total.shape == (len(SEEDS),)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("name", METHODS)
def test_cuda_graphs_end_where_eager_steps_do(name: str) -> None:
    """Within 1e-4 relative to the largest parameter after 1000 steps: library kernels may differ while recording."""
    device = torch.device("cuda")
    states = []
    for recorder in (None, recorder_for(device)):
        method, view = made(name, "released", device)
        for stage in method.stages(view.sizes):
            program = Program(method, view, stage, Randomness(SEEDS, device), recorder=recorder)
            for step in range(1000):
                program.update(step)
            assert program.problem is None
            assert (program.replayed > 900) == (recorder is not None)
        states.append(live_tensors(method))
    eager, recorded = states
    for tensor, other in zip(eager.values(), recorded.values(), strict=True):
        largest = float(tensor.abs().max())
        torch.testing.assert_close(other, tensor, rtol=0.0, atol=1e-4 * max(largest, 1.0))


def trained_on_cuda(name: str, seeds: tuple[int, ...], steps: int, recorded: bool = True) -> dict[str, Tensor]:
    device = torch.device("cuda")
    kind = load_method(name)
    config = kind.Config(**kind.budgets["smoke"])  # type: ignore[arg-type]
    method, view = kind(config, SHAPES, seeds, device), view_for(kind.needs(config), device)
    stage = method.stages(view.sizes)[-1]
    recorder = recorder_for(device) if recorded else None
    program = Program(method, view, stage, Randomness(seeds, device), recorder=recorder)
    for step in range(steps):
        program.update(step)
    assert program.problem is None
    return live_tensors(method)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_cuda_a_seed_alone_is_near_the_same_seed_among_seven() -> None:
    """Batched products of another number of seeds may round otherwise: 1e-3 of the largest value after 200 steps."""
    together, alone = trained_on_cuda("dilo", tuple(range(7)), 200), trained_on_cuda("dilo", (3,), 200)
    for name, tensor in alone.items():
        if tensor.dim():
            among = together[name][3 * len(tensor) : 4 * len(tensor)]
            torch.testing.assert_close(among, tensor, rtol=0.0, atol=1e-3 * max(float(tensor.abs().max()), 1.0))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_cuda_threads_record_and_replay_beside_each_other() -> None:
    names = ("dilo", "bc", "smodice")
    expected = {name: trained_on_cuda(name, SEEDS, 300, recorded=False) for name in names}
    found: dict[str, dict[str, Tensor]] = {}

    def lane(name: str) -> None:
        with torch.cuda.stream(torch.cuda.Stream()):
            found[name] = trained_on_cuda(name, SEEDS, 300)

    threads = [threading.Thread(target=lane, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    torch.cuda.synchronize()
    for name in names:
        for entry, tensor in expected[name].items():
            atol = 1e-4 * max(float(tensor.abs().max()), 1.0)
            torch.testing.assert_close(found[name][entry], tensor, rtol=0.0, atol=atol)


class Decaying(Drifting):
    """Counts its updates in Python and divides by the count: a replay would repeat the count of the recording."""

    name = "decaying"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.updates = 0

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        self.updates += 1
        before = self.weight.clone()
        metrics = super().update(stage, offline, expert, randomness)
        self.weight.copy_(before + (self.weight - before) / self.updates)
        return metrics


class Rebinding(Drifting):
    """Puts a new tensor in the place of its weight at every update."""

    name = "rebinding"

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        self.weight = self.weight.clone()
        return super().update(stage, offline, expert, randomness)


@pytest.mark.parametrize(("kind", "what"), [(Decaying, "updates"), (Rebinding, "weight")])
def test_a_step_that_changes_something_in_python_is_not_recorded(kind: type[Drifting], what: str) -> None:
    config = FakeConfig()
    view = view_for(kind.needs(config))
    found = []
    for recorder in (None, record):
        method = kind(config, SHAPES, SEEDS, CPU)
        program = Program(method, view, Stage("drift", None, 8, 4), Randomness(SEEDS), recorder=recorder)
        for step in range(40):
            program.update(step)
        found.append((live_tensors(method), program))
    assert same(found[0][0], found[1][0])
    assert found[1][1].replayed == 0
    assert found[1][1].problem is not None
    assert f"'{what}' in Python" in found[1][1].problem.what
