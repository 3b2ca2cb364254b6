"""The command as a process of its own: start-up, foreign folders, plug-ins, Ctrl-C."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from helpers_cli import PATIENCE, Outcome, arguments, assert_refused, environment, process
from helpers_engine import TINY, finish, make_job, records_of, smoke_cell

from lfobench.engine.job import Job
from lfobench.files import TEMPORARY_SUFFIX
from lfobench.records.folder import RecordFolder

pytestmark = pytest.mark.slow

TASK = ("--tasks", "pole-random-expert", "--protocol", "smoke")
CONSOLE_SCRIPT = [str(Path(sys.executable).with_name("lfobench"))]
HEAVY = ("torch", "scipy", "pandas", "gymnasium", "mujoco", "safetensors", "methods", "suites")


def test_help_loads_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "from lfobench.cli import main\n"
        "commands = [[], ['ls'], ['show'], ['run'], ['tune'], ['status'], ['why'], ['table'], ['data']]\n"
        "commands.append(['data', 'build'])\n"
        "for command in commands:\n"
        "    sys.argv = ['lfobench', *command, '--help']\n"
        "    try:\n        main()\n"
        "    except SystemExit as ended:\n        assert not ended.code\n"
        "from lfobench import lazy_torch\n"
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "print('loaded:', [name for name in heavy if name != 'torch' or lazy_torch.is_loaded()])"
    )
    assert "loaded: []" in process([sys.executable, "-c", script]).out


# --- folders and packages of somebody else's -------------------------------------------------------------------------


@pytest.fixture
def hostile_folder(tmp_path: Path) -> Path:
    """A working folder whose names are ours."""
    for name in ("methods", "suites"):
        package = tmp_path / "work" / name
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("raise RuntimeError('the wrong package')", encoding="utf-8")
    return tmp_path / "work"


@pytest.fixture
def plug_in(tmp_path: Path) -> Path:
    """What pip leaves of a package that registers a method and a suite."""
    site = tmp_path / "site"
    metadata = site / "somebody-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: somebody\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(
        "[lfobench.methods]\ndrifting = somebody.theirs:Drifting\n\n[lfobench.suites]\ntiny = somebody.poles:SUITE\n",
        encoding="utf-8",
    )
    package = site / "somebody"
    package.mkdir()
    (package / "__init__.py").touch()
    here = Path(TINY).parent
    shutil.copy(TINY, package / "poles.py")
    source = (here / "helpers_engine.py").read_text(encoding="utf-8")
    head, tail = (
        source[: source.index("TINY = ")],
        source[source.index("class FakeConfig") : source.index("class Silent")],
    )
    kept = [line for line in head.splitlines() if "tiny_suite" not in line]
    (package / "theirs.py").write_text("\n".join(kept) + "\n\n\n" + tail, encoding="utf-8")
    return site


@pytest.mark.parametrize("command", [CONSOLE_SCRIPT, arguments()], ids=["script", "module"])
def test_a_folder_with_our_names_does_not_matter(command: list[str], hostile_folder: Path) -> None:
    outcome = process([*command, "ls", "methods", "--json"], cwd=hostile_folder)
    assert outcome.code == 0, outcome.err
    assert {"dilo", "bc"} <= {row["name"] for row in json.loads(outcome.out)}


@pytest.mark.slow
def test_a_plug_in_runs_in_a_pool_in_a_hostile_folder(hostile_folder: Path, plug_in: Path, shared_cache: Path) -> None:
    """Its method and suite stand beside the built-in ones; worker processes find them too."""
    env = {"PYTHONPATH": str(plug_in), "LFOBENCH_CACHE": str(shared_cache)}
    run = ("run", "--methods", "drifting,bc", "--suite", "tiny", *TASK, "--seeds", "0", "--workers", "2")
    outcome = process([*arguments(*run), "--out", "runs"], cwd=hostile_folder, env=env)
    assert outcome.code == 0, outcome
    records = RecordFolder(hostile_folder / "runs").read_all().records
    assert sorted(record.method for record in records) == ["bc", "drifting"]
    theirs = next(record for record in records if record.method == "drifting")
    assert theirs.provenance["method_package"] == {"somebody": "1.0"}
    assert set(theirs.identity["method_code"]) == {"somebody/__init__.py", "somebody/theirs.py"}
    table = process([*CONSOLE_SCRIPT, "table", "--out", "runs"], cwd=hostile_folder, env=env)
    assert table.code == 0, table.err
    assert "drifting" in table.out


@pytest.mark.parametrize("safe_path", ["", "1"], ids=["plain", "safe-path"])
def test_a_plug_in_is_listed(safe_path: str, plug_in: Path) -> None:
    """Also with PYTHONSAFEPATH, where the first entry of the path is not the current folder but the plug-in's."""
    env = {"PYTHONPATH": str(plug_in), "PYTHONSAFEPATH": safe_path}
    outcome = process(arguments("ls", "methods", "--json"), env=env)
    assert outcome.code == 0, outcome.err
    assert "drifting" in {row["name"] for row in json.loads(outcome.out)}


