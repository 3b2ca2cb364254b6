"""What a reader of a number should know of the data behind it, and data that nothing can be learned from."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

import numpy as np

from lfobench.contract.method import DataNeeds
from lfobench.contract.record import Warning
from lfobench.contract.suite import Recipe, Task, TrajectoryRecipe
from lfobench.data.doctor import doubtful_ends, too_short
from lfobench.data.source import TaskData
from lfobench.errors import UserError
from lfobench.words import counted

FEWEST_EPISODES = 10
"""Of experts, to say of one of them that it is worse than they are."""
ROUNDING = 1e-6
"""Of an action at the bound of its box."""


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
    """What is not as the recipe or the environment has it, for a method of these needs, and ends that are in doubt."""
    yield from unbounded_actions(data.task)
    yield from _outside_the_box(data)
    yield from _doubtful(data)
    if isinstance(data.recipe, TrajectoryRecipe):
        return  # every recorded demonstration is observed, the failed ones among them; the record says how many succeed
    yield from _short(data, data.recipe, needs)
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


def _short(data: TaskData, recipe: Recipe, needs: DataNeeds) -> Iterator[Warning]:
    if recipe.expert_trajectories and needs.boundary == "released" and not data.released_expert_rows:
        episodes = counted(len(data.expert.lengths), "episode")
        yield Warning(
            what=f"The expert part of {data.task.name} has {episodes} and does not reach {recipe.expert_trajectories} "
            "trajectories by the released count, so none of it is mixed into the offline data.",
            remedy="Take a task of fewer expert trajectories, or a longer expert part.",
        )
    for part, have, wanted in (
        ("offline part", data.offline.transitions, recipe.offline_transitions),
        ("expert part", data.expert.transitions, recipe.demonstration_rows),
    ):
        if have < wanted:
            yield Warning(
                what=f"The {part} of {data.task.name} has {have:,} of the {wanted:,} transitions of the recipe.",
                remedy="Nothing, if that is how large the data is.",
            )


def _poor_demonstration(data: TaskData) -> Iterator[Warning]:
    if data.demonstration_score is None or len(data.expert.lengths) < FEWEST_EPISODES:
        return
    scores = [data.task.environment.normalized_score(value) for value in data.expert.returns().tolist()]
    mean, spread = statistics.fmean(scores), statistics.pstdev(scores)
    if data.demonstration_score < mean - spread:
        yield Warning(
            what=f"The demonstration of {data.task.name}, the first expert episode, scores "
            f"{data.demonstration_score:.1f}; expert episodes score {mean:.1f} ± {spread:.1f}.",
            remedy="Every method is asked to imitate that episode: put a better one first.",
        )
