"""Jobs on threads of one process: the records of one after another, and nothing that one job does ends another.

On the CPU, where a lane has no stream of its own; the threads are the same.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers_cli import PATIENCE
from helpers_engine import Drifting, Raising, StopAfter, cell_of, make_job, never, records_of, smoke_cell

from lfobench.engine.job import Job, Recorded, run_job
from lfobench.engine.training import Advance
from lfobench.schedule.executors import Ended, Event, RunJob, in_sequence, in_threads


def outcomes(events: Sequence[Event]) -> dict[int, str]:
    return {event.index: event.what.outcome for event in events if isinstance(event.what, Ended)}


def of_job(events: Sequence[Event], index: int) -> list[Any]:
    return [event.what for event in events if event.index == index]


def drifting(seeds: Sequence[int], out: Path, cache: Path) -> list[Job]:
    return [make_job(cell_of(Drifting), [seed], out, cache) for seed in seeds]


def measured(jobs: Sequence[Job]) -> list[Any]:
    return [record.measured() for job in jobs for record in records_of(job)]


def together(jobs: int) -> RunJob:
    """`run_job` of jobs that wait for each other before they begin: they run at once, or not at all."""
    barrier = threading.Barrier(jobs)

    def begin(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
        barrier.wait(PATIENCE)
        yield from run_job(job, stop)

    return begin


def test_lanes_and_local_leave_the_same_records(tmp_path: Path, shared_cache: Path) -> None:
    """Two methods at a time, each in the middle of the other's products, graphs and drawn numbers."""

    def jobs(out: str) -> list[Job]:
        return [
            make_job(smoke_cell(name), [seed], tmp_path / out, shared_cache)
            for name in ("dilo", "smodice")
            for seed in (0, 1)
        ]

    one, two = jobs("local"), jobs("lanes")
    here, there = list(in_sequence(one, run_job, never)), list(in_threads(two, together(2), 2, never))
    assert outcomes(here) == outcomes(there) == dict.fromkeys(range(4), "done")
    assert measured(two) == measured(one)


