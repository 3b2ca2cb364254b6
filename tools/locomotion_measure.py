"""Levels of policies: return and normalised score over fixed episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.suite import Environment, FloatArray

Array = NDArray[np.float64]
Act = Callable[[FloatArray, np.random.Generator], FloatArray]


def without_noise(mean_action: Callable[[FloatArray], FloatArray]) -> Act:
    """A deterministic policy in the form of a sampled one."""
    return lambda observation, _: mean_action(observation)


@dataclass(frozen=True)
class Measurement:
    """Level over `episodes` episodes, the k-th reset with seed k; ``std`` is over episodes (population).

    Attributes:
        episodes: how many.
        return_mean: undiscounted return.
        return_std: its std.
        score_mean: D4RL-normalised score.
        score_std: its std.
        length_mean: steps per episode.
    """

    episodes: int
    return_mean: float
    return_std: float
    score_mean: float
    score_std: float
    length_mean: float


class Step(NamedTuple):
    """A step of an episode: the observation ``[obs]`` before it, its reward and ``info``."""

    observation: FloatArray
    reward: float
    information: dict[str, Any]


def play(environment: Environment, act: Act, seed: int) -> Iterator[Step]:
    """The steps of one episode; `seed` fixes the start and the noise."""
    simulator = environment.make()
    generator = np.random.default_rng(seed)
    observation, _ = simulator.reset(seed=seed)
    done = False
    while not done:
        state = observation.astype(np.float32)
        observation, reward, terminated, truncated, information = simulator.step(act(state, generator))
        done = terminated or truncated
        yield Step(state, float(reward), information)
    simulator.close()


def returns_and_lengths(environment: Environment, act: Act, episodes: int) -> tuple[Array, Array]:
    """Undiscounted returns and numbers of steps ``[episodes]``, the k-th episode reset with seed k."""
    rewards = [[step.reward for step in play(environment, act, seed)] for seed in range(episodes)]
    return np.array([sum(series) for series in rewards]), np.array([float(len(series)) for series in rewards])


def measure(environment: Environment, act: Act, episodes: int = 100) -> Measurement:
    """The level of a policy, given as a function of one observation ``[obs]`` and a generator."""
    returns, lengths = returns_and_lengths(environment, act, episodes)
    scores = np.array([environment.normalized_score(value) for value in returns])
    return Measurement(
        episodes=episodes,
        return_mean=float(returns.mean()),
        return_std=float(returns.std()),
        score_mean=float(scores.mean()),
        score_std=float(scores.std()),
        length_mean=float(lengths.mean()),
    )


def standard_error(values: Array) -> float:
    """Standard error of the mean of independent values ``[E]``; NaN for a single one."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


@dataclass(frozen=True)
class Difference:
    """Paired difference of episodes with equal starts under two conditions.

    Attributes:
        mean: of the first condition less the second.
        error: standard error of `mean`, from the differences episode by episode.
        unpaired_error: the same for independent samples.
        median_size: median of the differences' absolute values.
    """

    mean: float
    error: float
    unpaired_error: float
    median_size: float

    @classmethod
    def between(cls, one: Array, other: Array) -> Difference:
        """The difference of values ``[E]``, the k-th of both from the same start."""
        differences = one - other
        return cls(
            mean=float(differences.mean()),
            error=standard_error(differences),
            unpaired_error=float(np.hypot(standard_error(one), standard_error(other))),
            median_size=float(np.median(np.abs(differences))),
        )
