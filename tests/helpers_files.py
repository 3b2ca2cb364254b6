"""Small data files in every layout that is read, for tests to read and to spoil."""

from __future__ import annotations

import json
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


def flat_arrays(episodes: Episodes) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
    """Episodes as D4RL's arrays."""
    last = np.cumsum(episodes.lengths) - 1
    terminals, timeouts = np.zeros((2, episodes.transitions), np.bool_)
    terminals[last[episodes.terminated]] = True
    timeouts[last[~episodes.terminated]] = True
    here = episodes.observation_of_transition
    return {
        "observations": episodes.observations[here],
        "next_observations": episodes.observations[here + 1],
        "actions": episodes.actions,
        "rewards": episodes.rewards,
        "terminals": terminals,
        "timeouts": timeouts,
    }


def write_d4rl(path: Path, episodes: Episodes, leave_out: Sequence[str] = (), **storage: object) -> Path:
    """Flat arrays; `storage` is how h5py stores each."""
    with h5py.File(path, "w") as file:
        for name, values in flat_arrays(episodes).items():
            if name not in leave_out:
                file.create_dataset(name, data=values, **storage)
    return path


def write_npz(path: Path, episodes: Episodes, leave_out: Sequence[str] = (), compressed: bool = False) -> Path:
    """Flat arrays of D4RL's names in one archive."""
    arrays = {name: values for name, values in flat_arrays(episodes).items() if name not in leave_out}
    (np.savez_compressed if compressed else np.savez)(path, **arrays)
    return path


def write_npz_folder(folder: Path, episodes: Episodes, flags: bool = True) -> Path:
    """An archive per episode, each of one observation more than actions."""
    folder.mkdir()
    for index, (first, begin, length) in enumerate(
        zip(episodes.first_observation, episodes.first_transition, episodes.lengths, strict=True)
    ):
        arrays = {
            "obs": episodes.observations[first : first + length + 1],
            "acts": episodes.actions[begin : begin + length],
            "rews": episodes.rewards[begin : begin + length],
        }
        last = np.arange(length) == length - 1
        if flags:
            arrays |= {"terminated": last & episodes.terminated[index], "truncated": last & ~episodes.terminated[index]}
        np.savez(folder / f"trajectory_{index}.npz", **arrays)
    return folder


def lerobot_table(episodes: Episodes, first: int = 0) -> dict[str, list[object]]:
    """Episodes as columns of frames, the first of number `first`; the observation's last column is its own feature."""
    seen = episodes.observations[episodes.observation_of_transition]
    numbers = np.repeat(np.arange(len(episodes.lengths)), episodes.lengths)
    frames = np.arange(episodes.transitions) - episodes.first_transition[numbers]
    return {
        "observation.state": seen[:, :-1].tolist(),
        "observation.environment_state": seen[:, -1:].tolist(),
        "action": episodes.actions.tolist(),
        "timestamp": (frames / 10).tolist(),
        "frame_index": frames.tolist(),
        "episode_index": (numbers + first).tolist(),
        "next.reward": episodes.rewards.tolist(),
        "next.done": episodes.last_transition.tolist(),
        "index": list(range(episodes.transitions)),
        "task_index": [0] * episodes.transitions,
    }


def write_lerobot(
    folder: Path, parts: Sequence[Episodes], leave_out: Sequence[str] = (), **information: object
) -> Path:
    """A LeRobot dataset of version 3, a table per part."""
    import pyarrow
    import pyarrow.parquet as parquet

    first = 0
    for number, episodes in enumerate(parts):
        columns = {name: values for name, values in lerobot_table(episodes, first).items() if name not in leave_out}
        types = {
            "observation.state": pyarrow.list_(pyarrow.float32(), episodes.observations.shape[1] - 1),
            "observation.environment_state": pyarrow.list_(pyarrow.float32()),
            "action": pyarrow.list_(pyarrow.float32()),
            "next.reward": pyarrow.float32(),
        }
        arrays = {name: pyarrow.array(values, types.get(name)) for name, values in columns.items()}
        path = folder / "data" / "chunk-000" / f"file-{number:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pyarrow.table(arrays), path)
        first += len(episodes.lengths)
    information = {
        "codebase_version": "v3.0",
        "total_episodes": first,
        "total_frames": sum(part.transitions for part in parts),
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "features": {
            "observation.state": {"dtype": "float32", "shape": [parts[0].observations.shape[1] - 1]},
            "observation.environment_state": {"dtype": "float32", "shape": [1]},
            "observation.image": {"dtype": "video", "shape": [3, 96, 96]},
            "action": {"dtype": "float32", "shape": [parts[0].actions.shape[1]]},
        },
        **information,
    }
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta" / "info.json").write_text(json.dumps(information))
    return folder


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
