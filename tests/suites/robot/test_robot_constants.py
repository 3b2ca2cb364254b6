"""Every number of the simulated robot has a unit and an origin, and the paper's are the paper's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from suites.robot import constants, tasks
from suites.robot.constants import Constant
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW

NAMED = {name: value for name, value in vars(constants).items() if name.isupper()}


def numbers(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple):
        for part in value:
            yield from numbers(part)
    else:
        yield value


@pytest.mark.parametrize("name", NAMED)
def test_every_constant_says_its_unit_origin_and_reason(name: str) -> None:
    for number in numbers(NAMED[name]):
        assert isinstance(number, Constant)
        assert number.unit and number.why
        assert number.origin in ("paper", "ours")


def test_the_papers_numbers() -> None:
    given = {
        "TABLE_LENGTH": (1.93, "m"),
        "TABLE_WIDTH": (0.76, "m"),
        "TABLE_TILT": (5.5, "degree"),
        "PUCK_DIAMETER": (0.063, "m"),
        "PADDLE_DIAMETER": (0.095, "m"),
        "CONTROL_RATE": (20, "Hz"),
        "CAMERA_RATE": (60, "Hz"),
        "CLIP_X": (0.26, "m"),
        "CLIP_Y": (0.13, "m"),
        "STRIKING_START_X": (0.38, "m"),
        "HITTING_START_X": (0.68, "m"),
        "RELATIVE_POSITIONS": (5, "1"),
    }
    marked = {name for name, value in NAMED.items() if any(number.origin == "paper" for number in numbers(value))}
    assert marked == set(given)
    assert {name: (float(NAMED[name]), NAMED[name].unit) for name in given} == given


def test_times_are_whole_substeps_frames_and_steps() -> None:
    assert constants.PHYSICS_RATE % constants.CAMERA_RATE == 0
    assert constants.PHYSICS_RATE % constants.CONTROL_RATE == 0
    for seconds in (constants.GOAL_REST_TIME, constants.STALL_TIME):
        assert float(seconds * constants.CONTROL_RATE).is_integer()


def test_the_layout_leaves_gates_and_blocks_straight_ways() -> None:
    gates = [
        np.linalg.norm(first - second) - 2 * tasks.CUP_REACH
        for index, first in enumerate(tasks.CUPS)
        for second in tasks.CUPS[index + 1 :]
    ]
    assert min(gates) > 0.08
    assert np.linalg.norm(tasks.CUPS - tasks.BOWL, axis=1).min() - tasks.CUP_REACH > constants.BOWL_RADIUS + 0.08

    generator = np.random.default_rng(0)
    starts = np.array([tasks.SafeManipulation().start(generator).effector for _ in range(500)])
    assert (starts >= WORKSPACE_LOW).all() and (starts <= WORKSPACE_HIGH).all()
    share = np.linspace(0.0, 1.0, 200)[:, None]
    corner = np.array([constants.CORNER_X, constants.CORNER_Y])
    crossed = [tasks.cups_met((start + share * (tasks.BOWL - start))[None])[0] for start in (*starts, corner)]
    assert 0.35 < np.mean(crossed) < 0.7
    assert crossed[-1]
