"""Alternation: who runs when, and what the numbers are."""

from __future__ import annotations

import json

import pytest

from benchmarks import pairs
from benchmarks.pairs import Alternation, Contender, Spread, Timing, alternate


def test_blocks_alternate_after_the_warm_up() -> None:
    seen: list[str] = []
    contenders = [Contender("a", lambda: seen.append("a")), Contender("b", lambda: seen.append("b"))]
    found = alternate(contenders, rounds=2, calls=3, warm_up=1)
    assert "".join(seen) == "ab" + "aaabbb" * 2
    assert [len(timing.seconds) for timing in found.timings.values()] == [2, 2]


def test_a_block_is_whole_periods() -> None:
    seen: list[str] = []
    found = alternate([Contender("delayed", lambda: seen.append("x"), period=2)], rounds=1, calls=3, warm_up=1)
    assert len(seen) == 2 + 4
    assert found.timings["delayed"].calls == 4


def test_seconds_are_per_call(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = 0.0

    def slow() -> None:
        nonlocal clock
        clock += 3.0

    def fast() -> None:
        nonlocal clock
        clock += 0.5

    monkeypatch.setattr(pairs.time, "perf_counter", lambda: clock)
    found = alternate([Contender("slow", slow), Contender("fast", fast)], rounds=3, block_seconds=6.0)
    assert found.timings["slow"].seconds == (3.0, 3.0, 3.0)
    assert (found.timings["slow"].calls, found.timings["fast"].calls) == (2, 12)
    assert found.ratio("slow", "fast") == Spread(6.0, 6.0, 6.0)


def test_ratios_are_taken_round_by_round() -> None:
    found = Alternation({"a": Timing("a", 1, (2.0, 9.0, 8.0)), "b": Timing("b", 1, (1.0, 3.0, 4.0))})
    assert found.ratio("a", "b") == Spread(2.0, 2.0, 3.0)
    assert json.loads(json.dumps(found.as_json()))[0]["rounds"] == [2.0, 9.0, 8.0]


def test_contenders_need_names_of_their_own() -> None:
    with pytest.raises(ValueError, match="names"):
        alternate([Contender("a", int), Contender("a", int)], rounds=1)
