"""Minari's layout: a group per episode, which holds one more observation than actions.

``episode_<i>/{observations [T + 1, obs], actions [T, act], rewards [T], terminations [T], truncations [T]}``.
Observations that are a dictionary, as the kitchen's, are a group; its member ``observation`` is read.
"""

from __future__ import annotations

import re

import h5py
import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.data.readers.hdf5 import AGAIN, OTHER, Array, FileProblem, array, is_group, members, subgroup
from lfobench.data.readers.reading import Reading, end_to_end, flags, same_columns, same_rows

EPISODE = re.compile(r"episode_(\d+)")
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
    groups = [subgroup(root, name) for name in names]
    observations = [_observations(group) for group in groups]
    actions = [array(group, "actions", 2) for group in groups]
    rewards = [array(group, "rewards", 1) for group in groups]
    ends = [[array(group, name, 1) for name in ("terminations", "truncations")] for group in groups]
    for group, seen, done, others in zip(groups, observations, actions, zip(rewards, ends, strict=True), strict=True):
        reward, marks = others
        name = (group.name or "").strip("/")
        if not done.rows:
            raise FileProblem(f"'{name}' has no step", OTHER)
        same_rows([reward, *marks], done.rows, f"'{done.field}'")
        same_rows([seen], done.rows + 1, f"'{done.field}', and one more,")
        same_columns(seen, observations[0].shape[1], f"'{observations[0].field}'")
        same_columns(done, actions[0].shape[1], f"'{actions[0].field}'")
    lengths = np.array([done.rows for done in actions], np.int64)
    marked = [[flags(mark) for mark in marks] for marks in ends]
    for name, both in zip(names, marked, strict=True):
        if any(mark[:-1].any() for mark in both):
            raise FileProblem(f"'{name}' is marked as ended before its last step", OTHER)
    terminated = np.array([bool(terminations[-1]) for terminations, _ in marked])
    truncated = np.array([bool(truncations[-1]) for _, truncations in marked])
    return Reading(
        Episodes(end_to_end(observations), end_to_end(actions), end_to_end(rewards), lengths, terminated),
        "minari",
        columns=(IN_DICTIONARY,) if is_group(groups[0], "observations") else (),
        unfinished=not bool(terminated[-1] or truncated[-1]),
        both_flags=int((terminated & truncated).sum()),
    )


def _observations(group: h5py.Group) -> Array:
    if is_group(group, "observations"):
        return array(subgroup(group, "observations"), IN_DICTIONARY, 2)
    return array(group, "observations", 2)