def test_events_of_two_jobs_interleave(tmp_path: Path, shared_cache: Path) -> None:
    """Each of the two works only until the other has worked as well: in turn, neither would ever end."""
    steps = 5
    barrier = threading.Barrier(2)

    def in_step(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
        for step in range(steps):
            barrier.wait(PATIENCE)
            yield Advance("walking", step, steps, None)

    events = list(in_threads(drifting([0, 1], tmp_path, shared_cache), in_step, 2, never))
    assert outcomes(events) == {0: "done", 1: "done"}
    for index in (0, 1):
        *advances, ended = of_job(events, index)
        assert [advance.done for advance in advances] == list(range(steps)), "all of them, in order"
        assert isinstance(ended, Ended), "and its end is the last that is heard of a job"
    first_end = next(place for place, event in enumerate(events) if isinstance(event.what, Ended))
    assert {event.index for event in events[:first_end]} == {0, 1}


def test_every_job_is_reported_from_its_first_step_to_its_record(tmp_path: Path, shared_cache: Path) -> None:
    jobs = drifting([0, 1, 2], tmp_path, shared_cache)
    events = list(in_threads(jobs, run_job, 2, never))
    for index, job in enumerate(jobs):
        *advances, recorded, ended = of_job(events, index)
        assert [advance.done for advance in advances] == sorted(advance.done for advance in advances)
        assert advances[-1].done == advances[-1].total == 47
        assert isinstance(recorded, Recorded)
        assert recorded.run == job.runs[0].label
        assert ended == Ended("done")


def leave(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
    """What a method that calls ``sys.exit`` does to its job."""
    yield Advance("leaving", 0, 1, None)
    sys.exit("enough")


def test_whatever_ends_one_job_ends_no_other(tmp_path: Path, shared_cache: Path) -> None:
    """A bug, an exit (which a thread keeps to itself), missing data: each is said, and the last job is done."""
    cells = [cell_of(Raising), cell_of(Drifting), cell_of(Drifting), cell_of(Drifting)]
    jobs = [make_job(cell, [seed], tmp_path, shared_cache) for seed, cell in enumerate(cells)]
    jobs[2] = Job(cells[2], (2,), tmp_path, tmp_path / "no-cache", "cpu")

    def some_leave(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
        return leave(job, stop) if job is jobs[1] else run_job(job, stop)

    events = list(in_threads(jobs, some_leave, 1, never))
    assert outcomes(events) == {0: "failed", 1: "failed", 2: "failed", 3: "done"}
    bug, left, missing = (of_job(events, index)[-1] for index in range(3))
    assert "a bug in somebody's method" in bug.message
    assert "Traceback" in bug.detail
    assert "enough" in left.message
    assert "missing" in missing.message
    assert missing.detail == ""


def test_a_job_that_is_running_already_is_busy(tmp_path: Path, shared_cache: Path) -> None:
    jobs = drifting([0, 1], tmp_path, shared_cache)
    holder = run_job(jobs[0], never)
    next(holder)
    assert outcomes(list(in_threads(jobs, run_job, 2, never))) == {0: "busy", 1: "done"}
    list(holder)


def test_a_stop_saves_what_runs_and_leaves_the_rest(tmp_path: Path, shared_cache: Path) -> None:
    """The stop is asked for after 30 questions of both jobs together: neither has come to its 47th step."""
    straight = drifting([0, 1, 2], tmp_path / "straight", shared_cache)
    broken = drifting([0, 1, 2], tmp_path / "broken", shared_cache)
    list(in_sequence(straight, run_job, never))
    assert outcomes(list(in_threads(broken, together(2), 2, StopAfter(30)))) == {0: "stopped", 1: "stopped"}
    checkpoints = list((tmp_path / "broken").rglob("*.safetensors"))
    assert len(checkpoints) == 2
    assert not list((tmp_path / "broken").rglob("*.json"))
    assert outcomes(list(in_threads(broken, run_job, 2, never))) == dict.fromkeys(range(3), "done")
    assert measured(broken) == measured(straight)


def test_a_stop_before_the_first_job(tmp_path: Path, shared_cache: Path) -> None:
    assert list(in_threads(drifting([0, 1], tmp_path, shared_cache), run_job, 2, lambda: True)) == []


@pytest.mark.parametrize("ending", ["close", "raise"])
def test_lanes_end_with_whoever_listened_to_them(ending: str, tmp_path: Path, shared_cache: Path) -> None:
    """A display that breaks, or a second Ctrl-C: no thread goes on unseen, and the jobs that waited never begin."""
    begun = []

    def crawl(job: Job, stop: Callable[[], bool]) -> Iterator[Advance | Recorded]:
        begun.append(job.seeds)
        while not stop():
            time.sleep(0.01)
            yield Advance("crawling", 0, 1, None)

    before = set(threading.enumerate())
    events = in_threads(drifting([0, 1, 2], tmp_path, shared_cache), crawl, 2, never)
    seen: set[int] = set()
    while seen != {0, 1}:
        seen.add(next(events).index)
    running = set(threading.enumerate()) - before
    assert len(running) == 2
    if ending == "close":
        events.close()  # type: ignore[attr-defined]
    else:
        with pytest.raises(KeyboardInterrupt):
            events.throw(KeyboardInterrupt())  # type: ignore[attr-defined]
    for lane in running:
        lane.join(PATIENCE)
        assert not lane.is_alive()
    assert sorted(begun) == [(0,), (1,)]


def test_more_lanes_than_jobs(tmp_path: Path, shared_cache: Path) -> None:
    assert outcomes(list(in_threads(drifting([0, 1], tmp_path, shared_cache), run_job, 9, never))) == {
        0: "done",
        1: "done",
    }
    assert list(in_threads([], run_job, 9, never)) == []
