"""`python -m benchmarks`: what it prints and writes, and what it refuses. No figure is asserted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers_cli import InProcess

import benchmarks.__main__
from benchmarks.pairs import TARGETS, Finding, Spread
from benchmarks.speed import SECTIONS


@pytest.fixture
def bench_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> InProcess:
    return InProcess(monkeypatch, capsys, benchmarks.__main__.main)


@pytest.mark.slow
def test_quick_measures_every_target_or_says_why_not(bench_command: InProcess, tmp_path: Path) -> None:
    outcome = bench_command("--quick", "--device", "cpu", "--json", "--out", tmp_path / "bench")
    assert outcome.code == 0
    raw = json.loads(outcome.out)
    assert [target["measure"] for target in raw["targets"]] == [target.measure for target in TARGETS.values()]
    for target in raw["targets"]:
        assert (target["value"] is None) == (target["verdict"] == "unmeasured")
        assert target["value"] is not None or target["why_not"]
        if target["measure"].startswith("GPU"):
            assert target["value"] is None, "nothing but a run on a GPU fills a GPU's figure"
    assert {step["workload"] for step in raw["steps"]} == {
        "dilo",
        "smodice",
        "oril",
        "bco",
        "bco inverse dynamics",
        "bc",
    }
    assert raw["cell"]["seconds"].keys() == {"load", "train", "evaluate", "write and rest"}
    assert raw["cell"]["warnings"] == []
    assert not (tmp_path / "bench").exists(), "figures that mean nothing are not kept"
    assert [line for line in outcome.err.splitlines() if line] == [f"measuring: {name}" for name in SECTIONS]


def test_one_section_is_kept_in_a_file_of_the_machine(
    bench_command: InProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.speed.Speed.rounds", 1)
    monkeypatch.setattr("benchmarks.built_task.SHARD_TRANSITIONS", 1000)
    monkeypatch.setattr("lfobench.cells.parts.PartSpecification.shards_for", lambda part, transitions: 3)
    outcome = bench_command("--only", "loading", "--device", "cpu", "--out", tmp_path)
    assert outcome.code == 0, outcome.err
    (path,) = tmp_path.glob("*.json")
    raw = json.loads(path.read_text())
    assert path.stem == raw["hardware"]["slug"]
    assert raw["loading"]["dilo"]["seconds"]["median"] > 0.0
    assert "not asked for" in outcome.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "stpes"], "Unknown section 'stpes'. Did you mean 'steps'?"),
        (["--device", "tpu"], "Unknown device 'tpu'."),
    ],
)
def test_refusals(arguments: list[str], message: str, bench_command: InProcess) -> None:
    outcome = bench_command(*arguments)
    assert outcome.code == 2
    assert message in " ".join(outcome.err.split())


@pytest.mark.parametrize(
    ("key", "median", "verdict"),
    [
        ("cpu authors", 1.9, "missed"),
        ("cpu authors", 2.0, "must"),
        ("cpu authors", 3.0, "aim"),
        ("cpu floor", 1.5, "missed"),
        ("cpu floor", 1.4, "must"),
        ("cpu floor", 1.1, "aim"),
    ],
)
def test_verdicts_follow_the_median(key: str, median: float, verdict: str) -> None:
    assert Finding(TARGETS[key], Spread(0.1, median, 10.0)).verdict == verdict
