"""Minari's layout: a group per episode, which holds one more observation than actions.

``episode_<i>/{observations [T + 1, obs], actions [T, act], rewards [T], terminations [T], truncations [T]}``. Rewards
may be missing, and numbers may be padded with zeros. Observations that are a dictionary, as the kitchen's, are a group;
its member ``observation`` is read, or those that the user chooses.
"""

from __future__ import annotations

import json
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.data.readers.arrays import Array, array
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
    flags,
    left_out,
    no_choice,
    same_columns,
    same_rows,
    side_by_side,
    widths_of,
)

EPISODE = re.compile(r"episode_([0-9]{1,12})")
FIELDS = ("observations", "actions", "rewards", "terminations", "truncations")
IN_DICTIONARY = ("observation",)
METADATA = "metadata.json"
MOST_METADATA = 2**22
"""Bytes of the metadata, at the most."""


def is_minari(root: h5py.File) -> bool:
    """True if the file has a group per episode."""
    return any(EPISODE.fullmatch(name) for name in members(root))


def read(root: h5py.File, keys: Keys = None) -> Reading:
    """Every episode, by number, its observations made of `keys` where they are a dictionary.

    Raises:
        FileProblem: naming the field.
    """
    names = numbered(root, EPISODE)
    if (last := int(names[-1].rpartition("_")[2])) >= len(names):
        there = {int(name.rpartition("_")[2]) for name in names}
        gap = next(number for number in range(last) if number not in there)
        raise FileProblem(
            f"episode {gap:,} is missing, and {names[-1]} is there: it has {len(names):,} of {last + 1:,} episodes",
            "Copy or download it again; or number the episodes from 0 on, if the others were left out on purpose.",
        )
    groups = [subgroup(root, name) for name in names]
    in_dictionary = is_group(groups[0], "observations")
    if keys is not None and not in_dictionary:
        raise no_choice("Minari")
    chosen = (keys or IN_DICTIONARY) if in_dictionary else ()
    observations = _observations(groups, chosen)
    rewarded = sum(has(group, "rewards") for group in groups)
    episodes = [
        _checked(group, arrays, rewarded == len(groups)) for group, arrays in zip(groups, observations, strict=True)
    ]
    actions = [each.actions for each in episodes]
    for done in actions:
        same_columns(done, actions[0].shape[1], f"'{actions[0].field}'")
    lengths = np.array([done.rows for done in actions], np.int64)
    rewards = [each.rewards for each in episodes if each.rewards is not None]
    return Reading(
        Episodes(
            side_by_side(observations),
            end_to_end(actions),
            end_to_end(rewards) if rewards else np.full(int(lengths.sum()), np.nan, np.float32),
            lengths,
            np.array([each.terminated for each in episodes]),
        ),
        "minari",
        keys=widths_of(observations[0], chosen) if chosen else {},
        left_out=left_out(subgroup(groups[0], "observations"), chosen) if chosen else {},
        chosen=keys is not None,
        not_read=(
            *(path_of(groups[0], name) for name in members(groups[0]) if name not in FIELDS),
            *(name for name in members(root) if not EPISODE.fullmatch(name)),
        ),
        rewards=bool(rewards),
        rewardless=len(groups) - rewarded if rewarded else 0,
        endless=np.flatnonzero([not (each.terminated or each.truncated) for each in episodes]),
        both_flags=sum(each.terminated and each.truncated for each in episodes),
        kinds=differing_kinds({**by_key(observations, chosen or ("observations",)), "actions": actions}),
        declared_episodes=_declared(root, "total_episodes"),
        declared_steps=_declared(root, "total_steps"),
    )


def _declared(root: h5py.File, name: str) -> int | None:
    """Count that a dataset declares, in its file or in the metadata next to it."""
    if (count := declared_count(root, name)) is not None:
        return count
    path = Path(root.filename).with_name(METADATA)
    with suppress(OSError, ValueError, RecursionError):
        if path.is_file():
            with path.open("rb") as file:
                metadata = json.loads(file.read(MOST_METADATA))
            if isinstance(metadata, dict) and type(metadata.get(name)) is int:
                return int(metadata[name])
    return None


@dataclass(frozen=True, slots=True)
class _Episode:
    """A checked episode: its arrays, and how it ended."""

    actions: Array
    rewards: Array | None
    terminated: bool
    truncated: bool


def _checked(group: h5py.Group, observations: list[Array], rewarded: bool) -> _Episode:
    actions = array(group, "actions", 2)
    rewards = array(group, "rewards", 1) if rewarded else None
    marks = [array(group, each, 1) for each in ("terminations", "truncations")]
    name = (group.name or "").strip("/")
    if not actions.rows:
        raise FileProblem(f"'{name}' has no step", OTHER)
    same_rows([*marks, *([] if rewards is None else [rewards])], actions.rows, f"'{actions.field}'")
    same_rows(observations, actions.rows + 1, f"'{actions.field}', and one more,")
    marked = [flags(each) for each in marks]
    if any(mark[:-1].any() for mark in marked):
        raise FileProblem(f"'{name}' is marked as ended before its last step", OTHER)
    return _Episode(actions, rewards, *(bool(mark[-1]) for mark in marked))


def _observations(groups: list[h5py.Group], keys: tuple[str, ...]) -> list[list[Array]]:
    """Arrays of observations per episode: one, or one per key."""
    if keys:
        return arrays_of([subgroup(group, "observations") for group in groups], keys)
    return arrays_of(groups, ("observations",))
