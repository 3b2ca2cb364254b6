"""The picture of a file's episodes: named, how each ended, and the horizon."""

from __future__ import annotations

from dataclasses import replace

from matplotlib.axes import Axes

from lfobench.analyses.diagnosis import summary
from lfobench.data.doctor import Diagnosis
from lfobench.plots.episodes import episodes
from lfobench.plots.figure import SMALL_SIZE, PaperFigure

FOUND = Diagnosis(
    format="d4rl",
    observation=1,
    action=3,
    lengths=(9, 4, 9),
    returns=(1.0, 0.5, 2.0),
    terminations=(False, True, False),
    timeouts=True,
    horizon=9,
    findings=(),
    modes=(),
)


def labels(figure: PaperFigure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def marks(axes: Axes, label: str) -> list[tuple[float, float]]:
    (found,) = (line for line in axes.lines if line.get_label() == label)
    return [(float(x), float(y)) for x, y in found.get_xydata()]


def test_how_episodes_ended_is_told_apart_and_the_horizon_drawn() -> None:
    figure = episodes(FOUND, "file.hdf5", 3.3)
    steps, returns = figure.axes
    assert labels(figure) == ["cut by time", "terminated", "horizon"]
    assert marks(steps, "cut by time") == [(0, 9), (2, 9)]
    assert marks(returns, "terminated") == [(1, 0.5)]
    assert {y for _, y in marks(steps, "horizon")} == {9}
    colours = {line.get_color() for line in steps.lines}
    assert len(colours) == 3
    assert not any(line.get_clip_on() for line in steps.lines if line.get_label() != "horizon"), "9 is the upper edge"


def test_the_file_is_named_and_described_above() -> None:
    figure = episodes(FOUND, "file_" + "n" * 300 + ".hdf5", 3.3)
    title, told = figure.texts
    assert title.get_text().startswith("file_nnn") and title.get_text().endswith("…")
    assert " ".join(told.get_text().split()) == summary(FOUND)
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in figure.texts]
    highest = max(axes.get_tightbbox().y1 for axes in figure.axes)
    assert figure.bbox.y1 >= boxes[0].y1 and boxes[0].y0 >= boxes[1].y1 and boxes[1].y0 >= highest
    assert all(box.x1 <= figure.bbox.x1 for box in boxes)
    assert told.get_fontsize() == SMALL_SIZE


def test_episodes_are_counted_in_whole_numbers() -> None:
    ticks = episodes(FOUND, "file.hdf5", 3.3).axes[-1].get_xticks()
    assert [tick for tick in ticks if tick % 1] == []


def test_nothing_is_drawn_that_is_not_known() -> None:
    unknown = replace(FOUND, returns=(), terminations=(False,) * 3, timeouts=False, horizon=None)
    figure = episodes(unknown, "file.hdf5", 3.3)
    assert (len(figure.axes), labels(figure)) == (1, ["not terminated"])


def test_a_summary_counts_one_as_one() -> None:
    one = replace(FOUND, lengths=(1,), returns=(0.5,), terminations=(True,))
    assert summary(one) == (
        "d4rl layout, 1 transition in 1 episode of 1 step (1 terminated, 0 cut by time); 1 observation, 3 actions; "
        "return 0.5"
    )
