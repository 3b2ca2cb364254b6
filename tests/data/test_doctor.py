"""What the doctor finds in files that were spoilt on purpose, and what the boundary modes make of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers_files import make_episodes, write_d4rl, write_minari, write_robomimic

from lfobench.contract.episodes import concatenate
from lfobench.data.doctor import diagnose, diagnose_part, rows_inside
from lfobench.data.readers.formats import read
from lfobench.data.readers.robomimic import LOW_DIMENSIONAL
from lfobench.render.diagnosis import summary


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
    assert examined(path, 100) == {"no-timeouts": 3}
    found = diagnose(read(path), 100)
    assert "(0 terminated, 3 not terminated)" in summary(found)
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
    assert texts == {
        "actions-not-finite": "1 row of actions has a NaN or an infinity.",
        "actions-out-of-range": "1 action leaves [-1, 1], the farthest to 1.5; environments clip them, "
        "policies cannot.",
        "gaps": "1 row leads to another observation than the following row has, and no flag ends an episode there "
        "(row 6); the reader does.",
        "early-timeouts": "1 episode was cut by time before the horizon of 11 steps.",
    }


def test_what_is_missing_is_said(tmp_path: Path) -> None:
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
    assert texts["observations-constant"] == "3 columns of observations never change: 1, 3 to 4."
    assert texts["duplicated-episodes"].startswith("2 episodes repeat")


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
