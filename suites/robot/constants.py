"""Constants of the simulated robot, each with its unit and its origin: the paper, or a choice of ours.

Lengths are in metres: x runs along the table from the robot's end (0) to the far end, y across it with 0 in the middle.
"""

from __future__ import annotations

from typing import Literal

Origin = Literal["paper", "ours"]


class Constant(float):
    """A number with its unit, origin and reason.

    Args:
        value: in `unit`.
        unit: ``1`` where there is none.
        origin: ``paper``, or ``ours`` where the paper is silent.
        why: meaning and, where it is ours, the reason.
    """

    unit: str
    origin: Origin
    why: str

    def __new__(cls, value: float, unit: str, origin: Origin, why: str) -> Constant:
        """The number itself."""
        constant = super().__new__(cls, value)
        constant.unit, constant.origin, constant.why = unit, origin, why
        return constant


# The table and what moves on it.
TABLE_LENGTH = Constant(1.93, "m", "paper", "along the slope")
TABLE_WIDTH = Constant(0.76, "m", "paper", "across the slope")
TABLE_TILT = Constant(5.5, "degree", "paper", "a released puck slides to the robot's end")
PUCK_DIAMETER = Constant(0.063, "m", "paper", "air-hockey puck")
PADDLE_DIAMETER = Constant(0.095, "m", "paper", "what the gripper holds in the puck tasks")
GRAVITY = Constant(9.81, "m/s^2", "ours", "standard gravity to three digits")
FRICTION_LOSS = Constant(0.05, "1", "ours", "share of the tilt's pull that friction takes; low, as stated")
PUCK_MASS = Constant(0.03, "kg", "ours", "a light puck: it cannot push the arm away")
EFFECTOR_MASS = Constant(2.0, "kg", "ours", "moving mass that the arm shows at its tip")
WALL_RESTITUTION = Constant(0.8, "1", "ours", "speed kept along the normal at a rail")
PADDLE_RESTITUTION = Constant(0.7, "1", "ours", "speed kept along the normal at the paddle")
OBJECT_DIAMETER = Constant(0.04, "m", "ours", "what the gripper, or the hand, carries in the safe task")

# Time.
CONTROL_RATE = Constant(20, "Hz", "paper", "delta positions per second")
CAMERA_RATE = Constant(60, "Hz", "paper", "frames per second of the overhead camera")
PHYSICS_RATE = Constant(240, "Hz", "ours", "whole substeps per frame (4) and per control step (12)")

# The arm.
CLIP_X = Constant(0.26, "m", "paper", "largest commanded displacement per control step, along the table")
CLIP_Y = Constant(0.13, "m", "paper", "largest commanded displacement per control step, across the table")
SERVO_TIME_CONSTANT = Constant(0.1, "s", "ours", "first-order tracking of the target; two control steps of lag")
VELOCITY_LIMIT = Constant(1.0, "m/s", "ours", "speed of the tip that such an arm is allowed near people")
FORCE_LIMIT = Constant(100, "N", "ours", "what the arm gives; 50 m/s^2 at its own mass")
OVERLOAD_FORCE = Constant(75, "N", "ours", "demand that counts as an overload; a hit puck asks for less than 30")
OVERLOAD_TIME = Constant(0.03, "s", "ours", "a longer overload is an emergency stop; a full start takes 0.017")
WORKSPACE_LOW_X = Constant(0.25, "m", "ours", "nearest reach of an arm that stands at the robot's end")
WORKSPACE_HIGH_X = Constant(0.95, "m", "ours", "farthest reach: the lower half of the table")
WORKSPACE_LOW_Y = Constant(-0.3, "m", "ours", "keeps the paddle off the rail, but less than a puck: it can jam one")
WORKSPACE_HIGH_Y = Constant(0.3, "m", "ours", "the same at the other rail")

