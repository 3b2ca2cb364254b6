"""Scores and learning curves: every seed is there, and what was cut, diverged or failed is said."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers_records import make_cell, make_record
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from lfobench.plots.comparisons import scores
from lfobench.plots.curves import curves
from lfobench.plots.figure import WIDTHS
from lfobench.record import Evaluation, Failure, Record
from lfobench.tables.building import build_table
from lfobench.tables.table import Table


def panel(axes: list[Axes], task: str) -> Axes:
    return next(each for each in axes if each.get_title(loc="left").replace("\n", "") == task)


def dots(axes: Axes) -> list[tuple[float, float]]:
    """(score, line) of every dot and cross of a panel."""
    collections = [each for each in axes.collections if isinstance(each, PathCollection)]
    return [(float(x), round(float(y))) for each in collections for x, y in np.asarray(each.get_offsets())]


def labels(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_yticklabels()]


def failure_of(record: Record) -> Failure:
    return Failure(
        identity_hash=record.identity_hash,
        identity=record.identity,
        labels=record.labels,
        error="out of memory",
        traceback=[],
    )


# --- scores ----------------------------------------------------------------------------------------------------------


def test_every_seed_is_a_dot_at_its_score_on_its_methods_line(example: list[Record]) -> None:
    table = build_table(example)
    figure = scores(table)
    for _, row in table.rows():
        axes = panel(figure.axes, row.task)
        expected = [
            (score, line)
            for line, cell in enumerate(row.cells)
            if cell is not None and cell.sample is not None
            for score in cell.sample.seeds
        ]
        assert sorted(dots(axes)) == sorted(expected)
    assert labels(figure.axes[0]) == [column.label for column in table.columns]


def test_a_diverged_seed_is_a_cross_at_zero(example: list[Record]) -> None:
    figure = scores(build_table(example))
    axes = panel(figure.axes, "hopper-random-expert")
    crosses = [each for each in axes.collections if isinstance(each, PathCollection) and len(each.get_offsets()) == 1]
    assert [float(np.asarray(each.get_offsets())[0, 0]) for each in crosses] == [0.0]
    assert "smodice on hopper-random-expert, seed 0" in figure.caption
    assert "Without any run: oril on halfcheetah-random-few-expert" in figure.caption


def test_interval_of_one_seed_is_not_drawn_and_of_three_is() -> None:
    alone = scores(build_table(make_cell([50.0])))
    three = scores(build_table(make_cell([40.0, 50.0, 60.0])))
    spans = [
        [line for line in figure.axes[0].lines if line.get_linewidth() == 0.8 and len(line.get_xdata()) == 2]
        for figure in (alone, three)
    ]
    assert spans[0] == []
    # Student's t with two degrees of freedom: 4.303 · 10 / √3.
    assert list(spans[1][0].get_xdata()) == pytest.approx([50.0 - 24.84, 50.0 + 24.84], abs=0.01)
    assert len(dots(alone.axes[0])) == 1


def test_an_interval_beyond_the_axis_ends_in_an_arrow() -> None:
    figure = scores(build_table(make_cell([0.0, 100.0, 0.0])))
    axes = figure.axes[0]
    arrows = {str(line.get_marker()): float(line.get_xdata()[0]) for line in axes.lines if line.get_marker() in "<>"}
    assert arrows == {"<": axes.get_xlim()[0], ">": axes.get_xlim()[1]}


def test_failed_seeds_are_counted_beside_the_line() -> None:
    records = make_cell([50.0, 51.0])
    failed = [failure_of(make_record(0.0, seed=seed)) for seed in (2, 3)]
    figure = scores(build_table(records, failures=failed))
    assert [text.get_text() for text in figure.axes[0].texts] == ["!2"]
    assert "seed 2, 3" in figure.caption
    assert len(dots(figure.axes[0])) == 2


# --- curves ----------------------------------------------------------------------------------------------------------


def learning(finals: list[float], steps: int = 6, **options: Any) -> list[Record]:
    """Seeds whose score rises in equal parts to its final value."""
    return [
        record.model_copy(
            update={
                "evaluations": [
                    Evaluation(step=1000 * part, returns=[10.0 * final * part / steps] * 2, lengths=[1000] * 2)
                    for part in range(1, steps + 1)
                ]
            }
        )
        for record, final in zip(make_cell(finals, **options), finals, strict=True)
    ]


def drawn_lines(axes: Axes) -> list[list[float]]:
    return [[float(y) for y in line.get_ydata()] for line in axes.lines if len(line.get_xdata()) == 6]


def test_the_line_is_the_mean_over_seeds() -> None:
    records = learning([60.0, 90.0, 30.0])
    figure = curves(build_table(records), records)
    assert drawn_lines(figure.axes[0]) == [pytest.approx([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])]
    assert len(figure.axes[0].collections) == 1
    assert figure.get_supylabel() == "normalised score"
    assert figure.get_supxlabel() == "gradient steps"


@pytest.mark.parametrize(("finals", "lines"), [([60.0], 1), ([60.0, 90.0], 3)])
def test_few_seeds_are_lines_without_a_band(finals: list[float], lines: int) -> None:
    records = learning(finals)
    figure = curves(build_table(records), records)
    assert len(drawn_lines(figure.axes[0])) == lines
    assert len(figure.axes[0].collections) == 0


def test_a_diverged_seed_counts_as_zero_from_there_on_and_is_marked() -> None:
    records = learning([60.0, 60.0, 60.0])
    records[1] = records[1].model_copy(
        update={"status": "diverged", "diverged_at": 3500, "evaluations": records[1].evaluations[:3]}
    )
    figure = curves(build_table(records), records)
    axes = figure.axes[0]
    assert drawn_lines(axes) == [pytest.approx([10.0, 20.0, 30.0, 80.0 / 3.0, 100.0 / 3.0, 40.0])]
    crosses = [line for line in axes.lines if line.get_marker() == "X"]
    assert [(float(line.get_xdata()[0]), float(line.get_ydata()[0])) for line in crosses] == [(3500.0, 0.0)]
    assert "seed diverged" in " ".join(text.get_text() for text in figure.legends[0].get_texts())


def test_a_seed_that_diverged_before_its_first_evaluation_is_shown() -> None:
    records = make_cell([0.0], diverged_at=10, evaluations=0)
    figure = curves(build_table(records), records)
    assert "dilo on hopper-random-expert, seed 0" in figure.caption


def test_the_demonstration_is_a_line_where_it_is_known() -> None:
    records = learning([60.0, 90.0, 30.0])
    known = [record.model_copy(update={"provenance": {"demonstration_score": 97.5}}) for record in records]
    without, with_it = (curves(build_table(each), each) for each in (records, known))
    heights = [{float(line.get_ydata()[0]) for line in figure.axes[0].lines} for figure in (without, with_it)]
    assert heights[1] - heights[0] == {97.5}
    assert [text.get_text() for text in with_it.legends[0].get_texts()] == ["dilo", "demonstration"]
    assert "demonstration" not in without.caption


def test_panels_share_steps_only_where_they_agree() -> None:
    short = learning([60.0, 90.0])
    long = [
        record.model_copy(update={"evaluations": [Evaluation(step=90_000, returns=[500.0], lengths=[1000])]})
        for record in learning([60.0, 90.0], row="ant")
    ]
    figure = curves(build_table(short + long), short + long)
    assert figure.axes[0].get_xlim()[1] < 10_000 < figure.axes[1].get_xlim()[0]
    alike = short + learning([60.0, 90.0], row="ant")
    together = curves(build_table(alike), alike)
    assert together.axes[0].get_xlim() == together.axes[1].get_xlim()


@pytest.mark.parametrize("plot", [curves, lambda table, _records, width: scores(table, width)])
def test_every_task_has_a_panel_and_the_figure_its_width(
    plot: Callable[[Table, list[Record], float], Any], example: list[Record]
) -> None:
    five = example + make_cell([10.0, 20.0, 30.0], row="ant", protocol=example[0].identity["protocol"])
    width = WIDTHS["column"]
    figure = plot(build_table(five), five, width)
    assert len(figure.axes) == 5
    assert figure.get_figwidth() == width
    assert figure.get_figheight() < 9.0
