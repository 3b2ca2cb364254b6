"""The scripted demonstrator: follows planned paths, and tells where on which of them it is from the observation alone.

It keeps nothing in mind between two steps. Which sub-tasks are completed can be seen; which one is under way is the one
whose path is nearest; how far it has got is the path's nearest point; the command is a point some way ahead of that. In
the hub, where all paths begin, the next sub-task is chosen.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray

from lfobench.contract.episodes import FloatArray
from lfobench.contract.suite import Level
from lfobench.errors import unknown_name
from suites.franka.constants import JOINTS, OBJECTS, ROBOT, SUB_TASKS

FILE = Path(__file__).parent / "paths.safetensors"
RULES = 1
"""Grows with every change of this module that changes an action."""

FINGER_WEIGHT = 10.0
"""Radians of distance that a metre of the fingers' mean counts."""
REACH = 0.16
"""Radians, or metres, between a command and the observed position at an action of 1: 2 per second for 0.08 s."""
HUB_RADIUS = 0.06
"""Radians from the hub, as a norm over the joints, within which the next sub-task is chosen; noise is below 0.03."""

LEAVES = 0.03
"""Metres that the fingers must be open for the arm to leave the hub: on ways out they are open, on ways in closed."""

AHEAD, AHEAD_AT_KNOBS = 4, 8
"""Points of a path between the nearest and the commanded one; the arm follows with a lag, and pushes with it."""
KNOBS = ("bottom burner", "top burner")

END = 12
"""Points at the end of a way out that are still followed, and then back, once the sub-task is seen to be completed."""

EPISODE_SUB_TASKS = 4
"""How many sub-tasks an episode of the offline levels completes; then the arm rests."""

Array = NDArray[np.float64]


class Sign(NamedTuple):
    """By what a completed sub-task is seen: an object's coordinate beyond a limit, in the direction of `sense`."""

    coordinate: int
    limit: float
    sense: float


SIGNS = {
    "microwave": Sign(22, -0.55, -1.0),
    "kettle": Sign(24, 0.55, 1.0),
    "light switch": Sign(17, -0.5, -1.0),
    "slide cabinet": Sign(19, 0.12, 1.0),
    "bottom burner": Sign(11, -0.72, -1.0),
    "top burner": Sign(15, -0.72, -1.0),
}


class Route(NamedTuple):
    """A path: features ``[n, 8]`` of its positions, commands ``[n, 9]``, and how many points ahead to aim."""

    features: Array
    commands: Array
    ahead: int

    def nearest(self, here: Array) -> tuple[float, int]:
        """Distance of features ``[8]`` to the path, and the point of it that is nearest."""
        squares = np.square(self.features - here).sum(axis=1)
        point = int(squares.argmin())
        return float(squares[point]) ** 0.5, point

    def command(self, point: int) -> Array:
        """What to command at a point."""
        wanted: Array = self.commands[min(point + self.ahead, len(self.commands) - 1)]
        return wanted


class ScriptedDemonstrator:
    """Completes sub-tasks in the kitchen.

    Args:
        content: of ``paths.safetensors``.
        order: the sub-tasks one after the other; None takes four at random.
        never: sub-tasks that an episode does not complete all of.
        noise: standard deviation of the Gaussian noise on every joint's action.
    """

    def __init__(
        self, content: bytes, order: Sequence[str] | None = None, never: Sequence[str] = (), noise: float = 0.0
    ) -> None:
        tensors = safetensors.numpy.load(content)
        self._start = _route(tensors, "start/back", AHEAD)
        self._do = {name: _route(tensors, f"{name}/do", AHEAD_AT_KNOBS if name in KNOBS else AHEAD) for name in SIGNS}
        self._back = {name: _route(tensors, f"{name}/back", AHEAD) for name in SIGNS}
        self._end = {
            name: Route(do.features[-END:], np.vstack((do.commands[-END:], self._back[name].commands)), do.ahead)
            for name, do in self._do.items()
        }
        self._hub: Array = self._start.features[-1, :JOINTS]
        self._rest: Array = self._do["microwave"].commands[0]
        self._order, self._never, self._noise = order, frozenset(never), noise
        rules = f"{RULES} {order} {sorted(never)} {noise}".encode()
        self._fingerprint = hashlib.sha256(content + rules).hexdigest()

    @property
    def fingerprint(self) -> str:
        """A hash of the paths and of what is done with them."""
        return self._fingerprint

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Velocities ``[9]`` for an observation ``[60]`` or ``[30]``, of which the goal is not read."""
        seen = observation[: ROBOT + OBJECTS].astype(np.float64)
        aim = (self._command(seen, generator) - seen[:ROBOT]) / REACH
        # All joints by one factor, so that none runs ahead of the others and off the path.
        aim[:JOINTS] /= max(1.0, float(np.abs(aim[:JOINTS]).max()))
        aim[:JOINTS] += self._noise * generator.standard_normal(JOINTS)
        action: FloatArray = np.clip(aim, -1.0, 1.0).astype(np.float32)
        return action

    def _command(self, seen: Array, generator: np.random.Generator) -> Array:
        done = {name for name, sign in SIGNS.items() if sign.sense * (seen[sign.coordinate] - sign.limit) > 0.0}
        wanted = self._wanted(done)
        if np.linalg.norm(seen[:JOINTS] - self._hub) < HUB_RADIUS:
            if not wanted or seen[JOINTS:ROBOT].mean() < LEAVES:
                return self._rest
            chosen = self._do[wanted[int(generator.integers(len(wanted)))]]
            return chosen.command(0)
        here = _features(seen)
        routes = [self._start, *(self._do[name] for name in wanted)]
        routes += [route for name in sorted(done) for route in (self._end[name], self._back[name])]
        (_, point), route = min(((route.nearest(here), route) for route in routes), key=lambda found: found[0])
        return route.command(point)

    def _wanted(self, done: set[str]) -> list[str]:
        """The sub-tasks of which one may be next."""
        if self._order is not None:
            return [name for name in self._order if name not in done][:1]
        if len(done) >= EPISODE_SUB_TASKS:
            return []
        return [name for name in SIGNS if name not in done and not (self._never and self._never <= done | {name})]


def load(environment: str, level: Level) -> ScriptedDemonstrator:
    """The demonstrator of a level: ``expert``, ``partial`` or ``mixed``.

    Raises:
        UserError: there is no such level.
    """
    content = FILE.read_bytes()
    if level == "expert":
        return ScriptedDemonstrator(content, order=SUB_TASKS["complete"])
    if level not in ("partial", "mixed"):
        raise unknown_name("level", level, ["expert", "partial", "mixed"])
    return ScriptedDemonstrator(content, never=SUB_TASKS["mixed"] if level == "mixed" else (), noise=0.1)


def _route(tensors: Mapping[str, NDArray[np.floating[Any]]], name: str, ahead: int) -> Route:
    positions, commands = (tensors[f"{name}/{kind}"].astype(np.float64) for kind in ("positions", "commands"))
    return Route(np.stack([_features(position) for position in positions]), commands, ahead)


def _features(position: Array) -> Array:
    """What of a position ``[9, ...]`` a path is compared by ``[8]``."""
    features: Array = np.append(position[:JOINTS], FINGER_WEIGHT * position[JOINTS:ROBOT].mean())
    return features
