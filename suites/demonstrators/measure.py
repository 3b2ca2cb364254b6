"""What a policy's level is: return and normalised score over fixed episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from lfobench.contract.suite import Environment, FloatArray

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


def episode(environment: Environment, act: Act, seed: int) -> Iterator[tuple[FloatArray, float]]:
    """Observation ``[obs]`` and reward of each step of one episode; `seed` fixes the start and the noise."""
    simulator = environment.make()
    generator = np.random.default_rng(seed)
    observation, _ = simulator.reset(seed=seed)
    done = False
    while not done:
        state = observation.astype(np.float32)
        observation, reward, terminated, truncated, _ = simulator.step(act(state, generator))
        done = terminated or truncated
        yield state, float(reward)
    simulator.close()


def measure(environment: Environment, act: Act, episodes: int = 100) -> Measurement:
    """The level of a policy, given as a function of one observation ``[obs]`` and a generator."""
    rewards = [[reward for _, reward in episode(environment, act, seed)] for seed in range(episodes)]
    returns = np.array([sum(series) for series in rewards])
    scores = np.array([environment.normalized_score(value) for value in returns])
    return Measurement(
        episodes=episodes,
        return_mean=float(returns.mean()),
        return_std=float(returns.std()),
        score_mean=float(scores.mean()),
        score_std=float(scores.std()),
        length_mean=float(np.mean([len(series) for series in rewards])),
    )