# The camera.
CAMERA_BIAS = Constant(0.004, "m", "ours", "standard deviation per axis of the homography's error, fixed in an episode")
CAMERA_NOISE = Constant(0.002, "m", "ours", "standard deviation per axis of a reading; a pixel is 3 mm")
CAMERA_LATENCY = Constant(1, "frame", "ours", "a reading is of the picture before the newest")
CAMERA_DROPOUT = Constant(0.02, "1", "ours", "share of readings in which the colour is not found; the last one is held")

# Safe manipulation. The bowl stands in the far left corner of the workspace, and three cups on an arc before it: one on
# the diagonal, one on either side. Between two cups the object's centre has a gate of 12 cm. Two in five of the
# straight ways to the bowl from random starts, and the one from the opposite corner, cross a cup.
BOWL_X = Constant(0.84, "m", "ours", "far, opposite the fixed start's corner")
BOWL_Y = Constant(0.2, "m", "ours", "left, opposite the fixed start's corner")
BOWL_RADIUS = Constant(0.07, "m", "ours", "the object's centre must rest inside")
CUP_RADIUS = Constant(0.03, "m", "ours", "a small drinking cup")
CUPS = (
    (Constant(0.60, "m", "ours", "middle cup, x: on the diagonal"), Constant(0.03, "m", "ours", "middle cup, y")),
    (Constant(0.80, "m", "ours", "far cup, x: right of the bowl"), Constant(-0.08, "m", "ours", "far cup, y")),
    (Constant(0.55, "m", "ours", "left cup, x: before the bowl"), Constant(0.24, "m", "ours", "left cup, y")),
)
CORNER_X = Constant(0.3, "m", "ours", "the fixed start: the corner opposite the bowl")
CORNER_Y = Constant(-0.25, "m", "ours", "the fixed start: the corner opposite the bowl")
START_CLEARANCE = Constant(0.03, "m", "ours", "least free way between a start and a cup")
START_DISTANCE = Constant(0.2, "m", "ours", "least distance of a start from the bowl's centre")

# Resting, for success and for giving up.
REST_RADIUS = Constant(0.015, "m", "ours", "a place is kept while the effector stays this near; noise alone is less")
GOAL_REST_TIME = Constant(0.5, "s", "ours", "kept above the bowl for so long: success")
STALL_TIME = Constant(2.0, "s", "ours", "kept anywhere else for so long: stalled")

# The puck tasks.
STRIKING_START_X = Constant(0.38, "m", "paper", "start pose of the arm before a puck at rest")
HITTING_START_X = Constant(0.68, "m", "paper", "start pose of the arm before a moving puck")
START_Y = Constant(0.0, "m", "ours", "both start poses are in the middle")
RESTING_PUCK_LOW_X = Constant(0.55, "m", "ours", "in reach, and off the arm's start")
RESTING_PUCK_HIGH_X = Constant(0.95, "m", "ours", "in reach")
RESTING_PUCK_Y = Constant(0.28, "m", "ours", "largest distance from the middle")
RELEASE_X = Constant(1.85, "m", "ours", "the moving puck is let go at the far end")
RELEASE_Y = Constant(0.3, "m", "ours", "largest distance from the middle")
RELEASE_SPEED_DOWN = Constant(0.5, "m/s", "ours", "largest push downhill")
RELEASE_SPEED_ACROSS = Constant(0.5, "m/s", "ours", "largest push across")
LEAVING_SPEED = Constant(0.3, "m/s", "ours", "uphill speed after a contact that counts as a hit")
RELATIVE_POSITIONS = Constant(5, "1", "paper", "past puck positions in the observation of dynamic hitting")

# Steps after which an episode is cut.
SAFE_HORIZON = Constant(200, "step", "ours", "10 s; a crossing takes 2 to 4")
STRIKING_HORIZON = Constant(100, "step", "ours", "5 s; the suboptimal recordings last about 75 steps")
HITTING_HORIZON = Constant(100, "step", "ours", "5 s; the puck is past after 2 to 3")
