"""The measured table of the robot's scripted demonstrators."""

from __future__ import annotations

import re

import pytest

from lfobench.stats.successes import wilson_interval
from suites.robot.demonstrators import demonstrators
from tools import airhockey_measure as measure


def test_the_measured_table_has_a_line_per_demonstrator(monkeypatch: pytest.MonkeyPatch) -> None:
    known = demonstrators()["puck-striking"]
    monkeypatch.setattr(measure, "demonstrators", lambda: {"puck-striking": known})
    heading, *lines = measure.lines(20, 0)
    assert "success" in heading
    assert [line.split()[:3] for line in lines] == [["puck-striking", level, "20"] for level in known]
    assert "no end" in next(line for line in lines if "suboptimal" in line)


def test_the_interval_is_wilsons(monkeypatch: pytest.MonkeyPatch) -> None:
    known = demonstrators()["puck-striking"]
    few = {level: known[level] for level in ("expert", "suboptimal", "half-successful")}
    monkeypatch.setattr(measure, "demonstrators", lambda: {"puck-striking": few})
    for line in list(measure.lines(20, 0))[1:]:
        found = re.match(r"\S+ +\S+ +20 +(\S+) +(\S+) to (\S+) ", line)
        assert found is not None
        rate, *bounds = (float(text) / 100 for text in found.groups())
        interval = wilson_interval(round(20 * rate), 20)
        assert bounds == pytest.approx([interval.low, interval.high], abs=5.1e-4)
