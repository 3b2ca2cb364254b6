"""Members that are missing, at any depth, and what an observation is made of where a file leaves a choice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_files import make_episodes, write_d4rl, write_minari, write_robomimic

from lfobench.data.readers import robomimic
from lfobench.data.readers.formats import read
from lfobench.data.readers.hdf5 import FileProblem

EPISODES = make_episodes(terminated=[False] * 3)


def minari_dictionary(path: Path) -> Path:
    """Observations of two columns each under ``position``, ``velocity`` and, deeper, ``goal/place``; and an image."""
    write_minari(path, EPISODES)
    with h5py.File(path, "a") as file:
        for name in file:
            whole = file[name]["observations"][:]
            del file[name]["observations"]
            group = file[name].create_group("observations")
            group["position"], group["velocity"], group["goal/place"] = whole[:, :2], whole[:, 2:], whole[:, :1]
            group["image"] = np.zeros((len(whole), 2, 2, 3), np.uint8)
    return path


def robomimic_file(path: Path, columns: tuple[str, ...] = robomimic.LOW_DIMENSIONAL) -> Path:
    return write_robomimic(path, EPISODES, columns)


def without(field: str) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with h5py.File(path, "a") as file:
            del file[field]

    return spoil


def instead(field: str, data: object) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with h5py.File(path, "a") as file:
            del file[field]
            if data is None:
                file.create_group(field)
            else:
                file[field] = data

    return spoil


@pytest.mark.parametrize(
    ("write", "field", "there"),
    [
        (robomimic_file, "data/demo_0/next_obs", "actions, dones, obs, rewards"),
        (robomimic_file, "data/demo_2/next_obs", "actions, dones, obs, rewards"),
        (robomimic_file, "data/demo_1/actions", "dones, next_obs, obs, rewards"),
        (
            robomimic_file,
            "data/demo_1/next_obs/object",
            "robot0_eef_pos, robot0_eef_quat, robot0_gripper_qpos",
        ),
        (lambda path: write_minari(path, EPISODES), "episode_0/observations", "actions, rewards, term"),
        (lambda path: write_minari(path, EPISODES), "episode_2/actions", "observations, rewards, term"),
        (lambda path: write_minari(path, EPISODES), "episode_1/truncations", "actions, observations, rewards"),
        (lambda path: write_minari(path, EPISODES, True), "episode_1/observations", "actions, rewards"),
        (lambda path: write_d4rl(path, EPISODES), "terminals", "actions, next_observations, observations"),
    ],
)
def test_what_is_missing_is_named_with_what_is_there(
    tmp_path: Path, write: Callable[[Path], Path], field: str, there: str
) -> None:
    path = write(tmp_path / "file.hdf5")
    without(field)(path)
    with pytest.raises(FileProblem) as caught:
        read(path, 9)
    assert f"'{field}'" in caught.value.cause and f"there: {there}" in caught.value.cause
    assert "download" not in caught.value.remedy


def test_the_remedy_names_robomimic_s_script_for_next_observations(tmp_path: Path) -> None:
    path = robomimic_file(tmp_path / "file.hdf5")
    without("data/demo_0/next_obs")(path)
    with pytest.raises(FileProblem) as caught:
        read(path)
    assert "dataset_states_to_obs.py" in caught.value.remedy and "--exclude-next-obs" in caught.value.remedy


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (instead("episode_1/observations", None), "'episode_1/observations'.*array"),
        (instead("episode_1", np.zeros(3)), "'episode_1'.*group"),
        (instead("episode_2/observations", np.zeros(10)), "'episode_2/observations' has 1 .*2"),
        (instead("episode_0/rewards", np.zeros((7, 1))), "'episode_0/rewards' has 2 .*1"),
    ],
)
def test_members_of_another_kind(tmp_path: Path, spoil: Callable[[Path], None], named: str) -> None:
    path = write_minari(tmp_path / "file.hdf5", EPISODES)
    spoil(path)
    with pytest.raises(FileProblem, match=named):
        read(path)


def test_a_dictionary_without_the_usual_member_says_what_to_choose(tmp_path: Path) -> None:
    path = minari_dictionary(tmp_path / "file.hdf5")
    with pytest.raises(FileProblem) as caught:
        read(path)
    assert "'episode_0/observations/observation'" in caught.value.cause
    assert "there: goal, image, position, velocity" in caught.value.cause
    assert "keys=goal+image in --source" in caught.value.remedy


def test_chosen_keys_lie_side_by_side_in_their_order(tmp_path: Path) -> None:
    path = minari_dictionary(tmp_path / "file.hdf5")
    found = read(path, keys=("velocity", "position"))
    np.testing.assert_array_equal(found.episodes.observations, EPISODES.observations[:, [2, 3, 0, 1]])
    assert (found.keys, found.left_out) == ({"velocity": 2, "position": 2}, {"goal": 0, "image": 0})
    assert found.chosen
    deeper = read(path, keys=("goal/place", "velocity"))
    np.testing.assert_array_equal(deeper.episodes.observations, EPISODES.observations[:, [0, 2, 3]])
    assert deeper.left_out == {"image": 0, "position": 2}


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        (("position", "speed"), "'episode_0/observations/speed'"),
        (("goal",), "'episode_0/observations/goal'.*array"),
        (("goal/there",), "'episode_0/observations/goal/there'"),
        (("image",), "'episode_0/observations/image' has 4"),
        (("..",), "episode_0/observations/.."),
        (("/",), "episode_0/observations"),
    ],
)
def test_keys_that_are_not_there(tmp_path: Path, keys: tuple[str, ...], named: str) -> None:
    with pytest.raises(FileProblem, match=named):
        read(minari_dictionary(tmp_path / "file.hdf5"), keys=keys)


@pytest.mark.parametrize("write", [write_minari, write_d4rl])
def test_a_file_without_a_choice(tmp_path: Path, write: Callable[..., Path]) -> None:
    with pytest.raises(FileProblem, match="keys"):
        read(write(tmp_path / "file.hdf5", EPISODES), keys=("position",))


def test_robomimic_says_what_it_leaves_out(tmp_path: Path) -> None:
    usual = robomimic.LOW_DIMENSIONAL
    path = write_robomimic(
        tmp_path / "file.hdf5", make_episodes(observation=6), (*usual, "robot1_eef_pos", "robot1_joint")
    )
    found = read(path)
    assert found.keys == dict.fromkeys(usual, 1)
    assert found.left_out == {"robot1_eef_pos": 1, "robot1_joint": 1} and not found.chosen
    two = read(path, keys=("robot1_joint", "object"))
    np.testing.assert_array_equal(two.episodes.observations, make_episodes(observation=6).observations[:, [5, 3]])


def test_rewards_may_be_missing(tmp_path: Path) -> None:
    for path in (write_minari(tmp_path / "minari.hdf5", EPISODES), robomimic_file(tmp_path / "robomimic.hdf5")):
        prefix = "episode_" if path.stem == "minari" else "data/demo_"
        without(f"{prefix}1/rewards")(path)
        found = read(path)
        assert (found.rewards, found.rewardless) == (False, 1)
        assert np.isnan(found.episodes.rewards).all()
        for index in (0, 2):
            without(f"{prefix}{index}/rewards")(path)
        assert (read(path).rewards, read(path).rewardless) == (False, 0)
        np.testing.assert_array_equal(read(path).episodes.observations, EPISODES.observations)


def rename(path: Path, spell: Callable[[int], str]) -> None:
    with h5py.File(path, "a") as file:
        for index in range(3):
            file.move(f"episode_{index}", f"old_{index}")
        for index in range(3):
            file.move(f"old_{index}", spell(index))


def test_numbers_padded_with_zeros_are_read(tmp_path: Path) -> None:
    path = write_minari(tmp_path / "file.hdf5", EPISODES)
    rename(path, lambda index: f"episode_{index:05d}")
    np.testing.assert_array_equal(read(path).episodes.observations, EPISODES.observations)


@pytest.mark.parametrize(
    ("spell", "named"),
    [
        (lambda index: f"episode_{index + 1}", "episode 0 .*episode_3.* 3 of 4"),
        (lambda index: f"episode_{10**11 * index}", "episode 1 "),
        (
            lambda index: ("episode_0", "episode_00", "episode_1")[index],
            "'episode_0'.*'episode_00'.*0",
        ),
    ],
)
def test_numbers_with_gaps_and_twice(tmp_path: Path, spell: Callable[[int], str], named: str) -> None:
    path = write_minari(tmp_path / "file.hdf5", EPISODES)
    rename(path, spell)
    with pytest.raises(FileProblem, match=named):
        read(path)
