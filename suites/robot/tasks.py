"""The rules of the three tasks: how an episode starts, what is observed, and how it ends. Vectorised over n worlds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from suites.robot import constants
from suites.robot.servo import WORKSPACE_HIGH, WORKSPACE_LOW

Array = NDArray[np.float64]
Puck = Literal["none", "resting", "sliding"]

PADDLE_RADIUS = float(constants.PADDLE_DIAMETER) / 2
PUCK_RADIUS = float(constants.PUCK_DIAMETER) / 2
OBJECT_RADIUS = float(constants.OBJECT_DIAMETER) / 2
CUPS: Array = np.array(constants.CUPS, dtype=np.float64)
BOWL: Array = np.array([constants.BOWL_X, constants.BOWL_Y])
CUP_REACH = float(constants.CUP_RADIUS) + OBJECT_RADIUS
"""Metres between the effector's centre and a cup's at which they touch."""
PUCK_REACH = PADDLE_RADIUS + PUCK_RADIUS
"""Metres between the paddle's centre and the puck's at which they touch."""
LOST_X = float(WORKSPACE_LOW[0]) - PUCK_REACH
"""x below which a puck is out of the arm's reach."""


Codes = NDArray[np.int8]

OUTCOMES = (
    None,
    "success",
    "cup hit",
    "emergency stop",
    "missed",
    "touched only",
    "stalled",
    "out of time",
)
"""How an episode can end, code to name; 0 goes on."""

SUCCESS, CUP_HIT, EMERGENCY_STOP, MISSED, TOUCHED_ONLY, STALLED, OUT_OF_TIME = range(1, len(OUTCOMES))

_OUTCOMES = np.array(OUTCOMES, dtype=object)


def outcome_names(codes: Codes) -> NDArray[np.object_]:
    """Names ``[n]``, None where an episode goes on."""
    return _OUTCOMES[codes]


def steps(seconds: float) -> int:
    """Control steps in a number of seconds."""
    return round(seconds * constants.CONTROL_RATE)


@dataclass(frozen=True)
class Start:
    """Start of a world: positions (x, y) in metres, velocity in m/s."""

    effector: tuple[float, float]
    puck: tuple[float, float] = (0.0, 0.0)
    puck_velocity: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Motion:
    """True motion in one control step.

    Attributes:
        effector: ``[n, SUBSTEPS, 2]`` at every substep's end.
        puck: the same, where there is one.
        puck_velocity: ``[n, 2]`` at the end.
        rested: ``[n]`` control steps for which the effector has kept its place.
        touching: ``[n]`` the paddle and the puck met in this step.
        touched: ``[n]`` in this step or before.
    """

    effector: Array
    puck: Array | None
    puck_velocity: Array | None
    rested: NDArray[np.int64]
    touching: NDArray[np.bool_]
    touched: NDArray[np.bool_]


class RobotTask(Protocol):
    """One task of the robot."""

    name: ClassVar[str]
    horizon: ClassVar[int]
    observation_size: ClassVar[int]
    effector_radius: ClassVar[float]
    puck: ClassVar[Puck]

    @property
    def camera_tracks_effector(self) -> bool:
        """Whether the camera observes the effector, too, in place of encoders."""
        ...

    @property
    def touch_fails(self) -> bool:
        """Whether an episode in which the puck was only touched has an outcome of its own."""
        ...

    def start(self, generator: np.random.Generator) -> Start:
        """A random start."""
        ...

    def judge(self, motion: Motion) -> Codes:
        """``[n]`` outcome codes, 0 where the rules of this task let the episode go on."""
        ...


@dataclass(frozen=True)
class SafeManipulation:
    """Bring the carried object to rest above the bowl and touch no cup.

    Attributes:
        embodiment: ``robot``, whose encoders give the effector's position, or ``hand``: the observation is the camera's
            track of the carried object.
    """

    embodiment: Literal["robot", "hand"] = "robot"

    name: ClassVar[str] = "safe-manipulation"
    horizon: ClassVar[int] = int(constants.SAFE_HORIZON)
    observation_size: ClassVar[int] = 2
    effector_radius: ClassVar[float] = OBJECT_RADIUS
    puck: ClassVar[Puck] = "none"
    touch_fails: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.embodiment not in ("robot", "hand"):
            raise ValueError(f"embodiment is '{self.embodiment}'; it must be 'robot' or 'hand'")

    @property
    def camera_tracks_effector(self) -> bool:
        """True of the hand, which has no encoders."""
        return self.embodiment == "hand"

    def start(self, generator: np.random.Generator) -> Start:
        """Uniform in the workspace, clear of the cups and not at the bowl."""
        while True:
            x, y = generator.uniform(WORKSPACE_LOW, WORKSPACE_HIGH)
            from_cups = np.hypot(CUPS[:, 0] - x, CUPS[:, 1] - y).min()
            from_bowl = np.hypot(BOWL[0] - x, BOWL[1] - y)
            if from_cups >= CUP_REACH + constants.START_CLEARANCE and from_bowl >= constants.START_DISTANCE:
                return Start((float(x), float(y)))

    def judge(self, motion: Motion) -> Codes:
        """A cup's contact anywhere in the step ends it; then rest, above the bowl or elsewhere."""
        codes = np.zeros(len(motion.effector), dtype=np.int8)
        to_bowl = motion.effector[:, -1] - BOWL
        above = (to_bowl * to_bowl).sum(axis=1) <= float(constants.BOWL_RADIUS) ** 2
        codes[~above & (motion.rested >= steps(constants.STALL_TIME))] = STALLED
        codes[above & (motion.rested >= steps(constants.GOAL_REST_TIME))] = SUCCESS
        codes[cups_met(motion.effector)] = CUP_HIT
        return codes


