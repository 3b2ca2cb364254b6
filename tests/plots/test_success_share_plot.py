"""Scores against the share of successes in the offline data."""

from __future__ import annotations

import pytest
from helpers_records import endings, make_counted

from lfobench.errors import UserError
from lfobench.plots.figure import PaperFigure
from lfobench.plots.kinds import draw
from lfobench.record import Record
from lfobench.tables.building import build_table
from lfobench.tables.counting import knobs

RECIPE = {
    "offline_trajectories": 50,
    "expert": "expert",
    "expert_trajectories": 15,
    "expert_transitions": None,
    "expert_actions": True,
    "equal_transitions": True,
}
LEVELS = {0.0: "failing", 0.5: "half-successful", 1.0: "successful"}


def cell(share: float, successes: int, method: str = "dilo", row: str = "striking") -> list[Record]:
    """Two seeds with one success more and one less than `successes` of 50."""
    level = LEVELS[share]
    return [
        make_counted(
            endings(successes + seed, 50),
            (),
            method,
            abs(seed),
            row=row,
            group=f"20-expert-{level}",
            recipe={**RECIPE, "offline": level, "success_share": share},
        ).model_copy()
        for seed in (-1, 0)
    ]


def figure(records: list[Record]) -> PaperFigure:
    return draw("share", build_table(records, *knobs(records)), records)


def test_a_line_per_method_over_the_shares_and_a_panel_per_task() -> None:
    records = [
        *cell(0.0, 10),
        *cell(1.0, 40),
        *cell(0.5, 20),
        *cell(0.0, 5, "bc"),
        *cell(1.0, 30, "bc"),
        *cell(0.0, 1, row="hitting"),
        *cell(0.5, 2, row="hitting"),
    ]
    drawn = figure(records)
    titles = [" ".join(axes.get_title(loc="left").split()) for axes in drawn.axes]
    assert titles == ["striking-20-expert", "hitting-20-expert"]
    found = {
        tuple((round(float(x), 6), round(float(y), 6)) for x, y in line.get_xydata())  # type: ignore[union-attr]
        for line in drawn.axes[0].get_lines()
        if len(line.get_xydata()) > 1 and line.get_marker() not in ("", "None")
    }
    assert ((0.0, 19.0), (50.0, 39.0), (100.0, 79.0)) in found
    assert ((0.0, 9.0), (100.0, 59.0)) in found
    assert "t-intervals" in drawn.caption


def test_one_share_alone_is_no_curve() -> None:
    with pytest.raises(UserError, match="airhockey-share"):
        figure(cell(0.5, 20))
