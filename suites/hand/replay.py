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

from lfobench.contract.suite import Environment
from suites.demonstrators.measure import Act, Array, play, standard_error
from suites.hand import LASTING, identifier

FIRST_SEED = 30_000
"""Of the reset of the files' first episode; the next is one more."""
LONGEST = 1_000
"""Steps of no demonstration."""


@dataclass(frozen=True)
class Played:
    """Episodes.

    Attributes:
        environment: its short name.
        returns: ``[E]``.
        successful_steps: ``[E]``.
    """

    environment: str
    returns: Array
    successful_steps: NDArray[np.int64]

    def first(self, episodes: int) -> Played:
        """The first of them, or all where there are fewer."""
        return Played(self.environment, self.returns[:episodes], self.successful_steps[:episodes])

    @property
    def success(self) -> float:
        """Share of episodes with a successful step, as in the files' own account."""
        return float((self.successful_steps > 0).mean())

    @property
    def lasting_success(self) -> float:
        """Share of episodes that succeed in D4RL's own account; see `LASTING`."""
        return float((self.successful_steps > LASTING[self.environment]).mean())

    @property
    def standard_error(self) -> float:
        """Of the mean return."""
        return standard_error(self.returns)


def act_out(environment: Environment, act: Act, seeds: range) -> Played:
    """One episode per seed, which decides its start and the policy's noise."""
    returns, successes = np.zeros(len(seeds)), np.zeros(len(seeds), np.int64)
    for place, seed in enumerate(seeds):
        for step in play(environment, act, seed):
            returns[place] += step.reward
            successes[place] += step.information["success"]
    return Played(environment.name, returns, successes)


def recorded(environment: str, file: Path) -> Played:
    """What a file says of its own episodes; one that tells no success is taken to have none."""
    with h5py.File(file) as root:
        ends = np.flatnonzero(root["terminals"][:] | root["timeouts"][:])
        starts = np.concatenate(([0], ends[:-1] + 1))
        rewards = root["rewards"][:].astype(np.float64)
        successes = root["infos/success"][:] if "success" in root["infos"] else np.zeros(len(rewards), np.bool_)
    return Played(environment, np.add.reduceat(rewards, starts), np.add.reduceat(successes.astype(np.int64), starts))


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


def open_loop(file: Path, episodes: range, steps: int = LONGEST) -> Played:
    """Human demonstrations of door, their actions clipped to [-1, 1], each from its stored start.

    Args:
        file: in which they are.
        episodes: which of them.
        steps: of each, from its first on.
    """
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
            actions = root["actions"][starts[episode] : stops[episode]]
            for action in np.clip(actions[:steps], -1.0, 1.0):
                _, reward, _, _, information = simulator.step(action)
                returns[place] += float(reward)
                successes[place] += information["success"]
    simulator.close()
    return Played("door", returns, successes)
