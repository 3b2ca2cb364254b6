"""Minari's layout: a group per episode, which holds one more observation than actions.

``episode_<i>/{observations [T + 1, obs], actions [T, act], rewards [T], terminations [T], truncations [T]}``.
Observations that are a dictionary, as the kitchen's, are a group; its member ``observation`` is read.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import h5py
import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.data.readers.arrays import Array, array
from lfobench.data.readers.hdf5 import AGAIN, OTHER, FileProblem, is_group, members, path_of, subgroup
from lfobench.data.readers.reading import Reading, end_to_end, flags, same_columns, same_rows

EPISODE = re.compile(r"episode_([0-9]{1,12})")
IN_DICTIONARY = "observation"


def is_minari(root: h5py.File) -> bool:
    """Whether the file has a group per episode."""
    return any(EPISODE.fullmatch(name) for name in members(root))


def read(root: h5py.File) -> Reading:
    """Every episode, by number.

    Raises:
        FileProblem: naming the field.
    """
    names = sorted((name for name in members(root) if EPISODE.fullmatch(name)), key=lambda name: int(name[8:]))
    if lacking := {f"episode_{index}" for index in range(len(names))} - set(names):
        raise FileProblem(f"'{min(lacking, key=len)}' is missing, and later episodes are there", AGAIN)
    episodes = [_checked(root, name) for name in names]
    observations, actions = [each.observations for each in episodes], [each.actions for each in episodes]
    for each in episodes:
        same_columns(each.observations, observations[0].shape[1], f"'{observations[0].field}'")
        same_columns(each.actions, actions[0].shape[1], f"'{actions[0].field}'")
    return Reading(
        Episodes(
            end_to_end(observations),
            end_to_end(actions),
            end_to_end([each.rewards for each in episodes]),
            np.array([done.rows for done in actions], np.int64),
            np.array([each.terminated for each in episodes]),
        ),
        "minari",
        columns=(IN_DICTIONARY,) if is_group(subgroup(root, names[0]), "observations") else (),
        unfinished=not (episodes[-1].terminated or episodes[-1].truncated),
        both_flags=sum(each.terminated and each.truncated for each in episodes),
    )


@dataclass(frozen=True, slots=True)
class _Episode:
    """An episode that was checked: its arrays, and how it ended."""

    observations: Array
    actions: Array
    rewards: Array
    terminated: bool
    truncated: bool


def _checked(root: h5py.File, name: str) -> _Episode:
    group = subgroup(root, name)
    observations, actions, rewards = _observations(group), array(group, "actions", 2), array(group, "rewards", 1)
    marks = [array(group, each, 1) for each in ("terminations", "truncations")]
    if not actions.rows:
        raise FileProblem(f"'{path_of(root, name)}' has no step", OTHER)
    same_rows([rewards, *marks], actions.rows, f"'{actions.field}'")
    same_rows([observations], actions.rows + 1, f"'{actions.field}', and one more,")
    marked = [flags(each) for each in marks]
    if any(mark[:-1].any() for mark in marked):
        raise FileProblem(f"'{path_of(root, name)}' is marked as ended before its last step", OTHER)
    return _Episode(observations, actions, rewards, *(bool(mark[-1]) for mark in marked))


def _observations(group: h5py.Group) -> Array:
    if is_group(group, "observations"):
        return array(subgroup(group, "observations"), IN_DICTIONARY, 2)
    return array(group, "observations", 2)
