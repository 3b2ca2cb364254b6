"""Where policies act: a simulator task, its horizon, and the two returns behind its normalised score."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import gymnasium


@dataclass(frozen=True)
class Environment:
    """A simulator task and the two returns that define its normalised score.

    Attributes:
        name: the field's short name, e.g. ``hopper``.
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

        with _no_word_of_age():
            return gymnasium.make(self.id, max_episode_steps=self.horizon, **self.arguments)

    def make_many(self, count: int) -> gymnasium.vector.VectorEnv[Any, Any, Any] | None:
        """`count` environments that step together, each cut at `horizon`; None where the simulator has no such form."""
        import gymnasium

        module, _, name = self.id.rpartition(":")
        if module:
            importlib.import_module(module)  # which registers it, as `gymnasium.make` has it do
        if gymnasium.spec(name).vector_entry_point is None:
            return None
        with _no_word_of_age():
            return gymnasium.make_vec(
                name,
                num_envs=count,
                vectorization_mode=gymnasium.VectorizeMode.VECTOR_ENTRY_POINT,
                max_episode_steps=self.horizon,
                **self.arguments,
            )

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of one row of ``observations`` and of ``actions``, as a fresh simulator has them."""
        simulator = self.make()
        spaces = {"observations": simulator.observation_space, "actions": simulator.action_space}
        simulator.close()
        return {field: tuple(space.shape or ()) for field, space in spaces.items()}

    def normalized_score(self, episode_return: float) -> float:
        """Score ``100 (return - random) / (expert - random)`` (methods.md 5.1; D4RL's definition)."""
        return 100.0 * (episode_return - self.random_return) / (self.expert_return - self.random_return)


@contextmanager
def _no_word_of_age() -> Iterator[None]:
    """An environment of an older version is asked for on purpose: published data was made on it."""
    import gymnasium

    level = gymnasium.logger.min_level
    gymnasium.logger.min_level = gymnasium.logger.ERROR
    try:
        yield
    finally:
        gymnasium.logger.min_level = level
