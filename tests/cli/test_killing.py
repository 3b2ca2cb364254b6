"""kill -9 at random moments, again and again: the records are those of a run that was never killed."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from helpers_cli import PATIENCE, arguments, environment
from helpers_engine import HOPPER_TASK, Drifting, cell_of, finish, make_job, records_of, smoke_cell

from lfobench.engine.job import Job
from lfobench.records.folder import RecordFolder

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds orphans through /proc"),
]

METHODS, SEEDS = ("dilo", "bco"), (0, 1)


def jobs(out: Path, cache: Path) -> list[Job]:
    cells = [smoke_cell(name, HOPPER_TASK, "locomotion") for name in METHODS]
    return [Job(cell, (seed,), out, cache, "cpu") for cell in cells for seed in SEEDS]


def measured(out: Path, cache: Path) -> list[dict[str, Any]]:
    return [record.measured() for job in jobs(out, cache) for record in records_of(job)]


def session(leader: int) -> set[int]:
    """Processes of the session that `leader` began, zombies aside."""
    found = set()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            state, _, _, member_of = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(member_of) == leader and state != "Z":
            found.add(int(entry.name))
    return found


def snapshot(out: Path) -> frozenset[tuple[str, int]]:
    """Files and their times; changes with every checkpoint and record."""
    seen = set()
    for path in out.rglob("*"):
        try:
            seen.add((str(path), path.stat().st_mtime_ns))
        except OSError:
            continue
    return frozenset(seen)


def wait_for_the_moment(running: subprocess.Popen[bytes], out: Path, choice: random.Random) -> bool:
    """Until a random time has passed or a random number of writes was seen; False if the command finished first."""
    if choice.random() < 0.3:
        try:
            running.wait(choice.uniform(1.0, 5.0))
        except subprocess.TimeoutExpired:
            return True
        return False
    changes, last, wanted = 0, snapshot(out), choice.randrange(1, 20)
    while changes < wanted:
        if running.poll() is not None:
            return False
        now = snapshot(out)
        changes, last = changes + (now != last), now
        time.sleep(0.005)
    time.sleep(choice.uniform(0.0, 0.03))
    return running.poll() is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("workers", "kills", "builds"), [(1, 15, True), (2, 5, False)], ids=["in-this-process", "in-a-pool"]
)
def test_twenty_kills_change_nothing(
    workers: int, kills: int, builds: bool, tmp_path: Path, shared_cache: Path
) -> None:
    """Together twenty; the first of them may fall into the building of the data."""
    choice = random.Random(20 + workers)
    straight, out = tmp_path / "straight", tmp_path / "runs"
    cache = tmp_path / "cache" if builds else shared_cache
    for job in jobs(straight, shared_cache):
        finish(make_job(job.cell, job.seeds, straight, shared_cache))
    expected = measured(straight, shared_cache)

    command = arguments(
        *("run", "--methods", ",".join(METHODS), "--tasks", HOPPER_TASK, "--protocol", "smoke"),
        *("--seeds", "0-1", "--workers", workers, "--out", out),
    )
    log = tmp_path / "log"
    killed = 0
    while True:
        with (
            log.open("wb") as sink,
            subprocess.Popen(
                command,
                env=environment({"LFOBENCH_CACHE": str(cache)}),
                stdout=sink,
                stderr=sink,
                start_new_session=True,
            ) as running,
        ):
            if killed < kills and wait_for_the_moment(running, out, choice):
                os.kill(running.pid, signal.SIGKILL)
                killed += 1
            running.wait()
        if running.returncode == -signal.SIGKILL:
            patience = time.monotonic() + PATIENCE
            while session(running.pid) and time.monotonic() < patience:
                time.sleep(0.02)
            assert session(running.pid) == set(), "workers go with their parent"
            if out.exists():
                assert RecordFolder(out).read_all().warnings == [], "no half-written record"
            continue
        assert running.returncode == 0, log.read_text()
        assert measured(out, cache) == expected
        if killed == kills:
            break
        shutil.rmtree(out)
    kept = {"records": ".json", "policies": ".safetensors"}
    files = [path for path in out.rglob("*") if path.is_file()]
    left = [path for path in files if kept.get(path.relative_to(out).parts[0]) != path.suffix]
    assert left == [], "neither checkpoints nor locks nor halves of files"


# --- what a kill costs -----------------------------------------------------------------------------------------------

# Of `Drifting`: the warm-up has 7 steps and no evaluation, and every 10 steps of the rest end with a checkpoint.
LENGTH, INTERVAL = 47, 17
DRIFTING_SEEDS = range(6)


def grouped(choice: random.Random) -> list[tuple[int, ...]]:
    """The seeds in random groups, as other memory, other cells or other workers arrange them."""
    seeds = list(DRIFTING_SEEDS)
    choice.shuffle(seeds)
    groups: list[tuple[int, ...]] = []
    while seeds:
        size = choice.randint(1, len(seeds))
        groups.append(tuple(seeds[:size]))
        del seeds[:size]
    return groups


def sitting(out: Path, cache: Path, groups: list[tuple[int, ...]], updates: int, steps: Path) -> int:
    """Train in a process that kills itself after so many updates, counting every seed's steps; how it ended."""
    process = os.fork()
    if process:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    try:
        genuine, left = Drifting.update, updates

        def counted(self: Drifting, *arguments: Any) -> Any:
            nonlocal left
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left -= 1
            with steps.open("ab", buffering=0) as file:
                file.write(b"." * len(self.seeds))
            return genuine(self, *arguments)

        Drifting.update = counted  # type: ignore[method-assign]
        for seeds in groups:
            finish(Job(cell_of(Drifting), seeds, out, cache, "cpu"))
        os._exit(0)
    finally:
        os._exit(1)


@pytest.mark.slow
def test_a_hundred_kills_cost_no_more_than_their_intervals(tmp_path: Path, shared_cache: Path) -> None:
    """However the seeds are grouped each time: a run's checkpoint is its own."""
    choice = random.Random(14)
    steps, out = tmp_path / "steps", tmp_path / "out"
    steps.touch()
    straight = make_job(cell_of(Drifting), list(DRIFTING_SEEDS), tmp_path / "straight", shared_cache)
    finish(straight)
    whole, kills, most = len(DRIFTING_SEEDS) * LENGTH, 0, 0
    while kills < 100:
        groups = grouped(choice)
        # As many updates as it may take, so that kills fall anywhere, and every run comes to its end now and then.
        ended = sitting(out, shared_cache, groups, choice.randrange(1, 40), steps)
        assert ended in (0, -signal.SIGKILL)
        # Of the seeds that trained together when it was killed, each has lost an interval at most.
        kills += ended != 0
        most += INTERVAL * max(map(len, groups)) if ended else 0
        assert len(steps.read_bytes()) <= whole + most
        if ended == 0:
            assert records_measured(out, shared_cache) == [record.measured() for record in records_of(straight)]
            whole += len(DRIFTING_SEEDS) * LENGTH
            shutil.rmtree(out)


def records_measured(out: Path, cache: Path) -> list[dict[str, Any]]:
    job = Job(cell_of(Drifting), tuple(DRIFTING_SEEDS), out, cache, "cpu")
    return [record.measured() for record in records_of(job)]
