"""What the doctor finds in files that were spoilt on purpose, and what the boundary modes make of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_files import make_episodes, write_d4rl, write_lerobot, write_minari, write_robomimic

from lfobench.analyses.diagnosis import summary
from lfobench.contract.episodes import concatenate
from lfobench.data.doctor import diagnose, diagnose_part, rows_inside, too_short
from lfobench.data.readers.formats import read
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.data.readers.reading import check
from lfobench.data.readers.robomimic import LOW_DIMENSIONAL


def examined(path: Path, horizon: int | None = 9) -> dict[str, int]:
    return {finding.code: finding.count for finding in diagnose(read(path, horizon), horizon).findings}


def change(field: str, row: int | slice, value: object) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with h5py.File(path, "a") as file:
            file[field][row] = value

    return spoil


@pytest.mark.parametrize(
    ("spoil", "code", "count"),
    [
        (change("observations", 3, np.nan), "observations-not-finite", 1),
        (change("rewards", slice(0, 2), np.inf), "rewards-not-finite", 2),
        (change("actions", slice(2, 5), 1.5), "actions-out-of-range", 3),
        (change("next_observations", 3, np.nan), "next_observations-not-finite", 1),
        (change("timeouts", 6, False), "gaps", 1),
        (change("timeouts", slice(2, 4), True), "misplaced-timeouts", 2),
        (change("timeouts", 19, False), "unfinished", 1),
        (change("terminals", 6, True), "both-flags", 1),
    ],
)
def test_what_was_spoilt_is_found(tmp_path: Path, spoil: Callable[[Path], None], code: str, count: int) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    before = examined(path)
    spoil(path)
    assert code not in before
    assert examined(path)[code] == count


def test_ends_are_held_against_the_horizon(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes((7, 4, 9), (False, True, False)))
    assert examined(path, 9) == {"early-timeouts": 1}
    assert examined(path, 4) == {"longer-than-horizon": 2, "terminal-at-horizon": 1}
    assert examined(path, None) == {}


def test_a_nan_is_told_as_one_and_not_as_a_gap(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    change("observations", 8, np.nan)(path)
    assert examined(path, None) == {"observations-not-finite": 1}


def test_an_unknown_next_observation_proves_no_time_out_misplaced(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    for row in (6, 19):
        change("next_observations", row, np.nan)(path)
    assert "misplaced-timeouts" not in examined(path, None)


def test_where_no_file_says_it_nothing_is_called_cut_by_time(tmp_path: Path) -> None:
    path = write_robomimic(tmp_path / "file.hdf5", make_episodes(terminated=[False] * 3), LOW_DIMENSIONAL)
    assert examined(path, 100) == {"no-timeouts": 3, "not-read": 1}
    found = diagnose(read(path), 100)
    assert "0 terminated, 3 not terminated" in summary(found)
    assert not any("time ended" in reason for mode in found.modes for reason in mode.dropped)


def test_a_part_that_a_protocol_shortened_may_end_anywhere() -> None:
    part = make_episodes((9, 7, 9), (False, False, False))
    codes = {finding.code: finding.count for finding in diagnose_part(part.first_transitions(20), 9).findings}
    assert codes == {"early-timeouts": 1}


def test_one_is_singular_and_what_is_infinite_is_no_farthest(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    for field, row, value in (("actions", 2, 1.5), ("actions", 9, np.inf), ("timeouts", 6, False)):
        change(field, row, value)(path)
    texts = {finding.code: finding.text for finding in diagnose(read(path, 11), 11).findings}
    facts = {
        "actions-not-finite": ("1 row ", "actions", "NaN"),
        "actions-out-of-range": ("1 action ", "[-1, 1]", "1.5"),
        "gaps": ("1 row ", "row 6"),
        "early-timeouts": ("1 episode ", "11 steps"),
    }
    assert texts.keys() == facts.keys()
    assert all(fact in texts[code] for code, of_code in facts.items() for fact in of_code)


def test_missing_fields_are_findings(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes(), ["timeouts", "next_observations", "rewards"])
    assert examined(path) == {"no-timeouts": 3, "ends-unknown": 3, "no-rewards": 1}
    diagnosis = diagnose(read(path, 9), 9)
    assert (diagnosis.returns, diagnosis.usable) == ((), True)


def test_constant_columns_and_repeated_episodes(tmp_path: Path) -> None:
    episodes = make_episodes(observation=6)
    episodes.observations[:, [1, 3, 4]] = 2.0
    twice = concatenate([episodes, episodes.first_episodes(2)])
    found = diagnose(read(write_minari(tmp_path / "file.hdf5", twice)))
    texts = {finding.code: finding.text for finding in found.findings}
    assert texts["observations-constant"].startswith("3 columns") and "1, 3 to 4" in texts["observations-constant"]
    assert texts["duplicated-episodes"].startswith("2 episodes")


def test_problems_come_first_and_make_a_file_unusable(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    change("actions", 2, 1.5)(path)
    change("actions", 9, np.nan)(path)
    found = diagnose(read(path, 4), 4)
    assert [finding.severity for finding in found.findings][:2] == ["problem", "caution"]
    assert not found.usable


def test_every_mode_accounts_for_every_row(tmp_path: Path) -> None:
    for leave_out in ((), ("next_observations",)):
        path = write_d4rl(tmp_path / "file.hdf5", make_episodes((3, 1, 4, 2), (True, False, False, True)), leave_out)
        modes = {mode.name: mode for mode in diagnose(read(path)).modes}
        assert all(mode.kept + sum(mode.dropped.values()) == 10 for mode in modes.values()), modes
        assert modes["released pairs"].dropped == {
            "last steps of episodes that time ended": 2,
            "last row of the file": 1,
        }
        assert modes["released triples"].odd == {"lead into the next episode": 1}


def test_expert_rows_inside_the_offline_part() -> None:
    expert, other = make_episodes(), make_episodes((5,), (False,), 4, 2)
    other = replace(other, actions=other.actions + 1)
    assert rows_inside(expert, concatenate([other, expert.first_episodes(2)])) == 11
    assert rows_inside(expert, other) == 0


def test_terminals_that_lead_into_the_next_episode(tmp_path: Path) -> None:
    """As in a file that was saved after D4RL's Q-learning view; the last row leads nowhere that could be compared."""
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes((7, 4, 9), (True, True, True)))
    with h5py.File(path, "a") as file:
        for row in (6, 10):
            file["next_observations"][row] = file["observations"][row + 1]
    (finding,) = diagnose(read(path)).findings
    assert (finding.severity, finding.code, finding.count) == ("caution", "terminals-lead-on", 2)
    assert "rows 6 and 10" in finding.text