@pytest.mark.slow
def test_a_plug_in_that_cannot_be_imported_is_named(plug_in: Path) -> None:
    (plug_in / "somebody" / "theirs.py").write_text("import nothing_of_that_name", encoding="utf-8")
    env = {"PYTHONPATH": str(plug_in)}
    outcome = process(arguments("run", "--methods", "drifting", "--dry-run", "--protocol", "smoke"), env=env)
    assert outcome.code == 2
    assert "drifting" in outcome.err
    assert "Traceback" not in outcome.err
    for others in (("show", "dilo"), ("ls", "methods")):
        outcome = process(arguments(*others), env=env)
        assert outcome.code == 0, "a broken plug-in does not take the rest along"
        assert "dilo" in outcome.out


# --- streams that cannot be written ----------------------------------------------------------------------------------


def shell(command: str, tmp_path: Path) -> Outcome:
    """A command line with redirections; ``LFOBENCH`` in it is the command."""
    (tmp_path / "runs").mkdir(exist_ok=True)
    line = command.replace("LFOBENCH", shlex.join(arguments()))
    return process(["/bin/sh", "-c", line], cwd=tmp_path)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_the_output_is_one_line(tmp_path: Path) -> None:
    outcome = shell("LFOBENCH ls methods > /dev/full", tmp_path)
    assert_refused(outcome, "No space left on device")
    outcome = shell("LFOBENCH ls methods --json > /dev/full", tmp_path)
    assert_refused(outcome, "No space left on device")


@pytest.mark.parametrize("where", ["2> /dev/full", "2>&-"])
def test_messages_that_nobody_can_read_change_no_outcome(where: str, tmp_path: Path) -> None:
    """A log on a full disk, or a terminal that is gone, ends no command."""
    assert shell(f"LFOBENCH ls methods {where}", tmp_path).code == 0
    assert shell(f"LFOBENCH table --out nowhere {where}", tmp_path).code == 2


def test_a_terminal_of_ascii_gets_every_number(tmp_path: Path) -> None:
    outcome = shell("PYTHONIOENCODING=ascii LFOBENCH audit dilo-2024", tmp_path)
    assert outcome.code == 0, outcome.err
    assert outcome.out.isascii()
    assert "+-" in outcome.out


# --- Ctrl-C ----------------------------------------------------------------------------------------------------------


