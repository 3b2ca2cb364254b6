"""The model against closed forms: the tilt's acceleration, energy, restitution, and the deflection of side hits."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from suites.robot import constants, model
from suites.robot.servo import SUBSTEP
from suites.robot.tasks import PADDLE_RADIUS, PUCK_RADIUS, PUCK_REACH

Array = NDArray[np.float64]

EXACT = 0.003
"""The share of a bounce's speed that the correction of its depth may add, and a little."""


class Table:
    """One world, substep by substep; the arm keeps the velocity that it is given."""

    def __init__(self, sliding: bool = False) -> None:
        self.model = model.build(PADDLE_RADIUS, "sliding" if sliding else "resting")
        self.data = mujoco.MjData(self.model)

    def put(
        self, effector: object, puck: object, effector_velocity: object = (0, 0), velocity: object = (0, 0)
    ) -> None:
        self.data.qpos[:2], self.data.qpos[2:] = effector, puck
        self.data.qvel[:2], self.data.qvel[2:] = effector_velocity, velocity
        self.data.ctrl[:] = effector_velocity

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)

    def until_bounce(self) -> tuple[Array, Array, Array]:
        """Velocities of arm and puck before the first substep that changes the puck's, and the unit normal then."""
        for _ in range(2000):
            before = self.data.qvel.copy()
            apart = self.data.qpos[2:] - self.data.qpos[:2]
            self.step()
            if not np.allclose(self.data.qvel[2:], before[2:], atol=1e-9):
                return before[:2], before[2:], apart / np.linalg.norm(apart)
        raise AssertionError("nothing was met")

    @property
    def puck_velocity(self) -> Array:
        return np.array(self.data.qvel[2:])


AWAY = (0.3, -0.3)


def test_a_free_puck_accelerates_as_the_tilt_and_its_loss_say() -> None:
    expected = 9.81 * math.sin(math.radians(5.5)) * (1.0 - 0.05)
    table = Table(sliding=True)
    table.put(AWAY, (1.8, 0.1), velocity=(0.3, -0.2))
    for _ in range(60):
        table.step()
    assert (0.3 - table.puck_velocity[0]) / (60 * SUBSTEP) == pytest.approx(expected, rel=1e-9)
    assert table.puck_velocity[1] == pytest.approx(-0.2, abs=1e-12)


def test_the_tilt_does_not_move_the_arm() -> None:
    table = Table(sliding=True)
    table.put((0.6, 0.0), (1.8, 0.1))
    for _ in range(60):
        table.step()
    np.testing.assert_allclose(table.data.qpos[:2], (0.6, 0.0), atol=1e-12)


def test_a_puck_at_rest_stays_where_it_is_without_the_blower() -> None:
    table = Table(sliding=False)
    table.put(AWAY, (0.8, 0.1))
    for _ in range(240):
        table.step()
    np.testing.assert_array_equal(table.data.qpos[2:], (0.8, 0.1))


def test_energy_is_conserved_between_contacts() -> None:
    """Per mass v^2 / 2 + a x; semi-implicit Euler's own loss, a^2 dt t / 2, is known and accounted for."""
    pull = model.TILT_ACCELERATION
    table = Table(sliding=True)
    table.put(AWAY, (1.0, 0.0), velocity=(1.0, 0.3))

    def energy() -> float:
        return 0.5 * float(table.puck_velocity @ table.puck_velocity) + pull * float(table.data.qpos[2])

    start = energy()
    for substep in range(1, 240):
        table.step()
        assert energy() + pull**2 * SUBSTEP * substep * SUBSTEP / 2 == pytest.approx(start, abs=1e-9)


@pytest.mark.parametrize("rail", ["near", "far", "right", "left"])
@settings(max_examples=15, deadline=None)
@given(speed=st.floats(0.2, 3.0), along=st.floats(-1.0, 1.0), gap=st.floats(0.001, 0.05))
def test_a_rail_returns_its_share_of_the_normal_speed(rail: str, speed: float, along: float, gap: float) -> None:
    distance = PUCK_RADIUS + gap
    puck, velocity = {
        "near": ((distance, 0.0), (-speed, along)),
        "far": ((1.93 - distance, 0.0), (speed, along)),
        "right": ((1.2, -0.38 + distance), (along, -speed)),
        "left": ((1.2, 0.38 - distance), (along, speed)),
    }[rail]
    table = Table()
    table.put((0.6, 0.0), puck, velocity=velocity)
    table.until_bounce()
    after, axis = table.puck_velocity, 0 if rail in ("near", "far") else 1
    assert after[1 - axis] == pytest.approx(along, abs=1e-9)
    assert -after[axis] / velocity[axis] == pytest.approx(float(constants.WALL_RESTITUTION), abs=EXACT)
    for _ in range(20):
        table.step()
    np.testing.assert_allclose(table.puck_velocity, after, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    angle=st.floats(0.0, 2 * math.pi),
    offset=st.floats(-0.9, 0.9),
    speed=st.floats(0.2, 2.0),
    gap=st.floats(0.001, 0.03),
    arm=st.floats(-0.5, 0.9),
)
def test_the_paddle_deflects_along_the_line_of_centres(
    angle: float, offset: float, speed: float, gap: float, arm: float
) -> None:
    """Two smooth discs: -e times the approach along the normal, nothing across it, and the momentum of both is kept."""
    ahead = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-ahead[1], ahead[0]])
    reach = PUCK_REACH + gap
    centre = np.array([0.965, 0.0])
    table = Table()
    puck = centre + ahead * math.sqrt(reach**2 - (offset * PUCK_REACH) ** 2) + across * offset * PUCK_REACH
    # The arm comes towards the puck, or flees from it more slowly than it comes.
    towards = arm * speed
    table.put(centre, puck, effector_velocity=ahead * towards, velocity=-ahead * speed)
    arm_before, puck_before, normal = table.until_bounce()
    tangent = np.array([-normal[1], normal[0]])
    arm_after, puck_after = np.array(table.data.qvel[:2]), table.puck_velocity

    approach = (puck_before - arm_before) @ normal
    assert approach < 0
    rebound = (puck_after - arm_after) @ normal
    assert -rebound / approach == pytest.approx(float(constants.PADDLE_RESTITUTION), abs=EXACT)
    assert puck_after @ tangent == pytest.approx(puck_before @ tangent, abs=1e-9)
    masses = float(constants.EFFECTOR_MASS), float(constants.PUCK_MASS)
    np.testing.assert_allclose(
        masses[0] * arm_after + masses[1] * puck_after, masses[0] * arm_before + masses[1] * puck_before, atol=1e-9
    )


def test_a_puck_comes_to_rest_at_the_robots_end() -> None:
    table = Table(sliding=True)
    table.put((0.6, 0.3), (0.4, 0.0))
    for _ in range(240 * 20):
        table.step()
    assert abs(table.puck_velocity[0]) < 0.01
    assert table.data.qpos[2] == pytest.approx(PUCK_RADIUS, abs=0.001)