def test_last_steps_that_lead_to_where_they_began(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        for row in (6, 10, 19):
            file["next_observations"][row] = file["observations"][row]
    assert examined(path, None) == {"last-repeats": 3}
    # An episode that stands still says nothing about its end.
    still = make_episodes()
    still.observations[1:8] = still.observations[0]
    assert "last-repeats" not in examined(write_minari(path, still), None)


def test_last_steps_that_lead_to_zeros(tmp_path: Path) -> None:
    episodes = make_episodes()
    episodes.observations[[7, 22]] = 0.0
    for write in (write_d4rl, write_minari):
        found = diagnose(read(write(tmp_path / "file.hdf5", episodes)))
        assert [(finding.code, finding.count) for finding in found.findings] == [("last-zero", 2)]


@pytest.mark.parametrize("write", [write_d4rl, write_minari])
def test_what_nothing_can_be_learned_from_is_a_problem(tmp_path: Path, write: Callable[..., Path]) -> None:
    found = diagnose(read(write(tmp_path / "file.hdf5", make_episodes([1] * 9, [False] * 9))), 9)
    (problem,) = (finding for finding in found.findings if finding.severity == "problem")
    assert problem.code == "too-short" and "9 rows, 0 " in problem.text
    assert not found.usable


def test_every_next_observation_that_is_the_observation(tmp_path: Path) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        file["next_observations"][:] = file["observations"][:]
    found = diagnose(read(path))
    assert not found.usable
    assert {"too-short", "gaps", "last-repeats"} <= {finding.code for finding in found.findings}


def unmarked(path: Path, episodes: list[int]) -> Path:
    write_minari(path, make_episodes())
    with h5py.File(path, "a") as file:
        for episode in episodes:
            for name in ("terminations", "truncations"):
                file[f"episode_{episode}"][name][:] = False
    return path


@pytest.mark.parametrize(
    ("episodes", "severity", "facts"),
    [
        ([1], "caution", ("1 episode ", "episode 1)")),
        ([0, 1, 2], "caution", ("3 episodes ", "episode 0)")),
        ([0, 2], "caution", ("2 episodes ", "episode 0)")),
        ([2], "note", ("last episode",)),
    ],
)
def test_ends_that_are_missing_are_counted(
    tmp_path: Path, episodes: list[int], severity: str, facts: tuple[str, ...]
) -> None:
    found = diagnose(read(unmarked(tmp_path / "file.hdf5", episodes)), 10)
    (finding,) = (each for each in found.findings if each.code == "unfinished")
    assert (finding.severity, finding.count) == (severity, len(episodes))
    assert all(fact in finding.text for fact in facts)
    # What has no end was not cut by time either.
    early = sum(each.count for each in found.findings if each.code == "early-timeouts")
    assert early == len({0, 2} - set(episodes))


def test_what_is_left_out_is_named(tmp_path: Path) -> None:
    columns = (*LOW_DIMENSIONAL, "robot1_eef_pos", "robot1_eef_quat")
    path = write_robomimic(tmp_path / "file.hdf5", make_episodes(terminated=[False] * 3, observation=6), columns)
    for keys, severity, said in (
        (None, "caution", "object (1): 4 of 6 columns. Left out: robot1_eef_pos (1), robot1_eef_quat (1)."),
        (("object",), "note", "An observation is object (1): 1 of 6 columns. Left out: robot0_eef_pos (1), "),
    ):
        (finding,) = (each for each in diagnose(read(path, keys=keys)).findings if each.code == "keys-left-out")
        assert finding.severity == severity and said in finding.text
        assert ("--keys" in finding.text) == (keys is None)
    assert "keys-left-out" not in {each.code for each in diagnose(read(path, keys=columns)).findings}


def test_columns_groups_and_masks_that_are_not_read(tmp_path: Path) -> None:
    files = {
        "infos, \\x1b[2Jname": write_d4rl(tmp_path / "d4rl.hdf5", make_episodes()),
        "episode_0/infos, splits": write_minari(tmp_path / "minari.hdf5", make_episodes()),
        "data/demo_0/dones, data/demo_0/states, mask": write_robomimic(
            tmp_path / "robomimic.hdf5", make_episodes(), LOW_DIMENSIONAL
        ),
    }
    with h5py.File(tmp_path / "d4rl.hdf5", "a") as file:
        file["infos/qpos"], file["\x1b[2Jname"] = np.zeros(20), np.zeros(20)
    with h5py.File(tmp_path / "minari.hdf5", "a") as file:
        file["episode_0/infos/success"], file["splits"] = np.zeros(7), np.zeros(3)
    with h5py.File(tmp_path / "robomimic.hdf5", "a") as file:
        file["data/demo_0/states"], file["mask/train"] = np.zeros((7, 9)), np.zeros(3)
    for said, path in files.items():
        texts = {each.code: each.text for each in diagnose(read(path)).findings}
        assert sorted(texts["not-read"].removeprefix("Not read: ").rstrip(".").split(", ")) == sorted(said.split(", "))


def test_fewer_episodes_than_the_file_says(tmp_path: Path) -> None:
    minari = write_minari(tmp_path / "minari.hdf5", make_episodes())
    with h5py.File(minari, "a") as file:
        file.attrs["total_episodes"], file.attrs["total_steps"] = 5, 20
    assert examined(minari, None) == {"declared-episodes": 2}
    robomimic = write_robomimic(tmp_path / "robomimic.hdf5", make_episodes(terminated=[False] * 3), LOW_DIMENSIONAL)
    with h5py.File(robomimic, "a") as file:
        file["data"].attrs["total"] = np.int32(90)
    assert examined(robomimic, None)["declared-steps"] == 70
    for odd in ("many", 5.5, [1, 2], h5py.Empty("i4")):
        with h5py.File(robomimic, "a") as file:
            file["data"].attrs["total"] = odd
        assert "declared-steps" not in examined(robomimic, None)


def test_the_metadata_of_a_minari_folder_are_held_against_it(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    write_minari(tmp_path / "data" / "main_data.hdf5", make_episodes())
    for said, found in (('{"total_episodes": 4, "total_steps": 20}', {"declared-episodes": 1}), ("[", {}), ("[3]", {})):
        (tmp_path / "data" / "metadata.json").write_text(said)
        assert examined(tmp_path, None) == found


def test_number_types_that_differ(tmp_path: Path) -> None:
    path = write_minari(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        whole = file["episode_1/observations"][:].astype(np.float64)
        del file["episode_1/observations"]
        file["episode_1/observations"] = whole
    (finding,) = diagnose(read(path)).findings
    assert (finding.severity, finding.code) == ("caution", "number-types")
    assert all(fact in finding.text for fact in ("observations", "float32 in 2", "float64 in 1"))


def test_next_observations_of_fewer_digits_continue_an_episode(tmp_path: Path) -> None:
    """Large values in float64, followed in float32: rounding is no gap."""
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    with h5py.File(path, "a") as file:
        steps = np.random.default_rng(3).normal(size=(20, 4)) * 1e4
        following = np.vstack([steps[1:], steps[:1]]).astype(np.float32)
        for name, values in (("observations", steps), ("next_observations", following)):
            del file[name]
            file[name] = values
        file["timeouts"][:] = np.arange(20) == 19
        file["terminals"][:] = False
    reading = read(path)
    assert (reading.episodes.lengths.tolist(), len(reading.gaps)) == ([20], 0)
    assert [finding.code for finding in diagnose(reading).findings] == ["number-types"]


def test_frames_of_lerobot_that_end_elsewhere(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    part = make_episodes((7, 4), (False, False))
    folder = write_lerobot(tmp_path / "dataset", [part], total_episodes=3, total_frames=40)
    codes = {each.code: each.count for each in diagnose(read(folder)).findings}
    assert codes == {
        "keys-left-out": 2,
        "not-read": 3,
        "ends-unknown": 2,
        "no-timeouts": 2,
        "declared-episodes": 1,
        "declared-steps": 29,
    }


SPOILERS: dict[str, Callable[[Path], None]] = {
    "nothing": lambda path: None,
    "an unknown end": change("next_observations", 6, np.nan),
    "the last end": change("next_observations", 19, np.nan),
    "part of an end": lambda path: change("next_observations", 10, [0.0, np.inf, 0.0, 0.0])(path),
    "a next observation": change("next_observations", 3, np.nan),
    "an observation": change("observations", 11, np.inf),
    "an action": change("actions", 0, np.nan),
    "a reward": change("rewards", 5, -np.inf),
    "a huge reward": lambda path: None,
    "short episodes": change("timeouts", slice(None), True),
}


@pytest.mark.parametrize("spoiler", SPOILERS)
def test_the_doctor_refuses_what_a_run_refuses(tmp_path: Path, spoiler: str) -> None:
    path = write_d4rl(tmp_path / "file.hdf5", make_episodes())
    SPOILERS[spoiler](path)
    if spoiler == "a huge reward":
        with h5py.File(path, "a") as file:
            del file["rewards"]
            file["rewards"] = np.full(20, 1e300)
    reading = read(path, 9)
    try:
        check(reading)
        refused = bool(too_short(reading.episodes))
    except FileProblem:
        refused = True
    assert diagnose(reading, 9).usable == (not refused) == (spoiler == "nothing")
