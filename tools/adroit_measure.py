"""Fidelity of the hand's environments, and levels of its policies: ``python -m tools.adroit_measure --data FOLDER``.

The folder holds rollouts ``{pen,door,hammer}-external-expert.hdf5`` of the policies ``policies/*-dapg.npz``, and
``door-human-dapg.hdf5``. Without it, only this project's own policies are measured. Every ± is a standard error; a
success is lasting if D4RL counts it (`LASTING`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import h5py
import numpy as np
from numpy.typing import NDArray

from lfobench.contract.suite import Environment
from suites.adroit import ENVIRONMENTS
from suites.hand import HORIZONS, LASTING, identifier
from suites.hand.levels import LEVELS, demonstrator
from tools.locomotion_measure import Act, Array, Difference, play, standard_error, without_noise
from tools.teachers import read_teacher

FIRST_SEED = 30_000
"""Seed of the reset of the files' first episode; consecutive episodes have consecutive seeds."""
LONGEST = 1_000
"""More steps than any demonstration has."""


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
        """Share of episodes with a successful step, as the files count."""
        return float((self.successful_steps > 0).mean())

    @property
    def lasting_success(self) -> float:
        """Share of episodes that D4RL counts as successful; see `LASTING`."""
        return float((self.successful_steps > LASTING[self.environment]).mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the mean return."""
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
    """Returns and successes that a file records; a file without ``success`` counts as having none."""
    with h5py.File(file) as root:
        ends = np.flatnonzero(root["terminals"][:] | root["timeouts"][:])
        starts = np.concatenate(([0], ends[:-1] + 1))
        rewards = root["rewards"][:].astype(np.float64)
        successes = root["infos/success"][:] if "success" in root["infos"] else np.zeros(len(rewards), np.bool_)
    return Played(environment, np.add.reduceat(rewards, starts), np.add.reduceat(successes.astype(np.int64), starts))


def step_by_step(environment: str, file: Path, episodes: range, steps: int) -> tuple[Array, Array]:
    """Differences of rewards and of next observations ``[n]``, each step replayed from its stored state.

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


def against_files(data: Path, episodes: int) -> Iterator[str]:
    """Teachers here and in their files, from the same starts; then the files' steps, and the human demonstrations."""
    yield "teachers, mean action; difference here less file, paired by start"
    for environment in ENVIRONMENTS:
        yield from _teacher(data, environment, episodes)
    yield "steps from their stored states: difference of rewards and of next observations, median and 99 %"
    for name, horizon in HORIZONS.items():
        for part, steps in (("first", 1), ("all", horizon)):
            found = step_by_step(name, _file(data, name), range(min(episodes, 10)), steps)
            reward, observation = (np.quantile(each, [0.5, 0.99]) for each in found)
            yield f"  {name:8}{part:6}{reward[0]:.1e}, {reward[1]:.1e}; {observation[0]:.1e}, {observation[1]:.1e}"
    human = data / "door-human-dapg.hdf5"
    yield "human demonstrations of door, open loop from their stored states"
    there = recorded("door", human)
    every = range(len(there.returns))
    yield f"  whole: here {_words(open_loop(human, every))}; file {there.returns.mean():.1f}"
    yield f"  first {HORIZONS['door']} steps: here {_words(open_loop(human, every, HORIZONS['door']))}"


def _teacher(data: Path, environment: Environment, episodes: int) -> Iterator[str]:
    name = environment.name
    there = recorded(name, _file(data, name)).first(episodes)
    act = without_noise(read_teacher(data / "policies" / f"{name}-dapg.npz").mean_action)
    here = act_out(environment, act, range(FIRST_SEED, FIRST_SEED + len(there.returns)))
    apart = Difference.between(here.returns, there.returns)
    yield f"  {name:8}here {_words(here)}; file {_words(there)}"
    yield (
        f"  {'':8}difference {apart.mean:+.2f} ± {apart.error:.2f}, median size {apart.median_size:.2g}; "
        f"{abs(apart.mean) / apart.unpaired_error:.2f} standard errors apart if unpaired"
    )


def _file(data: Path, name: str) -> Path:
    return data / f"{name}-external-expert.hdf5"


def _words(played: Played) -> str:
    success = f"success {played.success:.3f}, lasting {played.lasting_success:.3f}"
    return f"{played.returns.mean():.1f} ± {played.standard_error:.1f}, {success}"


def own(episodes: int) -> Iterator[str]:
    """Levels of the policies of the generated data, actions sampled."""
    yield f"generated levels, {episodes} episodes: return, success, score"
    for environment in ENVIRONMENTS:
        for level in LEVELS:
            played = act_out(environment, demonstrator(environment.name, level).act, range(episodes))
            score = environment.normalized_score(float(played.returns.mean()))
            error = 100.0 * played.standard_error / (environment.expert_return - environment.random_return)
            yield f"  {environment.name:8}{level:10}{_words(played)}, score {score:.1f} ± {error:.1f}"


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of the external files")
    parser.add_argument("--episodes", type=int, default=40, help="per policy; of a file, at most what it has")
    arguments = parser.parse_args()
    sections = [own(arguments.episodes)]
    if arguments.data is not None:
        sections.insert(0, against_files(arguments.data, arguments.episodes))
    for section in sections:
        for line in section:
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
