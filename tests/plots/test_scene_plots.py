"""Pictures from above: what is drawn where, told apart even in grey, and described by the caption."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers_records import make_cell
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.quiver import Quiver
from matplotlib.text import Text

from lfobench.contract.suite import Disc, Scene
from lfobench.plots.figure import WIDTHS
from lfobench.plots.paths import Demonstrated, Field, Hit, RolledOut, field, field_points, hitting, paths
from lfobench.plots.scene import Points, outcome_looks
from lfobench.tables.building import build_table

SCENE = Scene(
    x=(0.0, 1.93),
    y=(-0.38, 0.38),
    downhill=-1,
    workspace=((0.25, 0.95), (-0.3, 0.3)),
    discs=(Disc("cup", "obstacle", (0.6, 0.0), 0.04), Disc("bowl", "goal", (0.84, 0.2), 0.07)),
    stride=(0.26, 0.13),
    effector_radius=0.03,
)
PUCKS = replace(SCENE, discs=(), effector_radius=0.0475, puck_radius=0.0315)
TABLE = build_table(make_cell([10.0], "dilo") + make_cell([20.0], "bc"))


@dataclass(frozen=True)
class Episode:
    """As the engine traces one."""

    start: int
    step_seconds: float
    effector: Points
    puck: Points | None
    outcome: str


def episode(outcome: str, steps: int = 20, start: int = 0, puck: bool = False) -> Episode:
    along = np.linspace(0.3, 0.8, steps + 1)
    across = 0.2 * np.sin(7.0 * along + start)
    slid = np.stack([1.8 - 1.2 * np.linspace(0.0, 1.0, steps + 1) ** 2, np.full(steps + 1, 0.1)], 1)
    return Episode(start, 0.05, np.stack([along, across], 1), slid if puck else None, outcome)


def rolled_out(title: str, outcomes: Sequence[str], scene: Scene = SCENE) -> RolledOut:
    pucks = scene.puck_radius is not None
    return RolledOut("hitting", title, scene, [episode(each, 20 + k, k, pucks) for k, each in enumerate(outcomes)])


def panels_of(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_title(loc="left")]


def assert_all_text_inside(figure: Figure) -> None:
    width, height = figure.get_size_inches() * figure.dpi
    for text in figure.findobj(Text):
        if text.get_text() and text.get_visible():
            box = text.get_window_extent()
            assert box.x0 > -2.0 and box.x1 < width + 2.0 and box.y0 > -2.0 and box.y1 < height + 2.0, text


@pytest.mark.parametrize("width", WIDTHS.values())
def test_paths_show_demonstrations_and_every_episode_by_how_it_ended(width: float) -> None:
    paths_shown = [episode("", 15, k).effector for k in range(5)]
    methods = [rolled_out("dilo", ["success"] * 3 + ["cup hit"]), rolled_out("bc", ["stalled", "cup hit"])]
    figure = paths([Demonstrated("hitting", "demonstrations", SCENE, paths_shown), *methods], TABLE, width)
    shown = panels_of(figure)
    assert [axes.get_title(loc="left") for axes in shown] == ["demonstrations", "dilo: 3/4", "bc: 0/2"]
    (lines,) = shown[0].findobj(LineCollection)
    assert len(lines.get_segments()) == 5
    for axes, panel in zip(shown[1:], methods, strict=True):
        ways = [line for line in axes.findobj(Line2D) if len(np.asarray(line.get_xdata())) > 3]
        for way, each in zip(ways, panel.episodes, strict=True):
            np.testing.assert_array_equal(way.get_xydata(), each.effector)
        assert axes.get_aspect() == 1.0
    assert "dilo: 3 success, 1 cup hit. bc: 1 stalled, 1 cup hit." in figure.caption
    assert "seed 0" in figure.caption
    assert_all_text_inside(figure)


def test_cups_and_bowl_are_drawn_to_scale_with_the_reach_of_the_effector_around_what_it_must_avoid() -> None:
    figure = paths([rolled_out("dilo", ["success"])], TABLE)
    (axes,) = panels_of(figure)
    circles = {(circle.center, round(circle.radius, 6)) for circle in axes.findobj(Circle)}
    assert {((0.6, 0.0), 0.04), ((0.6, 0.0), 0.07), ((0.84, 0.2), 0.07)} <= circles
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["success", "cup", "bowl", "downhill"]


def test_a_puck_is_drawn_where_it_ended() -> None:
    panel = rolled_out("dilo", ["missed", "success"], PUCKS)
    (axes,) = panels_of(paths([panel], TABLE))
    rings = {tuple(circle.center) for circle in axes.findobj(Circle) if circle.radius == PUCKS.puck_radius}
    assert rings == {tuple(each.puck[-1]) for each in panel.episodes if each.puck is not None}


def test_outcomes_are_told_apart_by_colour_and_in_grey_and_keep_their_looks() -> None:
    names = ["cup hit", "emergency stop", "missed", "out of time", "stalled", "touched only", "success"]
    looks = outcome_looks(names)
    assert len({(look.marker, look.line) for look in looks.values()}) == len(names)
    assert sum(look.colour == looks["success"].colour for look in looks.values()) == 1
    assert outcome_looks(reversed(names)) == looks
    (axes,) = panels_of(paths([rolled_out("dilo", ["stalled"])], TABLE, outcomes=names))
    assert looks["stalled"].colour in {to_hex(str(line.get_color())).upper() for line in axes.findobj(Line2D)}


def test_demonstrations_too_many_to_see_are_cut_and_the_caption_says_so() -> None:
    paths_shown = [episode("", 200, k).effector for k in range(60)]
    figure = paths([Demonstrated("hitting", "demonstrations", SCENE, paths_shown)], TABLE)
    (lines,) = panels_of(figure)[0].findobj(LineCollection)
    drawn = len(lines.get_segments())
    assert 0 < drawn < 60
    assert f"the first {drawn} of 60" in figure.caption


def test_a_field_is_dark_where_nothing_is_commanded() -> None:
    points = field_points(SCENE)
    assert points[..., 0].min() == 0.25 and points[..., 0].max() == pytest.approx(0.95)
    motions = np.array([0.84, 0.2]) - points
    dead = np.linalg.norm(points - [0.4, -0.1], axis=-1) < 0.1
    motions[dead] = 0.0
    figure = field(
        [Field("safe", "dilo", SCENE, motions), Field("safe", "bc", SCENE, 0.5 * motions)], TABLE, WIDTHS["page"]
    )
    first, second = panels_of(figure)
    grounds = [axes.findobj(QuadMesh)[0] for axes in (first, second)]
    shades = [np.asarray(ground.cmap(ground.norm(ground.get_array())))[..., :3].mean(-1) for ground in grounds]
    assert shades[0].reshape(dead.shape)[dead].max() < 0.35
    assert shades[0].mean() > shades[1].mean()
    arrows = [axes.findobj(Quiver)[0] for axes in (first, second)]
    assert arrows[0].scale == arrows[1].scale
    lengths = [np.hypot(arrow.U, arrow.V) for arrow in arrows]
    np.testing.assert_allclose(lengths[1], 0.5 * lengths[0])
    places = np.stack([arrows[0].X, arrows[0].Y], axis=-1)
    still = np.linalg.norm(places - [0.4, -0.1], axis=-1) < 0.1
    assert (lengths[0][still.ravel()] == 0.0).all() and still.any()
    assert_all_text_inside(figure)


def test_a_field_that_vanishes_everywhere_can_be_drawn() -> None:
    assert field([Field("safe", "dilo", SCENE, np.zeros_like(field_points(SCENE)))], TABLE).image("png")


@pytest.mark.parametrize("width", WIDTHS.values())
def test_a_hit_is_shaded_by_seconds_and_drawn_to_scale(width: float) -> None:
    hit = episode("success", 40, puck=True)
    figure = hitting(
        [Hit("hitting", "dilo", PUCKS, hit), Hit("hitting", "bc", PUCKS, episode("missed", 30, puck=True))],
        TABLE,
        width,
    )
    shown = panels_of(figure)
    assert [axes.get_title(loc="left") for axes in shown] == ["dilo: success", "bc: missed"]
    (bar,) = [axes for axes in figure.axes if axes.get_ylabel() == "time (s)"]
    assert bar.get_ylim() == (0.0, pytest.approx(2.0))
    puck = [circle for circle in shown[0].findobj(Circle) if circle.radius == PUCKS.puck_radius]
    paddle = [circle for circle in shown[0].findobj(Circle) if circle.radius == PUCKS.effector_radius]
    assert len(puck) == len(paddle) >= 5
    assert hit.puck is not None
    assert puck[0].center == tuple(hit.puck[0]) and puck[-1].center == tuple(hit.puck[-1])
    assert len({circle.get_facecolor() for circle in puck}) == len(puck)
    way = shown[0].findobj(LineCollection)[0]
    assert np.asarray(way.get_array())[-1] == pytest.approx(2.0)
    assert_all_text_inside(figure)


def test_equal_episodes_give_equal_bytes_and_the_caption_lies_in_the_file() -> None:
    one, two = (paths([rolled_out("dilo", ["success", "stalled"])], TABLE) for _ in range(2))
    for name in ("png", "svg", "pdf"):
        assert one.image(name) == two.image(name)
    assert b"Paths of the end-effector from above" in one.image("svg")


def test_every_task_begins_a_row_and_long_names_stay_inside() -> None:
    method = rolled_out("smodice(discriminator_passes=5)", ["out of time"])
    tasks = ["safe-manipulation-cross-embodiment-few-trajectories"] * 3 + ["puck-striking-20-expert"] * 2
    figure = paths([replace(method, task=task) for task in tasks], TABLE, WIDTHS["page"])
    assert_all_text_inside(figure)
    shown = panels_of(figure)
    places = [axes.get_position() for axes in shown]
    assert len({round(place.y0, 3) for place in places}) == 2
    assert places[3].x0 == pytest.approx(places[0].x0)
    assert "puck-striking-20-expert smodice(discriminator_passes=5): 1 out of time" in figure.caption
