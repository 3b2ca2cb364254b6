"""The one MuJoCo model: a tilted table, an arm's tip that slides in its plane, and a puck in rails or cups and a bowl.

Discs are spheres in one plane and rails are planes, so that every contact is analytic. A contact has no spring to speak
of: its damping is chosen so that the first substep of a contact turns the approaching speed v into -e v. The
coefficient of restitution e is then exact, whatever the masses, the speed and the phase of the substep, where a spring
stiff enough to be thin would need far shorter substeps. What remains is a depth of at most one substep's way, 4 mm at
1 m/s, by which the line of centres of a side hit is late.
"""

from __future__ import annotations

import math

import mujoco

from suites.robot import constants
from suites.robot.servo import GAIN, SUBSTEP
from suites.robot.tasks import Puck

STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)

TILT_ACCELERATION = float(
    constants.GRAVITY * math.sin(math.radians(constants.TABLE_TILT)) * (1.0 - constants.FRICTION_LOSS)
)
"""m/s^2 downhill of a free puck: g sin(tilt) (1 - friction loss)."""

# The share of a contact's depth that one substep corrects; it keeps a pressed puck out of the rail, and changes the
# speed of a bounce by less than itself.
_DEPTH_CORRECTION = 0.002

_OPTION = f"""
<option timestep="{SUBSTEP!r}" integrator="Euler" solver="Newton" iterations="8" ls_iterations="10" tolerance="1e-10"
  jacobian="dense" gravity="{{gravity!r}} 0 0">
  <flag warmstart="disable" equality="disable" frictionloss="disable" limit="disable" eulerdamp="disable"
    sensor="disable" midphase="disable"/>
</option>"""


def _disc(name: str, radius: float, mass: float, compensated: bool) -> str:
    return f"""
<body name="{name}" gravcomp="{int(compensated)}">
  <joint name="{name} x" type="slide" axis="1 0 0"/>
  <joint name="{name} y" type="slide" axis="0 1 0"/>
  <geom name="{name}" type="sphere" size="{radius!r}" mass="{mass!r}" contype="0" conaffinity="0"/>
</body>"""


def _rail(name: str, x: float, y: float, normal: str) -> str:
    return f"""
<geom name="{name}" type="plane" size="1 1 1" pos="{x!r} {y!r} 0" zaxis="{normal}" contype="0" conaffinity="0"/>"""


def _contact(first: str, second: str, restitution: float) -> str:
    damping = (1.0 + restitution) / SUBSTEP
    stiffness = _DEPTH_CORRECTION / SUBSTEP**2
    return f"""
<pair geom1="{first}" geom2="{second}" condim="1" solref="{-stiffness!r} {-damping!r}" solimp="0.9999 0.9999 1"/>"""


def _motor(joint: str) -> str:
    limit = float(constants.FORCE_LIMIT)
    return f"""
<velocity joint="{joint}" kv="{GAIN!r}" forcelimited="true" forcerange="{-limit!r} {limit!r}"/>"""


def _standing(name: str, x: float, y: float, radius: float) -> str:
    height = float(constants.CUP_RADIUS)
    return f"""
<geom name="{name}" type="cylinder" size="{radius!r} {height!r}" pos="{x!r} {y!r} 0" contype="0" conaffinity="0"/>"""


def _puck_and_rails() -> tuple[str, str]:
    """Bodies and contacts of the puck tasks."""
    length, side = float(constants.TABLE_LENGTH), float(constants.TABLE_WIDTH) / 2
    rails = {
        "near": _rail("near", 0.0, 0.0, "1 0 0"),
        "far": _rail("far", length, 0.0, "-1 0 0"),
        "right": _rail("right", 0.0, -side, "0 1 0"),
        "left": _rail("left", 0.0, side, "0 -1 0"),
    }
    puck = _disc("puck", float(constants.PUCK_DIAMETER) / 2, float(constants.PUCK_MASS), compensated=False)
    contacts = "".join(_contact(rail, "puck", float(constants.WALL_RESTITUTION)) for rail in rails)
    contacts += _contact("effector", "puck", float(constants.PADDLE_RESTITUTION))
    return "".join(rails.values()) + puck, contacts


def _cups_and_bowl() -> str:
    cups = [
        _standing(f"cup {index}", float(x), float(y), float(constants.CUP_RADIUS))
        for index, (x, y) in enumerate(constants.CUPS, start=1)
    ]
    bowl = _standing("bowl", float(constants.BOWL_X), float(constants.BOWL_Y), float(constants.BOWL_RADIUS))
    return "".join(cups) + bowl


def build(effector_radius: float, puck: Puck) -> mujoco.MjModel:
    """The model of one world.

    Its state ``mjSTATE_FULLPHYSICS`` is time, effector (x, y), puck (x, y) where there is one, and their velocities in
    the same order; its controls are the effector's velocities in m/s. Cups and bowl exert no force: a contact with a
    cup ends an episode, and the object is carried over the bowl.

    Args:
        effector_radius: of the object that the arm carries, in metres.
        puck: ``none`` (cups and a bowl instead), ``resting`` (the tilt does not move it) or ``sliding``.
    """
    gravity = -TILT_ACCELERATION if puck == "sliding" else 0.0
    things, contacts = (_cups_and_bowl(), "") if puck == "none" else _puck_and_rails()
    arm = _disc("effector", effector_radius, float(constants.EFFECTOR_MASS), compensated=True)
    motors = _motor("effector x") + _motor("effector y")
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco>{_OPTION.format(gravity=gravity)}
<worldbody>{arm}{things}
</worldbody>
<contact>{contacts}
</contact>
<actuator>{motors}
</actuator>
</mujoco>"""
    )
