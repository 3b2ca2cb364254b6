"""A schedule fitted to a machine: what runs at once, in which groups, with how many threads and evaluators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import pytest
from helpers_engine import POLE_TASK, TINY, smoke_cell

from lfobench.cells.cell import Cell
from lfobench.cells.plan import Request, make_plan
from lfobench.contract.suite import Demonstrator, Environment
from lfobench.engine.job import Job
from lfobench.engine.memory import Footprint, Memory
from lfobench.engine.probe import Estimate, Prober
from lfobench.errors import UserError
from lfobench.records.folder import RecordsRead
from lfobench.schedule.jobs import LANES, PROCESS_BYTES, Schedule, forecast, make_schedule, packed

GB = 2**30


@dataclass
class FakeProber:
    """Knows what it is told; seconds are one per seed."""

    footprints: Mapping[str, Footprint] = field(default_factory=dict)
    error: Exception | None = None

    def footprint(self, cell: Cell) -> Footprint:
        if self.error is not None:
            raise self.error
        return self.footprints.get(cell.method.name, Footprint(0, 0))

    def estimate(self, cell: Cell, seeds: int, threads: int = 1) -> Estimate:
        if self.error is not None:
            raise self.error
        return Estimate(float(seeds), 0.0)

    def generation(self, environment: Environment, demonstrator: Demonstrator) -> float:
        return 0.0


def schedule(tmp_path: Path, device: str, methods: str = "dilo", seeds: str = "0-6") -> Schedule:
    request = Request(methods, TINY, POLE_TASK, seeds=seeds, protocol="smoke", device=device)
    plan = make_plan(request, lambda: True)
    return make_schedule(plan, RecordsRead(), tmp_path / "out", tmp_path / "cache", workers=99)


def pack(
    before: Schedule, prober: FakeProber, available: int | None, cores: int = 16, workers: int | None = None
) -> Schedule:
    after = packed(before, cast(Prober, prober), Memory(available, available), cores, workers)
    assert [(run.cell.method.name, run.seed) for run in after.pending] == [
        (run.cell.method.name, run.seed) for run in before.pending
    ], "the same work in the same order"
    return after


def groups(after: Schedule) -> list[tuple[int, ...]]:
    return [job.seeds for job in after.jobs]


def said(after: Schedule) -> str:
    return " ".join(f"{note.what} {note.remedy}" for note in after.notes)


# --- CUDA ------------------------------------------------------------------------------------------------------------


def test_a_device_with_room_trains_all_seeds_of_a_cell_together(tmp_path: Path) -> None:
    prober = FakeProber({"dilo": Footprint(GB // 10, GB // 10)})
    after = pack(schedule(tmp_path, "cuda", "dilo,bc"), prober, 80 * GB)
    assert groups(after) == [tuple(range(7))] * 2
    assert list(after.notes) == []


@pytest.mark.parametrize(("available", "sizes"), [(9 * GB, [3, 4]), (5 * GB, [2, 2, 3]), (2 * GB, [1] * 7)])
def test_seeds_train_in_groups_where_memory_is_short(available: int, sizes: list[int], tmp_path: Path) -> None:
    """A seed with its margin takes 1.5 GB: of nine, six seeds fit at once."""
    prober = FakeProber({"dilo": Footprint(0, GB), "bc": Footprint(0, GB // 1000)})
    after = pack(schedule(tmp_path, "cuda", "dilo,bc"), prober, available)
    assert [len(job.seeds) for job in after.jobs if job.cell.method.name == "dilo"] == sizes
    assert [len(job.seeds) for job in after.jobs if job.cell.method.name == "bc"] == [7], "only what does not fit"
    assert f"{available / GB:.1f} GB of memory may be used, so the seeds of 1 cell train in groups" in said(after)
    assert "round otherwise" in said(after)


def test_groups_do_not_depend_on_what_is_free_at_the_moment(tmp_path: Path) -> None:
    """On a GPU, groups of another size round otherwise."""
    prober = FakeProber({"dilo": Footprint(0, GB)})
    for free in (2 * GB, 9 * GB):
        after = packed(schedule(tmp_path, "cuda"), cast(Prober, prober), Memory(9 * GB, free), 16, None)
        assert [len(job.seeds) for job in after.jobs] == [3, 4]


def test_building_keeps_its_processes(tmp_path: Path) -> None:
    after = pack(schedule(tmp_path, "cuda", seeds="0"), FakeProber(), 80 * GB)
    assert (after.workers, after.builders) == (1, 99)


def test_one_seed_that_does_not_fit_is_tried_and_said(tmp_path: Path) -> None:
    after = pack(schedule(tmp_path, "cuda"), FakeProber({"dilo": Footprint(0, 2 * GB)}), GB)
    assert groups(after) == [(seed,) for seed in range(7)]
    assert after.workers == 1
    assert "One job needs about 3.0 GB, and 1.0 GB of memory may be used" in said(after)


def test_lanes_are_limited_by_memory(tmp_path: Path) -> None:
    """Of cells that take 3 GB each, four would share the device by default."""
    before = schedule(tmp_path, "cuda", "dilo,smodice,oril,bco", "0")
    footprints = {job.cell.method.name: Footprint(0, 2 * GB) for job in before.jobs}
    room = pack(before, FakeProber(footprints), 80 * GB)
    assert (room.workers, list(room.notes)) == (LANES, [])
    short = pack(before, FakeProber(footprints), 7 * GB)
    assert short.workers == 2
    assert f"so 2 instead of {LANES} jobs run at once" in said(short)
    assert groups(short) == [(0,)] * 4, "each fits by itself"
    unknown = pack(before, FakeProber(footprints), None)
    assert (unknown.workers, list(unknown.notes)) == (LANES, [])


@pytest.mark.parametrize(("workers", "expected"), [(1, 1), (2, 2), (4, 4), (50, 4)])
def test_lanes_are_the_users_if_named(workers: int, expected: int, tmp_path: Path) -> None:
    after = pack(schedule(tmp_path, "cuda", "dilo,smodice,oril,bco", "0"), FakeProber(), 80 * GB, workers=workers)
    assert after.workers == expected
    assert list(after.notes) == []


@pytest.mark.parametrize(
    ("cores", "workers", "evaluators"), [(16, None, 16 // LANES), (16, 1, 16), (16, 4, 4), (7, 2, 3), (1, None, 1)]
)
def test_cores_evaluate_beside_a_device(cores: int, workers: int | None, evaluators: int, tmp_path: Path) -> None:
    prober = FakeProber()
    after = pack(schedule(tmp_path, "cuda", "dilo,smodice,oril,bco", "0-15"), prober, 80 * GB, cores, workers)
    assert {job.evaluators for job in after.jobs} == {evaluators}
    assert {job.threads for job in after.jobs} == {1}, "threads are for products on a CPU"
    alone = pack(schedule(tmp_path, "cuda", seeds="0"), prober, 80 * GB, cores, workers)
    assert {job.evaluators for job in alone.jobs} == {1}, "a seed is evaluated by one process"


# --- CPU -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cores", "expected"), [(1, 1), (4, 4), (16, 7)])
def test_a_cpu_runs_a_job_per_core(cores: int, expected: int, tmp_path: Path) -> None:
    after = pack(schedule(tmp_path, "cpu"), FakeProber(), 900 * GB, cores)
    assert after.workers == expected
    assert groups(after) == [(seed,) for seed in range(7)]
    assert {job.evaluators for job in after.jobs} == {0}
    assert list(after.notes) == []


def test_a_cpu_runs_what_its_memory_holds(tmp_path: Path) -> None:
    """Data counts once per process here, and so does the process itself."""
    prober = FakeProber({"dilo": Footprint(GB, GB)})
    one = round(1.5 * (2 * GB + PROCESS_BYTES))
    after = pack(schedule(tmp_path, "cpu"), prober, 3 * one + GB, cores=4)
    assert after.workers == 3
    assert "3 instead of 4 jobs run at once" in said(after)


def test_a_process_takes_memory_before_it_has_any_data(tmp_path: Path) -> None:
    after = pack(schedule(tmp_path, "cpu"), FakeProber(), 4 * PROCESS_BYTES, cores=7)
    assert after.workers == 2


@pytest.mark.parametrize(
    ("seeds", "cores", "workers", "threads"),
    [
        ("0", 8, None, 4),
        ("0", 3, None, 2),
        ("0-1", 8, None, 4),
        ("0-2", 8, None, 2),
        ("0-6", 8, None, 1),
        ("0-6", 4, None, 1),
        ("0", 1, None, 1),
        ("0", 8, 1, 1),
        ("0-1", 8, 2, 1),
    ],
)
def test_threads_are_for_cores_that_no_job_needs(
    seeds: str, cores: int, workers: int | None, threads: int, tmp_path: Path
) -> None:
    """And not for a user who said how many jobs run: the rest of the machine may be somebody else's."""
    after = pack(schedule(tmp_path, "cpu", seeds=seeds), FakeProber(), None, cores, workers)
    assert {job.threads for job in after.jobs} == {threads}
    assert after.workers * threads <= cores


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_a_plan_asked_for_twice_is_the_same_plan(device: str, tmp_path: Path) -> None:
    """However fast a step seems to be each time, and whatever memory is free at the moment."""

    @dataclass
    class Noisy(FakeProber):
        calls: int = 0

        def estimate(self, cell: Cell, seeds: int, threads: int = 1) -> Estimate:
            self.calls += 1
            return Estimate(1000.0 / self.calls**2, 0.0)

    def plan(free: int) -> list[Job]:
        before = schedule(tmp_path, device, "dilo,smodice,oril,bco", seeds="0-2")
        return list(packed(before, cast(Prober, Noisy()), Memory(80 * GB, free), 16, None).jobs)

    def arrangement(free: int) -> list[tuple[str, tuple[int, ...], int]]:
        return [(job.cell.method.name, job.seeds, job.threads) for job in plan(free)]

    assert arrangement(GB) == arrangement(80 * GB)


