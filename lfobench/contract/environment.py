"""Environment: a simulator task, its spaces, its horizon, and the two returns behind its normalised score."""

from __future__ import annotations

import difflib
import importlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import FloatArray
from lfobench.errors import UserError

if TYPE_CHECKING:
    import gymnasium


@dataclass(frozen=True)
class ActionBox:
    """The actions that an environment takes, and the scale between its units and a method's [-1, 1].

    A dimension with two finite bounds is scaled, one without stays in the environment's units.

    Attributes:
        low: least value of every dimension ``[act]``, in the environment's units; -inf where there is none.
        high: the greatest.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def of(cls, space: gymnasium.Space[Any]) -> ActionBox:
        """The box that a vector of floats is taken from.

        Raises:
            ValueError: for any other space.
        """
        import gymnasium

        if not (isinstance(space, gymnasium.spaces.Box) and _flat(space) and np.issubdtype(space.dtype, np.floating)):
            raise ValueError(f"{_kind(space)} actions")
        return cls(tuple(map(float, space.low)), tuple(map(float, space.high)))

    @cached_property
    def is_unit(self) -> bool:
        """True if it is [-1, 1] in every dimension, so that nothing is scaled."""
        return all(bounds == (-1.0, 1.0) for bounds in self._bounds)

    @cached_property
    def is_bounded(self) -> bool:
        """True if every dimension has two finite bounds."""
        return bool(self._finite.all())

    def normalized(self, actions: FloatArray) -> FloatArray:
        """Actions ``[..., act]`` from the environment's units to a method's; those outside the box leave [-1, 1].

        A dimension of a single value becomes 0.
        """
        if self.is_unit:
            return actions
        center, half = self._scale
        scaled: FloatArray = ((actions - center) / np.where(half > 0.0, half, 1.0)).astype(np.float32)
        return scaled

    def in_units(self, actions: FloatArray) -> FloatArray:
        """A method's actions ``[..., act]`` in the environment's units, inside the box."""
        if self.is_unit:
            return actions
        center, half = self._scale
        scaled: FloatArray = np.clip(center + half * actions, self.low, self.high).astype(np.float32)
        return scaled

    @property
    def identity(self) -> dict[str, list[float | None]]:
        """The bounds as plain JSON data; None where there is no bound."""
        return {
            name: [value if math.isfinite(value) else None for value in values]
            for name, values in (("low", self.low), ("high", self.high))
        }

    @classmethod
    def from_identity(cls, identity: Mapping[str, Sequence[float | None]]) -> ActionBox:
        """The box behind its `identity`."""
        low, high = (
            tuple(none if value is None else value for value in identity[name])
            for name, none in (("low", -math.inf), ("high", math.inf))
        )
        return cls(low, high)

    @property
    def scaling(self) -> str:
        """Description of the bounds and of the scaling."""
        how = "scaled from and to a method's [-1, 1]"
        if not self._finite.any():
            return f"{self}, not scaled: there are no two bounds"
        return f"{self}, {how}{'' if self.is_bounded else ' where there are two bounds'}"

    def __str__(self) -> str:
        """``[-2, 2]``, or ``[0, 1] x [-2, 2]`` where dimensions differ."""
        different = dict.fromkeys(f"[{low:g}, {high:g}]" for low, high in self._bounds)
        return " x ".join(different if len(different) == 1 else (f"[{low:g}, {high:g}]" for low, high in self._bounds))

    @property
    def _bounds(self) -> list[tuple[float, float]]:
        return list(zip(self.low, self.high, strict=True))

    @cached_property
    def _finite(self) -> NDArray[np.bool_]:
        finite: NDArray[np.bool_] = np.isfinite(self.low) & np.isfinite(self.high)
        return finite

    @cached_property
    def _scale(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Center and half the width, ``[act]`` each."""
        low, high = (np.where(self._finite, bound, one) for bound, one in ((self.low, -1.0), (self.high, 1.0)))
        return (low + high) / 2.0, (high - low) / 2.0


