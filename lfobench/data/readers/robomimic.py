"""robomimic's layout: a group per demonstration, with observations by name before and after every step.

``data/demo_<i>/{obs/<name> [T, …], next_obs/<name> [T, …], actions [T, act], rewards [T], dones [T]}``. An observation
is the names of `LOW_DIMENSIONAL`, or those that the user chooses, side by side. No demonstration ends by itself:
robomimic's ``dones`` mark success, and the recording stops.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import h5py
import numpy as np

from lfobench.contract.episodes import Episodes, FloatArray, IntArray
from lfobench.data.readers.arrays import Array, array, in_proportion
from lfobench.data.readers.hdf5 import (
    OTHER,
    FileProblem,
    declared_count,
    has,
    is_group,
    members,
    numbered,
    path_of,
    subgroup,
)
from lfobench.data.readers.reading import (
    Keys,
    Reading,
    arrays_of,
    by_key,
    differing_kinds,
    end_to_end,
    left_out,
    row_numbers,
    same_columns,
    same_rows,
    widths_of,
)

DEMONSTRATION = re.compile(r"demo_([0-9]{1,12})")
FIELDS = ("obs", "next_obs", "actions", "rewards")
LOW_DIMENSIONAL = ("robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos", "object")


def is_robomimic(root: h5py.File) -> bool:
    """True if the file has demonstrations."""
    return (
        "data" in members(root)
        and is_group(root, "data")
        and any(DEMONSTRATION.fullmatch(name) for name in members(subgroup(root, "data")))
    )


def read(root: h5py.File, keys: Keys = None) -> Reading:
    """Every demonstration, by number, its observations made of `keys`.

    Raises:
        FileProblem: naming the field.
    """
    data = subgroup(root, "data")
    names = numbered(data, DEMONSTRATION)
    groups = [subgroup(data, name) for name in names]
    actions = [array(group, "actions", 2) for group in groups]
    rewarded = sum(has(group, "rewards") for group in groups)
    rewards = [array(group, "rewards", 1) for group in groups] if rewarded == len(groups) else []
    chosen = keys or LOW_DIMENSIONAL
    sides = [[subgroup(group, side, _made) for group in groups] for side in ("obs", "next_obs")]
    # Together, so that what is after a step is as wide as what is before it.
    both = arrays_of([*sides[0], *sides[1]], chosen)
    before, after = both[: len(groups)], both[len(groups) :]
    for index, done in enumerate(actions):
        if not done.rows:
            raise FileProblem(f"'data/{names[index]}' has no step", OTHER)
        same_rows([*before[index], *after[index], *rewards[index : index + 1]], done.rows, f"'{done.field}'")
        same_columns(done, actions[0].shape[1], f"'{actions[0].field}'")
    lengths = np.array([done.rows for done in actions], np.int64)
    steps = int(lengths.sum())
    return Reading(
        Episodes(
            _stacked(before, after, lengths),
            end_to_end(actions),
            end_to_end(rewards) if rewards else np.full(steps, np.nan, np.float32),
            lengths,
            np.zeros(len(lengths), np.bool_),
        ),
        "robomimic",
        keys=widths_of(before[0], chosen),
        left_out=left_out(sides[0][0], chosen),
        chosen=keys is not None,
        not_read=(
            *(path_of(groups[0], name) for name in members(groups[0]) if name not in FIELDS),
            *(path_of(data, name) for name in members(data) if not DEMONSTRATION.fullmatch(name)),
            *(name for name in members(root) if name != "data"),
        ),
        rewards=bool(rewards),
        rewardless=len(groups) - rewarded if rewarded else 0,
        timeouts=False,
        kinds=differing_kinds({**by_key(both, chosen), "actions": actions}),
        declared_steps=declared_count(data, "total"),
    )


def _made(there: Sequence[str]) -> str:
    """Remedy for missing observations."""
    return (
        "robomimic's own script writes obs and next_obs from recorded states: dataset_states_to_obs.py, without "
        "--exclude-next-obs."
    )


def _stacked(before: list[list[Array]], after: list[list[Array]], lengths: IntArray) -> FloatArray:
    """Observations of episodes ``[N + E, obs]``, column by column."""
    in_proportion([each for arrays in before for each in arrays])
    widths = [first.shape[1] for first in before[0]]
    stacked = np.empty((int(lengths.sum()) + len(lengths), sum(widths)), np.float32)
    place, last = row_numbers(lengths), np.cumsum(lengths) - 1
    stop = 0
    for column, width in enumerate(widths):
        start, stop = stop, stop + width
        stacked[place, start:stop] = end_to_end([arrays[column] for arrays in before])
        stacked[place[last] + 1, start:stop] = np.concatenate(
            [arrays[column].read(arrays[column].rows - 1) for arrays in after]
        )
    return stacked
