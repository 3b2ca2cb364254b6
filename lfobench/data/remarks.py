"""Warnings about a task's data, and refusal of data that nothing can be learned from."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

import numpy as np

from lfobench.contract.method import DataNeeds
from lfobench.contract.suite import Task
from lfobench.data.doctor import doubtful_ends, too_short
from lfobench.data.source import TaskData
from lfobench.errors import UserError
from lfobench.record import Warning
from lfobench.text import counted

FEWEST_EPISODES = 10
"""Expert episodes that a demonstration is compared with, at the least."""
ROUNDING = 1e-6
"""Tolerance of an action at the bound of its box."""


def check_parts(data: TaskData) -> None:
    """Refuse a part of files without successive steps.

    Raises:
        UserError: naming the file.
    """
    read = data.task.read_from
    if read is None:
        return
    for file, episodes in ((read.offline, data.offline), (read.expert, data.expert)):
        if file is not None and (why := too_short(episodes)):
            raise UserError(
                f"Nothing can be learned from the data file {file.path}: {why}.",
                "Name another file; 'lfobench data doctor' says how this one is cut.",
            )


def unbounded_actions(task: Task) -> Iterator[Warning]:
    """A warning of an environment that bounds no action, or not all of them."""
    box, name = task.environment.spaces.actions, task.environment.id.rpartition(":")[2]
    if not box.is_bounded:
        yield Warning(
            what=f"The actions of {name} lack bounds ({box}). Where they do, nothing is scaled, and policies on "
            f"{task.name} reach [-1, 1] of the environment's units and no more.",
            remedy="Register a wrapper of it with a bounded box of actions, if more is needed.",
        )


def remarks(data: TaskData, needs: DataNeeds) -> Iterator[Warning]:
    """Deviations from the recipe or the environment, for a method of these needs, and doubtful ends of episodes."""
    yield from unbounded_actions(data.task)
    yield from _outside_the_box(data)
    yield from _doubtful(data)
    yield from _short(data, needs)
    yield from _rows_of_several(data)
    yield from _poor_demonstration(data)


def _outside_the_box(data: TaskData) -> Iterator[Warning]:
    box = data.task.environment.spaces.actions
    for part, episodes in (("offline", data.offline), ("expert", data.expert)):
        # NaN, where nothing was commanded, is not outside.
        sizes = np.abs(episodes.actions).max(axis=1)
        count = int((sizes > 1.0 + ROUNDING).sum())
        if count:
            yield Warning(
                what=f"{counted(count, 'action')} of {episodes.transitions:,} in the {part} part of {data.task.name} "
                f"{'leaves' if count == 1 else 'leave'} [-1, 1]{'' if box.is_unit else f', scaled from {box}'}, the "
                f"farthest to {np.nanmax(sizes):.3g}. They are learned from as they are; no policy can repeat them.",
                remedy="Clip them in the file where its simulator did, or look for another scale of its actions.",
            )


def _doubtful(data: TaskData) -> Iterator[Warning]:
    for part, file in data.files.items():
        for finding in doubtful_ends(data.offline if part == "offline" else data.expert):
            yield Warning(
                what=f"{file['name']}: {finding.text}",
                remedy="Save it with the observation that every episode ends in; 'lfobench data doctor' says more.",
            )


def _short(data: TaskData, needs: DataNeeds) -> Iterator[Warning]:
    """Parts that are smaller than the recipe takes."""
    recipe, episodes = data.recipe, len(data.expert.lengths)
    offline = (data.offline.transitions, recipe.offline_transitions, "transitions")
    if recipe.equal_transitions:
        offline = (data.offline.transitions, data.demonstrations.transitions, "transitions")
    elif recipe.offline_transitions is None:
        offline = (len(data.offline.lengths), recipe.offline_trajectories, "trajectories")
    expert = (episodes, recipe.demonstrations, "trajectories")
    if recipe.demonstration_rows is not None:
        expert = (data.expert.transitions, recipe.demonstration_rows, "transitions")
    for part, (have, wanted, unit) in (("offline part", offline), ("expert part", expert)):
        if have < (wanted or 0):
            yield Warning(
                what=f"The {part} of {data.task.name} has {have:,} of the {wanted:,} {unit} of the recipe.",
                remedy="Nothing, if that is how large the data is.",
            )
    if needs.expert_joins and episodes < recipe.expert_trajectories:
        joined = counted(episodes, "trajectory", "trajectories")
        yield Warning(
            what=f"The expert part of {data.task.name} has {joined} of the {recipe.expert_trajectories} that the "
            "recipe mixes into the offline data; all of them are in it.",
            remedy="Take a task of fewer expert trajectories, or a longer expert part.",
        )


def _rows_of_several(data: TaskData) -> Iterator[Warning]:
    """A count of rows, meant for one trajectory, that spans several: not all methods count in rows."""
    rows, length = data.recipe.demonstration_rows, int(data.expert.lengths[0])
    if rows is not None and rows >= 2 * length:
        yield Warning(
            what=f"The recipe of {data.task.name} counts its demonstration as {rows:,} rows, and the first expert "
            f"trajectory has {length:,}: methods of released boundaries see several trajectories, others one.",
            remedy="Say demonstrations=N in the place of demonstration_rows.",
        )


def _poor_demonstration(data: TaskData) -> Iterator[Warning]:
    """A single demonstration that is worse than other expert episodes; of several, the record holds the mean score."""
    single = data.recipe.observed == 1 and len(data.expert.lengths) >= FEWEST_EPISODES
    if data.demonstration_score is None or not single:
        return
    scores = [data.task.environment.normalized_score(value) for value in data.expert.returns().tolist()]
    mean, spread = statistics.fmean(scores), statistics.pstdev(scores)
    if data.demonstration_score < mean - spread:
        yield Warning(
            what=f"The demonstration of {data.task.name}, the first expert episode, scores "
            f"{data.demonstration_score:.1f}; expert episodes score {mean:.1f} ± {spread:.1f}.",
            remedy="Every method is asked to imitate that episode: put a better one first.",
        )