# --- what cannot be measured -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("device", ["cpu", "cuda"])
@pytest.mark.parametrize("error", [RuntimeError("a bug"), MemoryError("too much")])
def test_a_probe_that_fails_breaks_no_plan(error: Exception, device: str, tmp_path: Path) -> None:
    prober = FakeProber(error=error)
    before = schedule(tmp_path, device, "dilo,bc", seeds="0")
    after = pack(before, prober, 8 * GB)
    assert groups(after) == groups(before)
    assert after.workers == 2
    assert len(after.notes) == 2, "an unknown size is said, once per cell"
    expected = forecast(after, cast(Prober, prober))
    assert len(expected.warnings) == 4, "and so is an unknown duration"
    assert all(str(error) in warning.what for warning in expected.warnings)


def test_a_users_mistake_met_by_the_probe_is_theirs(tmp_path: Path) -> None:
    prober = FakeProber(error=UserError("No such simulator.", "Install it."))
    with pytest.raises(UserError, match="No such simulator"):
        packed(schedule(tmp_path, "cpu"), cast(Prober, prober), Memory(8 * GB, 8 * GB), 4, None)


def test_nothing_left_is_nothing_to_pack(tmp_path: Path) -> None:
    done = schedule(tmp_path, "cpu")
    empty = Schedule(done.plan, done.plan.runs, [], [], [], done.cache, done.workers, done.builders)
    assert packed(empty, cast(Prober, FakeProber(error=RuntimeError())), Memory(None, None), 4, None) is empty


