"""Small data files in the layouts of D4RL, Minari and robomimic, for tests to read and to spoil."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from lfobench.contract.episodes import Episodes

LENGTHS, TERMINATED = (7, 4, 9), (False, True, False)


def make_episodes(
    lengths: Sequence[int] = LENGTHS, terminated: Sequence[bool] = TERMINATED, observation: int = 4, action: int = 2
) -> Episodes:
    """Random episodes of which no two values are equal."""
    generator = np.random.default_rng(7)
    steps = sum(lengths)
    return Episodes(
        generator.normal(size=(steps + len(lengths), observation)).astype(np.float32),
        generator.uniform(-1, 1, (steps, action)).astype(np.float32),
        generator.normal(size=steps).astype(np.float32),
        np.array(lengths, np.int64),
        np.array(terminated, np.bool_),
    )


def write_d4rl(path: Path, episodes: Episodes, leave_out: Sequence[str] = (), **storage: object) -> Path:
    """Flat arrays; `storage` is how h5py stores each."""
    last = np.cumsum(episodes.lengths) - 1
    terminals, timeouts = np.zeros((2, episodes.transitions), np.bool_)
    terminals[last[episodes.terminated]] = True
    timeouts[last[~episodes.terminated]] = True
    here = episodes.observation_of_transition
    arrays = {
        "observations": episodes.observations[here],
        "next_observations": episodes.observations[here + 1],
        "actions": episodes.actions,
        "rewards": episodes.rewards,
        "terminals": terminals,
        "timeouts": timeouts,
    }
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            if name not in leave_out:
                file.create_dataset(name, data=values, **storage)
    return path


def write_minari(path: Path, episodes: Episodes, in_dictionary: bool = False) -> Path:
    """A group per episode; observations in a dictionary where asked for."""
    with h5py.File(path, "w") as file:
        for index, (first, begin, length) in enumerate(
            zip(episodes.first_observation, episodes.first_transition, episodes.lengths, strict=True)
        ):
            group = file.create_group(f"episode_{index}")
            target = group.create_group("observations") if in_dictionary else group
            target["observation" if in_dictionary else "observations"] = episodes.observations[
                first : first + length + 1
            ]
            group["actions"] = episodes.actions[begin : begin + length]
            group["rewards"] = episodes.rewards[begin : begin + length]
            for name, ended in (
                ("terminations", episodes.terminated[index]),
                ("truncations", ~episodes.terminated[index]),
            ):
                marks = np.zeros(length, np.bool_)
                marks[-1] = ended
                group[name] = marks
    return path


def write_robomimic(path: Path, episodes: Episodes, columns: Sequence[str]) -> Path:
    """A group per demonstration; every column is an observation of its own name."""
    with h5py.File(path, "w") as file:
        for index, (first, begin, length) in enumerate(
            zip(episodes.first_observation, episodes.first_transition, episodes.lengths, strict=True)
        ):
            group = file.create_group(f"data/demo_{index}")
            for name, start in (("obs", first), ("next_obs", first + 1)):
                for column, key in enumerate(columns):
                    group[f"{name}/{key}"] = episodes.observations[start : start + length, column : column + 1]
            group["actions"] = episodes.actions[begin : begin + length]
            group["rewards"] = episodes.rewards[begin : begin + length]
            group["dones"] = np.zeros(length, np.int64)
    return path
