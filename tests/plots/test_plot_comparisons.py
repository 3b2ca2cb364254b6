"""Profiles, probabilities of improvement and ranks: over the tasks that all methods share."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_records import make_cell
from matplotlib.text import Text

from lfobench.errors import UserError
from lfobench.plots.captions import compare
from lfobench.plots.comparisons import MAP, improvement, profiles, ranking
from lfobench.plots.figure import PaperFigure
from lfobench.record import Record
from lfobench.stats.aggregates import probability_of_improvement
from lfobench.tables.building import build_table

ROWS = ("hopper", "ant", "walker2d", "halfcheetah")


def ordered(methods: int, tasks: int = 4) -> list[Record]:
    """Methods m0, m1, … of which each beats the next on every task, with every seed."""
    return [
        record
        for task in range(tasks)
        for method in range(methods)
        for record in make_cell(
            [90.0 - 10.0 * method, 91.0 - 10.0 * method, 92.0 - 10.0 * method], f"m{method}", row=ROWS[task]
        )
    ]


def texts(figure: PaperFigure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def test_tasks_without_a_score_of_every_method_are_left_out_and_named(example: list[Record]) -> None:
    compared = compare(build_table(example))
    assert compared.left_out == ("halfcheetah-random-few-expert",)
    assert len(compared.tasks) == 3
    for plot in (profiles, ranking):
        assert "without halfcheetah-random-few-expert" in plot(build_table(example)).caption


def test_methods_without_a_common_task_are_refused() -> None:
    table = build_table([*make_cell([1.0, 2.0], "a", row="hopper"), *make_cell([1.0, 2.0], "b", row="ant")])
    for plot in (profiles, ranking, improvement):
        with pytest.raises(UserError, match="On no task do all of a, b have a score"):
            plot(table)


def test_a_profile_is_the_fraction_of_runs_above_a_score() -> None:
    records = make_cell([10.0, 20.0, 30.0, 40.0])
    axes = profiles(build_table(records)).axes[0]
    line = next(each for each in axes.lines if len(each.get_xdata()) == 6)
    assert list(line.get_xdata())[1:-1] == [10.0, 20.0, 30.0, 40.0]
    assert list(line.get_ydata()) == pytest.approx([1.0, 0.75, 0.5, 0.25, 0.0, 0.0])
    assert line.get_drawstyle() == "steps-post"
    assert len(axes.collections) == 1


def test_one_seed_per_task_has_a_profile_without_a_band() -> None:
    figure = profiles(build_table(make_cell([50.0])))
    assert len(figure.axes[0].collections) == 0
    assert "no bands" in figure.caption


def test_cells_of_the_matrix_hold_the_probability_and_its_interval() -> None:
    first, second = [1.0, 2.0, 3.0, 4.0], [0.0, 0.5, 1.0, 2.5]
    texts = improvement(build_table(make_cell(first, "dilo") + make_cell(second, "oril"))).axes[0].texts
    ends = probability_of_improvement([first], [second]).interval
    assert ends is not None
    low, high = round(100 * ends.low), round(100 * ends.high)
    # 13 of 16 pairs are won and one is tied.
    assert [text.get_text() for text in texts] == ["84", f"{low}–{high}", "16", f"{100 - high}–{100 - low}"]
    assert {text.get_fontweight() for text in texts} == {"normal"}


def test_a_clean_separation_has_no_interval_of_no_width() -> None:
    figure = improvement(build_table(ordered(2)))
    assert [text.get_text() for text in figure.axes[0].texts] == ["100", "0"]
    assert "shows no spread" in figure.caption


def test_mirrored_cells_add_up_to_one_and_what_is_undecided_is_not_bold() -> None:
    records = [*make_cell([10.0, 20.0, 33.0, 47.0], "a"), *make_cell([15.0, 18.0, 30.0, 50.0], "b")]
    above, _, below, _ = improvement(build_table(records)).axes[0].texts
    assert int(above.get_text()) + int(below.get_text()) == 100
    assert above.get_fontweight() == below.get_fontweight() == "normal"


def test_one_seed_gives_a_probability_without_an_interval() -> None:
    records = [*make_cell([10.0], "a"), *make_cell([15.0], "b")]
    figure = improvement(build_table(records))
    assert [text.get_text() for text in figure.axes[0].texts] == ["0", "100"]
    assert "no intervals" in figure.caption


def test_one_method_has_nobody_to_improve_on() -> None:
    with pytest.raises(UserError, match="needs two methods"):
        improvement(build_table(make_cell([1.0, 2.0])))


def test_black_text_is_readable_on_the_whole_map_in_colour_and_in_grey() -> None:
    """Contrast of at least 4.5, as WCAG 2.2 asks of small text; the middle is the lightest, the ends differ in grey."""
    colours = np.asarray(MAP(np.linspace(0.0, 1.0, 101)))[:, :3]
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    assert ((luminance + 0.05) / 0.05).min() >= 4.5
    assert abs(int(luminance.argmax()) - 50) <= 1
    assert luminance[0] > 1.5 * luminance[-1]


def test_ranks_are_written_beside_the_methods_best_first() -> None:
    figure = ranking(build_table(ordered(4)))
    shown = [text for text in texts(figure) if text.startswith("m")]
    assert shown == ["m0  1.00", "m1  2.00", "m2  3.00", "m3  4.00"]
    # q(0.05; 4) = 2.569 (Demšar 2006, table 5a); 2.569 · √(4 · 5 / (6 · 4)).
    assert "critical difference 2.35" in texts(figure)


def test_bars_join_what_is_not_told_apart() -> None:
    figure = ranking(build_table(ordered(4)))
    bars = [line for line in figure.axes[0].lines if line.get_linewidth() == 2.5]
    assert len(bars) == 2
    assert "not rejected" not in figure.caption


def test_every_tied_method_keeps_a_marker_of_its_own() -> None:
    records = [record for row in ROWS for name in "abc" for record in make_cell([50.0, 51.0], name, row=row)]
    figure = ranking(build_table(records))
    places = {
        (float(line.get_xdata()[0]), float(line.get_ydata()[0]))
        for line in figure.axes[0].lines
        if line.get_marker() not in (None, "None", "")
    }
    assert len(places) == 3
    assert "not rejected" in figure.caption


@pytest.mark.parametrize(("methods", "tasks"), [(2, 4), (3, 1)])
def test_a_ranking_of_too_little_is_refused(methods: int, tasks: int) -> None:
    with pytest.raises(UserError, match=rf"needs 2 tasks and 3 methods .* here are {tasks} and {methods}"):
        ranking(build_table(ordered(methods, tasks)))