@dataclass(frozen=True)
class Spaces:
    """Spaces of an environment's observations and actions.

    Attributes:
        observation: numbers of one observation.
        actions: the box of one action.
    """

    observation: int
    actions: ActionBox

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of one row of ``observations`` and of ``actions``."""
        return {"observations": (self.observation,), "actions": (len(self.actions.low),)}


@dataclass(frozen=True)
class Environment:
    """A simulator task and the two returns that define its normalised score.

    Attributes:
        name: short name, e.g. ``hopper``.
        id: the Gymnasium id that is built, e.g. ``Hopper-v5``, with the module that registers it before a colon where
            Gymnasium does not know it by itself; every record names it.
        horizon: steps after which an episode is cut (truncated).
        random_return: return that scores 0.
        expert_return: return that scores 100.
        arguments: keyword arguments of ``gymnasium.make``.
    """

    name: str
    id: str
    horizon: int
    random_return: float
    expert_return: float
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.horizon < 1:
            raise ValueError(f"environment '{self.name}' has horizon {self.horizon}; it must be at least 1")
        if not (math.isfinite(self.random_return) and math.isfinite(self.expert_return)):
            raise ValueError(f"environment '{self.name}' has a reference return that is not finite")
        if self.random_return == self.expert_return:
            raise ValueError(f"environment '{self.name}' has two equal reference returns, so no score")
        try:
            json.dumps(dict(self.arguments), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"environment '{self.name}' has arguments that are not plain JSON: {error}") from error

    def make(self) -> gymnasium.Env[Any, Any]:
        """A fresh environment, cut at `horizon`."""
        import gymnasium

        with _without_version_warnings():
            return gymnasium.make(self.id, max_episode_steps=self.horizon, **self.arguments)

    def make_many(self, count: int) -> gymnasium.vector.VectorEnv[Any, Any, Any] | None:
        """`count` environments that step together, each cut at `horizon`; None where the simulator has no such form."""
        import gymnasium

        module, _, name = self.id.rpartition(":")
        if module:
            importlib.import_module(module)  # which registers it, as `gymnasium.make` has it do
        if gymnasium.spec(name).vector_entry_point is None:
            return None
        with _without_version_warnings():
            return gymnasium.make_vec(
                name,
                num_envs=count,
                vectorization_mode=gymnasium.VectorizeMode.VECTOR_ENTRY_POINT,
                max_episode_steps=self.horizon,
                **self.arguments,
            )

    @property
    def spaces(self) -> Spaces:
        """Spaces of a fresh simulator.

        Raises:
            UserError: the environment does not exist, cannot be made, or is not one of flat vectors.
        """
        return _spaces(self.id, json.dumps(dict(self.arguments), sort_keys=True))

    def normalized_score(self, episode_return: float) -> float:
        """Score ``100 (return - random) / (expert - random)``."""
        return 100.0 * (episode_return - self.random_return) / (self.expert_return - self.random_return)


@contextmanager
def _without_version_warnings() -> Iterator[None]:
    """Gymnasium's warning about older versions suppressed: published data was made on them."""
    import gymnasium

    level = gymnasium.logger.min_level
    gymnasium.logger.min_level = gymnasium.logger.ERROR
    try:
        yield
    finally:
        gymnasium.logger.min_level = level


@cache
def _spaces(identifier: str, arguments: str) -> Spaces:
    import gymnasium

    module, _, name = identifier.rpartition(":")
    try:
        if module:
            importlib.import_module(module)
    except (Exception, SystemExit) as error:
        raise UserError(
            f"The environment '{identifier}' needs the module {module}, which cannot be imported: "
            f"{type(error).__name__}: {error}.",
            "Install it, or correct its name before the colon.",
        ) from error
    try:
        with _without_version_warnings():
            simulator = gymnasium.make(name, **json.loads(arguments))
    except gymnasium.error.UnregisteredEnv as error:
        close = difflib.get_close_matches(name, gymnasium.registry, n=3)
        raise UserError(
            f"There is no environment '{name}'.",
            f"Did you mean {' or '.join(close)}?"
            if close
            else "Name the module that registers it before a colon: module:Name-v0.",
        ) from error
    except (Exception, SystemExit) as error:
        raise UserError(
            f"The environment '{identifier}' cannot be made: {type(error).__name__}: {error}.",
            "Fix it, or its arguments in the suite.",
        ) from error
    observations, actions = simulator.observation_space, simulator.action_space
    simulator.close()
    try:
        if not _flat(observations):
            raise ValueError(f"{_kind(observations)} observations")
        return Spaces(observations.shape[0] if observations.shape else 0, ActionBox.of(actions))
    except ValueError as error:
        raise UserError(
            f"The environment '{identifier}' has {error}; supported are flat vectors of numbers, for observations and "
            "for actions (a Box of one dimension, of floats for actions).",
            "Register a wrapper of it that has those, e.g. gymnasium.wrappers.FlattenObservation.",
        ) from error


def _flat(space: gymnasium.Space[Any]) -> bool:
    import gymnasium

    return isinstance(space, gymnasium.spaces.Box) and len(space.shape) == 1


def _kind(space: gymnasium.Space[Any]) -> str:
    """``Dict``, ``Discrete``, ``Box (64, 64, 3) of uint8``."""
    import gymnasium

    shape = f" {space.shape} of {space.dtype}" if isinstance(space, gymnasium.spaces.Box) else ""
    return f"{type(space).__name__}{shape}"