def interrupt_when(
    ready: Callable[[], bool],
    command: Sequence[str],
    *,
    everyone: bool,
    cache: Path,
    number: signal.Signals = signal.SIGINT,
) -> subprocess.CompletedProcess[str]:
    """Start a command, wait until something is seen, press Ctrl-C; a terminal sends it to the whole group."""
    with subprocess.Popen(
        command,
        env=environment({"LFOBENCH_CACHE": str(cache)}),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as running:
        while not ready():
            assert running.poll() is None, running.communicate()
            time.sleep(0.005)
        (os.killpg if everyone else os.kill)(running.pid, number)
        out, err = running.communicate(timeout=PATIENCE)
    return subprocess.CompletedProcess(list(command), running.returncode, out, err)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("workers", "number"),
    [(1, signal.SIGINT), (2, signal.SIGINT), (2, signal.SIGHUP), (1, signal.SIGTERM)],
    ids=["one-ctrl-c", "pool-ctrl-c", "pool-hangup", "one-term"],
)
def test_interrupted_and_continued(workers: int, number: signal.Signals, tmp_path: Path, shared_cache: Path) -> None:
    seeds = range(10)
    cell = smoke_cell("bc")
    jobs = [make_job(cell, [seed], tmp_path / "straight", shared_cache) for seed in seeds]
    out = tmp_path / "runs"
    command = arguments(
        "run", "--methods", "bc", "--suite", TINY, *TASK, "--seeds", "0-9", "--workers", workers, "--out", out
    )
    stopped = interrupt_when(
        lambda: any(out.rglob("*.json")), command, everyone=workers > 1, cache=shared_cache, number=number
    )
    assert stopped.returncode == 130, stopped
    assert "The same command continues" in stopped.stderr
    assert "Traceback" not in stopped.stderr
    assert "Failed" not in stopped.stderr
    read = RecordFolder(out).read_all()
    assert read.warnings == []
    assert 0 < len(read.records) < 10
    assert process(command, env={"LFOBENCH_CACHE": str(shared_cache)}).code == 0
    for job in jobs:
        finish(job)
        (expected,) = records_of(job)
        (found,) = records_of(Job(job.cell, job.seeds, out, job.cache, "cpu"))
        assert found.measured() == expected.measured()


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_an_interrupted_build_stops_and_leaves_whole_shards(workers: int, tmp_path: Path) -> None:
    suite = tmp_path / "large.py"
    source = Path(TINY).read_text(encoding="utf-8").replace("3_000", "400_000")
    suite.write_text(source, encoding="utf-8")
    cache = tmp_path / "cache"
    command = arguments(
        "data", "build", suite, "--tasks", "pole-random-expert", "--protocol", "paper", "--workers", workers
    )

    def shards() -> list[Path]:
        return list(cache.rglob("*.safetensors"))

    stopped = interrupt_when(lambda: len(shards()) > 0, command, everyone=True, cache=cache)
    assert stopped.returncode == 130, stopped
    assert "The same command continues" in stopped.stdout + stopped.stderr
    assert "Traceback" not in stopped.stderr
    assert len(shards()) < 20, "the rest of the 41 shards is left for the next command"
    assert list(cache.rglob(f"*{TEMPORARY_SUFFIX}")) == []


# --- two commands at once --------------------------------------------------------------------------------------------


def at_once(command: Sequence[str], cache: Path) -> list[Outcome]:
    """The same command twice, side by side."""
    running = [
        subprocess.Popen(
            command,
            env=environment({"LFOBENCH_CACHE": str(cache)}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    ended = [each.communicate(timeout=PATIENCE) for each in running]
    return [Outcome(each.returncode, out, err) for each, (out, err) in zip(running, ended, strict=True)]


@pytest.mark.slow
def test_two_commands_on_one_folder_train_nothing_twice(tmp_path: Path, shared_cache: Path) -> None:
    """Both end when everything is there; each run is reported by whoever trained it."""
    out, seeds = tmp_path / "runs", range(6)
    make_job(smoke_cell("bc"), [0], out, shared_cache)
    command = arguments("run", "--methods", "bc", "--suite", TINY, *TASK, "--seeds", "0-5", "--workers", 1)
    outcomes = at_once([*command, "--out", str(out)], shared_cache)
    assert [outcome.code for outcome in outcomes] == [0, 0], outcomes
    said = "".join(outcome.err for outcome in outcomes)
    assert [said.count(f"seed {seed}: score") for seed in seeds] == [1] * len(seeds), said
    read = RecordFolder(out).read_all()
    assert sorted(record.seed for record in read.records) == list(seeds)
    assert read.warnings == []
    assert list((out / "checkpoints").iterdir()) == []


@pytest.mark.slow
def test_two_commands_may_build_the_same_data(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    command = arguments("data", "build", TINY, *TASK, "--workers", 2)
    outcomes = at_once(command, cache)
    assert [outcome.code for outcome in outcomes] == [0, 0], outcomes
    assert list(cache.rglob(f"*{TEMPORARY_SUFFIX}")) == []
    assert process(command, env={"LFOBENCH_CACHE": str(cache)}).out.startswith("Nothing to build")
