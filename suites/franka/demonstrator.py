"""The kitchen's scripted demonstrator: a memoryless policy that follows planned paths.

The observation decides everything: completed sub-tasks show in the objects; the current sub-task is the one with the
nearest path, and the progress its nearest point; the command is a point some way ahead of that. In the hub, where all
paths begin, the next sub-task is chosen.
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
"""Part of the fingerprint; raised with every change of this module that changes an action."""

FINGER_WEIGHT = 10.0
"""Radians of distance that a metre of the fingers' mean counts."""
REACH = 0.16
"""Radians, or metres, between a command and the observed position at an action of 1: 2 per second for 0.08 s."""
HUB_RADIUS = 0.06
"""Radians from the hub, as a norm over the joints, within which the next sub-task is chosen; noise is below 0.03."""

LEAVES = 0.03
"""Least opening of the fingers, in metres, for the arm to leave the hub: on outward paths they are open."""

AHEAD, AHEAD_AT_KNOBS = 4, 8
"""Points of a path between the nearest and the commanded one; the arm follows with a lag, and pushes with it."""
KNOBS = ("bottom burner", "top burner")

END = 12
"""Points at the end of an outward path that are still followed, before the way back, once the sub-task is completed."""

EPISODE_SUB_TASKS = 4
"""Sub-tasks that an episode of the offline levels completes; then the arm rests."""

Array = NDArray[np.float64]


class Sign(NamedTuple):
    """Sign of a completed sub-task: an object's coordinate beyond a limit, in the direction of `sense`."""

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
    """A path: features ``[n, 8]`` of its positions, commands ``[n, 9]``, and the number of points to aim ahead."""

    features: Array
    commands: Array
    ahead: int

    def nearest(self, here: Array) -> tuple[float, int]:
        """Distance of features ``[8]`` to the path, and the point of it that is nearest."""
        squares = np.square(self.features - here).sum(axis=1)
        point = int(squares.argmin())
        return float(squares[point]) ** 0.5, point

    def command(self, point: int) -> Array:
        """The command at a point."""
        wanted: Array = self.commands[min(point + self.ahead, len(self.commands) - 1)]
        return wanted


class ScriptedDemonstrator:
    """A policy that completes sub-tasks in the kitchen.

    Args:
        content: of ``paths.safetensors``.
        order: of the sub-tasks; None takes four at random.
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
        """Hash of the paths and of all that decides an action."""
        return self._fingerprint

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Velocities ``[9]`` for an observation ``[60]`` or ``[30]``, of which the goal is not read."""
        configuration = observation[: ROBOT + OBJECTS].astype(np.float64)
        aim = (self._command(configuration, generator) - configuration[:ROBOT]) / REACH
        # All joints by one factor, so that none runs ahead of the others and off the path.
        aim[:JOINTS] /= max(1.0, float(np.abs(aim[:JOINTS]).max()))
        aim[:JOINTS] += self._noise * generator.standard_normal(JOINTS)
        action: FloatArray = np.clip(aim, -1.0, 1.0).astype(np.float32)
        return action

    def _command(self, configuration: Array, generator: np.random.Generator) -> Array:
        done = {
            name for name, sign in SIGNS.items() if sign.sense * (configuration[sign.coordinate] - sign.limit) > 0.0
        }
        wanted = self._wanted(done)
        if np.linalg.norm(configuration[:JOINTS] - self._hub) < HUB_RADIUS:
            if not wanted or configuration[JOINTS:ROBOT].mean() < LEAVES:
                return self._rest
            chosen = self._do[wanted[int(generator.integers(len(wanted)))]]
            return chosen.command(0)
        here = _features(configuration)
        routes = [self._start, *(self._do[name] for name in wanted)]
        routes += [route for name in sorted(done) for route in (self._end[name], self._back[name])]
        (_, point), route = min(((route.nearest(here), route) for route in routes), key=lambda found: found[0])
        return route.command(point)

    def _wanted(self, done: set[str]) -> list[str]:
        """Candidates of the next sub-task."""
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
    """Features ``[8]`` of a position ``[9, ...]`` by which paths are compared."""
    features: Array = np.append(position[:JOINTS], FINGER_WEIGHT * position[JOINTS:ROBOT].mean())
    return features
