"""Spaces of environments: boxes and their scale, and one line for everything that is not supported."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lfobench.contract.environment import ActionBox, Environment
from lfobench.errors import UserError
from lfobench.python_files import load_file

OWN = load_file(Path(__file__).parents[1] / "own_folder" / "own_suite.py", "suite")
INFINITY = math.inf


def box(*bounds: tuple[float, float]) -> ActionBox:
    low, high = zip(*bounds, strict=True)
    return ActionBox(low, high)


@pytest.mark.parametrize(
    ("bounds", "action", "normalized"),
    [
        ([(-2.0, 2.0)], [2.0], [1.0]),
        ([(-2.0, 2.0)], [-1.0], [-0.5]),
        ([(0.0, 1.0), (-3.0, 1.0)], [0.25, 0.0], [-0.5, 0.5]),
        ([(-INFINITY, INFINITY)], [7.5], [7.5]),
        ([(0.0, INFINITY), (-2.0, 2.0)], [0.75, 1.0], [0.75, 0.5]),
        ([(0.5, 0.5), (-2.0, 2.0)], [0.5, 2.0], [0.0, 1.0]),
    ],
)
def test_a_box_is_scaled_where_it_has_two_bounds(
    bounds: list[tuple[float, float]], action: list[float], normalized: list[float]
) -> None:
    scale = box(*bounds)
    assert scale.normalized(np.array([action], np.float32)).tolist() == [normalized]
    assert scale.in_units(np.array([normalized], np.float32)).tolist() == [action]
    assert ActionBox.from_identity(scale.identity) == scale


def test_a_unit_box_changes_nothing_not_even_the_array() -> None:
    actions = np.array([[1.5, -0.3]], np.float32)
    unit = box((-1.0, 1.0), (-1.0, 1.0))
    assert unit.normalized(actions) is actions and unit.in_units(actions) is actions


@given(
    st.lists(st.tuples(st.floats(-1e3, 1e3, width=32), st.floats(2.0**-10, 1e3, width=32)), min_size=1, max_size=4),
    st.floats(0.0, 1.0),
)
def test_scaling_goes_there_and_back_and_never_leaves_the_box(widths: list[tuple[float, float]], at: float) -> None:
    scale = box(*((low, float(np.float32(low + width))) for low, width in widths))
    low, high = np.array(scale.low, np.float32), np.array(scale.high, np.float32)
    action = (low + np.float32(at) * (high - low)).clip(low, high)[None]
    back = scale.in_units(scale.normalized(action))
    assert (back >= low).all() and (back <= high).all()
    assert back == pytest.approx(action, abs=2e-7 * max(1.0, *np.abs(scale.low), *np.abs(scale.high)) + 1e-6)
    for bound, edge in ((high, 1.0), (low, -1.0)):
        assert scale.in_units(np.full((1, len(low)), edge, np.float32))[0] == pytest.approx(bound, rel=1e-6, abs=1e-6)


def test_a_box_in_words() -> None:
    assert str(box((-2.0, 2.0), (-2.0, 2.0))) == "[-2, 2]"
    assert str(box((0.0, 1.0), (-3.0, 1.0))) == "[0, 1] x [-3, 1]"
    assert box((0.0, INFINITY), (-2.0, 2.0)).identity == {"low": [0.0, -2.0], "high": [None, 2.0]}


def test_what_an_environment_shows_and_takes() -> None:
    spaces = OWN.environment("skew").spaces
    assert spaces.observation == 2
    assert spaces.actions == box((0.0, 1.0), (-3.0, 1.0))
    assert spaces.shapes == {"observations": (2,), "actions": (2,)}


@pytest.mark.parametrize(
    ("actions", "observations", "named"),
    [
        ("discrete", "flat", "Discrete actions"),
        ("multidiscrete", "flat", "MultiDiscrete actions"),
        ("dict", "flat", "Dict actions"),
        ("whole", "flat", "Box (1,) of int64 actions"),
        ("grid", "flat", "Box (2, 2) of float32 actions"),
        ("two", "dict", "Dict observations"),
        ("two", "image", "Box (8, 8, 3) of uint8 observations"),
        ("two", "discrete", "Discrete observations"),
        ("two", "tuple", "Tuple observations"),
        ("two", "scalar", "Box () of float32 observations"),
    ],
)
def test_other_spaces_are_refused_with_what_is_supported(actions: str, observations: str, named: str) -> None:
    with pytest.raises(UserError) as refused:
        _ = OWN.environment(actions, observations).spaces
    assert named in refused.value.problem and "flat vectors" in refused.value.problem
    assert "Cart-v0" in refused.value.problem and refused.value.remedy


@pytest.mark.parametrize(
    ("identifier", "arguments", "named"),
    [
        ("Pendulumm-v1", {}, "Pendulum-v1"),
        ("worlds:Cartt-v0", {}, "Cart-v0"),
        ("Hopper-v99", {}, "Hopper-v"),
        ("nowhere/Reach-v0", {}, "nowhere/Reach-v0"),
        ("no_such_module:Reach-v0", {}, "no_such_module"),
        ("worlds:Cart-v0", {"colour": "red"}, "colour"),
        ("not an id", {}, "not an id"),
    ],
)
def test_environments_that_are_not_there(identifier: str, arguments: dict[str, str], named: str) -> None:
    with pytest.raises(UserError) as refused:
        _ = Environment("x", identifier, 10, 0.0, 1.0, arguments).spaces
    assert identifier.rpartition(":")[2] in str(refused.value)
    assert named in str(refused.value)
    assert "\n" not in str(refused.value)
