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
from helpers_engine import HOPPER_TASK, finish, make_job, records_of, smoke_cell

from lfobench.engine.job import Job
from lfobench.store.folder import RecordFolder

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
    kept = {"records": ".json", "policies": ".safetensors", "checkpoints": ".lock"}
    files = [path for path in out.rglob("*") if path.is_file()]
    left = [path for path in files if kept.get(path.relative_to(out).parts[0]) != path.suffix]
    assert left == [], "neither checkpoints nor halves of files"
