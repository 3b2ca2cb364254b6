"""Training metrics: every number is drawn where it belongs, what cannot be drawn is said."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from helpers_records import make_record
from matplotlib.axes import Axes

from lfobench.errors import UserError
from lfobench.plots.figure import PaperFigure
from lfobench.plots.kinds import draw
from lfobench.plots.metrics import MOST_PANELS
from lfobench.record import Metrics, Record
from lfobench.tables.building import build_table


def trained(
    rows: Mapping[int, Mapping[str, float | None]], method: str = "dilo", seed: int = 0, row: str = "hopper"
) -> Record:
    """A record with these metrics of stage ``train`` by update."""
    found = [Metrics(stage="train", step=step, values=dict(values)) for step, values in rows.items()]
    return make_record(50.0, method, seed, row).model_copy(update={"metrics": found})


def figure(records: list[Record], *names: str) -> PaperFigure:
    return draw("metrics", build_table(records), records, names=names)


def panel(drawn: PaperFigure, title: str) -> Axes:
    return next(each for each in drawn.axes if " ".join(each.get_title(loc="left").split()) == title)


def lines(axes: Axes) -> list[list[tuple[float, float]]]:
    return [list(map(tuple, line.get_xydata().tolist())) for line in axes.get_lines()]  # type: ignore[union-attr]


def test_a_panel_per_metric_has_the_mean_and_every_seed() -> None:
    drawn = figure(
        [
            trained({100: {"loss": 2.0, "value": -1.0}, 200: {"loss": 1.0, "value": 0.0}}),
            trained({100: {"loss": 4.0, "value": -3.0}, 200: {"loss": 3.0, "value": None}}, seed=1),
        ]
    )
    assert lines(panel(drawn, "loss")) == [
        [(100.0, 3.0), (200.0, 2.0)],
        [(100.0, 2.0), (200.0, 1.0)],
        [(100.0, 4.0), (200.0, 3.0)],
    ]
    assert lines(panel(drawn, "value"))[0] == [(100.0, -2.0), (200.0, 0.0)]
    assert "Left out: 1 values" in drawn.caption


def test_chosen_metrics_of_all_methods_and_tasks() -> None:
    records = [
        trained({100: {"loss": 2.0, "other": 1.0}}, method, row=row) for method in "ab" for row in ("hopper", "ant")
    ]
    drawn = figure(records, "loss")
    assert len(drawn.axes) == 2
    assert [len(lines(axes)) for axes in drawn.axes] == [2, 2]
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["a", "b"]


def test_stages_have_panels_of_their_own() -> None:
    first = trained({100: {"loss": 2.0}})
    record = first.model_copy(update={"metrics": [*first.metrics, Metrics(stage="fit", step=10, values={"loss": 5.0})]})
    drawn = figure([record])
    assert lines(panel(drawn, "loss (fit)")) == [[(10.0, 5.0)]]
    assert lines(panel(drawn, "loss (train)")) == [[(100.0, 2.0)]]


def test_enormous_values_are_left_out_and_wide_ranges_have_powers() -> None:
    drawn = figure([trained({1: {"loss": 1e-3}, 2: {"loss": 1e3}, 3: {"loss": 1.7e308}})])
    (axes,) = drawn.axes
    assert axes.get_yscale() == "log"
    assert lines(axes) == [[(1.0, 1e-3), (2.0, 1e3)]]
    assert "Left out: 1 values" in drawn.caption


@pytest.mark.parametrize(
    ("records", "names", "words"),
    [
        ([make_record(1.0)], (), "no training metrics"),
        ([trained({1: {"loss": 1.0}})], ("los",), "Did you mean 'loss'"),
        ([trained({1: {"loss": None}})], (), "ever a number that can be drawn"),
        ([trained({1: {f"m{index}": 1.0 for index in range(MOST_PANELS + 1)}})], (), "--metric"),
    ],
    ids=["none", "misspelt", "never finite", "too many"],
)
def test_what_cannot_be_drawn_is_one_line(records: list[Record], names: tuple[str, ...], words: str) -> None:
    with pytest.raises(UserError, match=words):
        figure(records, *names)


def test_metrics_are_chosen_for_their_own_kind_alone() -> None:
    record = trained({1: {"loss": 1.0}})
    with pytest.raises(UserError, match="--metric"):
        draw("scores", build_table([record]), [record], names=["loss"])