@dataclass(frozen=True)
class PuckStriking:
    """Touch a puck at rest (the blower is off, so the tilt does not move it)."""

    name: ClassVar[str] = "puck-striking"
    horizon: ClassVar[int] = int(constants.STRIKING_HORIZON)
    observation_size: ClassVar[int] = 4
    effector_radius: ClassVar[float] = PADDLE_RADIUS
    puck: ClassVar[Puck] = "resting"
    touch_fails: ClassVar[bool] = False
    camera_tracks_effector: ClassVar[bool] = False

    def start(self, generator: np.random.Generator) -> Start:
        """The paper's start pose; the puck anywhere in reach beyond it."""
        across = float(constants.RESTING_PUCK_Y)
        x = generator.uniform(constants.RESTING_PUCK_LOW_X, constants.RESTING_PUCK_HIGH_X)
        y = generator.uniform(-across, across)
        return Start((float(constants.STRIKING_START_X), float(constants.START_Y)), (x, y))

    def judge(self, motion: Motion) -> Codes:
        """Any contact is the success; rest without one is a stall."""
        codes = np.zeros(len(motion.effector), dtype=np.int8)
        codes[motion.rested >= steps(constants.STALL_TIME)] = STALLED
        codes[motion.touching] = SUCCESS
        return codes


@dataclass(frozen=True)
class DynamicHitting:
    """Touch or hit a puck that slides down the table.

    Attributes:
        score: ``touch``: any contact; ``hit``: after one, the puck leaves uphill faster than a threshold.
    """

    score: Literal["touch", "hit"] = "touch"

    name: ClassVar[str] = "dynamic-hitting"
    horizon: ClassVar[int] = int(constants.HITTING_HORIZON)
    observation_size: ClassVar[int] = 4 + 2 * int(constants.RELATIVE_POSITIONS)
    effector_radius: ClassVar[float] = PADDLE_RADIUS
    puck: ClassVar[Puck] = "sliding"
    camera_tracks_effector: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.score not in ("touch", "hit"):
            raise ValueError(f"score is '{self.score}'; it must be 'touch' or 'hit'")

    @property
    def touch_fails(self) -> bool:
        """True where the score asks for a hit."""
        return self.score == "hit"

    def start(self, generator: np.random.Generator) -> Start:
        """The paper's start pose; the puck released at the far end with a push downhill and to a side."""
        across, push = float(constants.RELEASE_Y), float(constants.RELEASE_SPEED_ACROSS)
        y = generator.uniform(-across, across)
        velocity = -generator.uniform(0.0, constants.RELEASE_SPEED_DOWN), generator.uniform(-push, push)
        effector = float(constants.HITTING_START_X), float(constants.START_Y)
        return Start(effector, (float(constants.RELEASE_X), y), velocity)

    def judge(self, motion: Motion) -> Codes:
        """The puck out of reach ends it; a hit needs the uphill speed after the contact, not in it."""
        assert motion.puck is not None and motion.puck_velocity is not None
        codes = np.zeros(len(motion.effector), dtype=np.int8)
        lost = motion.puck[:, -1, 0] < LOST_X
        codes[lost] = MISSED
        if self.score == "touch":
            codes[motion.touching] = SUCCESS
            return codes
        codes[lost & motion.touched] = TOUCHED_ONLY
        leaves = motion.touched & (motion.puck_velocity[:, 0] > float(constants.LEAVING_SPEED))
        codes[leaves] = SUCCESS
        return codes


def cups_met(path: Array) -> NDArray[np.bool_]:
    """Whether the carried object's path ``[n, SUBSTEPS, 2]`` touches a cup, ``[n]``."""
    met = np.zeros(len(path), dtype=np.bool_)
    for x, y in CUPS:
        across, along = path[:, :, 0] - x, path[:, :, 1] - y
        met |= (across * across + along * along < CUP_REACH**2).any(axis=1)
    return met


def puck_met(effector: Array, puck: Array) -> NDArray[np.bool_]:
    """Whether the paddle's path ``[n, SUBSTEPS, 2]`` touches the puck's, ``[n]``."""
    apart = effector - puck
    apart *= apart
    met: NDArray[np.bool_] = (apart[:, :, 0] + apart[:, :, 1] < PUCK_REACH**2).any(axis=1)
    return met