def test_what_was_changed_is_in_the_forecast(tmp_path: Path) -> None:
    prober = FakeProber({"dilo": Footprint(0, GB)})
    after = pack(schedule(tmp_path, "cuda"), prober, 9 * GB)
    assert set(after.notes) <= set(forecast(after, cast(Prober, prober)).warnings)


# --- the real probe --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["dilo", "smodice", "bc"])
def test_a_footprint_is_positive_and_grows_with_the_batch(name: str) -> None:
    """Not with every batch size: a stage of a batch of its own (a discriminator's) may need the most."""
    prober = Prober("cpu")
    footprints = [
        prober.footprint(smoke_cell(name, assignments=(f"{name}.batch_size={size}",))) for size in (16, 512, 1024)
    ]
    assert all(footprint.fixed > 0 and footprint.per_seed > 0 for footprint in footprints)
    small, middle, large = (footprint.per_seed for footprint in footprints)
    assert small < middle < large
    assert len({footprint.fixed for footprint in footprints}) == 1, "the data is the same"
    rows = 2 * 1024 * 4  # offline and expert rows of the batch, of which only one float is certain
    assert large > rows


def test_a_footprint_is_the_same_twice() -> None:
    cell = smoke_cell("dilo")
    assert Prober("cpu").footprint(cell) == Prober("cuda").footprint(cell), "steps are taken on the CPU anyway"
