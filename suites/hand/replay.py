"""Files that others made in these simulations, played again: what the adapted environments say to the same actions.

They are D4RL's layout with the simulator's state beside it: ``infos/qpos`` and ``infos/qvel`` ``[N, joints]`` before
every step, or ``infos/init_…`` ``[E, …]`` at the start of every episode.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import h5py
import numpy as np
from numpy.typing import NDArray

from suites.demonstrators.measure import Act
from suites.hand import identifier

Array = NDArray[np.float64]

FIRST_SEED = 30_000
"""Of the reset of the files' first episode; the next is one more."""
LONGEST = 1_000
"""Steps of no demonstration."""


@dataclass(frozen=True)
class Played:
    """Episodes.

    Attributes:
        returns: ``[E]``.
        successful_steps: ``[E]``; an episode succeeds that has one, as in the files' own account.
    """

    returns: Array
    successful_steps: NDArray[np.int64]

    @property
    def success(self) -> float:
        """Share of episodes that succeeded."""
        return float((self.successful_steps > 0).mean())

    @property
    def standard_error(self) -> float:
        """Of the mean return."""
        return float(self.returns.std(ddof=1) / np.sqrt(len(self.returns)))


def act_out(environment: str, act: Act, seeds: range) -> Played:
    """One episode per seed, which decides its start and the policy's noise."""
    simulator = gymnasium.make(identifier(environment))
    returns, successes = np.zeros(len(seeds)), np.zeros(len(seeds), np.int64)
    for episode, seed in enumerate(seeds):
        generator = np.random.default_rng(seed)
        observation, _ = simulator.reset(seed=seed)
        over = False
        while not over:
            action = act(observation.astype(np.float32), generator)
            observation, reward, terminated, truncated, information = simulator.step(action)
            returns[episode] += float(reward)
            successes[episode] += information["success"]
            over = terminated or truncated
    simulator.close()
    return Played(returns, successes)


def recorded(file: Path) -> Played:
    """What a file says of its own episodes."""
    with h5py.File(file) as root:
        ends = np.flatnonzero(root["terminals"][:] | root["timeouts"][:])
        starts = np.concatenate(([0], ends[:-1] + 1))
        rewards = root["rewards"][:].astype(np.float64)
        successes = root["infos/success"][:] if "success" in root["infos"] else np.zeros(len(rewards), np.bool_)
    return Played(np.add.reduceat(rewards, starts), np.add.reduceat(successes.astype(np.int64), starts))


def step_by_step(environment: str, file: Path, episodes: range, steps: int) -> tuple[Array, Array]:
    """Every step of some episodes from its stored state: differences of rewards and of next observations, ``[n]``.

    The stored state is float32 and lacks what the contact solver remembers, so a step in contact differs a little.

    Args:
        environment: the file's.
        file: whose episodes are of one length.
        episodes: which of them.
        steps: of each, from its first on.
    """
    simulator = gymnasium.make(identifier(environment))
    inner: Any = simulator.unwrapped
    of_reward, of_observation = [], []
    with h5py.File(file) as root:
        length = int(np.flatnonzero(root["timeouts"][:])[0]) + 1
        for episode in episodes:
            simulator.reset(seed=FIRST_SEED + episode)  # which puts the target in its place
            rows = slice(episode * length, episode * length + steps)
            stored = (root[name][rows] for name in ("infos/qpos", "infos/qvel", "actions", "rewards"))
            for *state, action, reward, following in zip(*stored, root["next_observations"][rows], strict=True):
                inner.set_state(*(part.astype(np.float64) for part in state))
                observation, found, *_ = simulator.step(action)
                of_reward.append(abs(float(found) - reward))
                of_observation.append(np.abs(observation - following).max())
    simulator.close()
    return np.array(of_reward), np.array(of_observation)


def open_loop(file: Path, episodes: range) -> Played:
    """Human demonstrations of door, their actions clipped to [-1, 1], each from its stored start."""
    simulator = gymnasium.make(identifier("door"), max_episode_steps=LONGEST)
    inner: Any = simulator.unwrapped
    returns, successes = np.zeros(len(episodes)), np.zeros(len(episodes), np.int64)
    with h5py.File(file) as root:
        stops = np.flatnonzero(root["timeouts"][:]) + 1
        starts = np.concatenate(([0], stops[:-1]))
        for place, episode in enumerate(episodes):
            simulator.reset(seed=episode)
            names = ("qpos", "qvel", "door_body_pos")
            inner.set_env_state({name: root[f"infos/init_{name}"][episode] for name in names})
            for action in np.clip(root["actions"][starts[episode] : stops[episode]], -1.0, 1.0):
                _, reward, _, _, information = simulator.step(action)
                returns[place] += float(reward)
                successes[place] += information["success"]
    simulator.close()
    return Played(returns, successes)
