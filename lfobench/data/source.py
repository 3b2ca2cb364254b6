"""A task's data as read from disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.contract.method import DataNeeds
from lfobench.contract.record import Counts
from lfobench.contract.suite import Recipe, Suite, Task, TrajectoryRecipe
from lfobench.data import boundaries
from lfobench.data.cache import PartCache
from lfobench.data.mixing import Mixture, mix
from lfobench.errors import UserError
from lfobench.plan.parts import requests


@dataclass(frozen=True)
class TaskData:
    """A task's episodes, their actions in a method's [-1, 1], and what identifies them."""

    task: Task
    recipe: Recipe | TrajectoryRecipe
    offline: Episodes
    expert: Episodes
    fingerprints: dict[str, str]

    @property
    def files(self) -> dict[str, dict[str, str | None]]:
        """Name and hash of the file of each part that is read from one."""
        read = self.task.read_from
        parts = {} if read is None else {"offline": read.offline, "expert": read.expert}
        return {part: {"name": file.name, "sha256": file.sha256} for part, file in parts.items() if file is not None}

    @property
    def released_expert_rows(self) -> int:
        """Expert rows that the released walk mixes into the offline data; none of a recorded part joins it."""
        if isinstance(self.recipe, TrajectoryRecipe):
            return 0
        rows = boundaries.released_transitions(self.expert)
        horizon, count = self.task.environment.horizon, self.recipe.expert_trajectories
        return len(boundaries.released_expert_prefix(rows, count, horizon))

    def score(self, episodes: Episodes) -> float | None:
        """Mean normalised score of episodes; None where their rewards do not say it."""
        told = self.task.read_from is None or self.task.read_from.returns
        if not told or not np.isfinite(episodes.rewards).all():
            return None
        return self.task.environment.normalized_score(float(episodes.returns().mean()))

    @property
    def demonstration_score(self) -> float | None:
        """Normalised score of what is demonstrated; None where it is unknown.

        Of the first expert episode, with which the demonstration starts, or the mean of all where trajectories count.
        """
        return self.score(self.expert if isinstance(self.recipe, TrajectoryRecipe) else self.expert.first_episodes(1))

    def counts(self, needs: DataNeeds) -> Counts | None:
        """What there is of the recipe's data, under a method's boundary rules; None where trajectories count."""
        recipe = self.recipe
        if isinstance(recipe, TrajectoryRecipe):
            return None
        if needs.boundary == "released":
            trajectories = recipe.expert_trajectories if self.released_expert_rows else 0
            rows = min(recipe.demonstration_rows, self.expert.transitions)
        else:
            trajectories = min(recipe.expert_trajectories, len(self.expert.lengths))
            rows = self.expert.first_episodes(1).transitions
        return Counts(
            offline_transitions=self.offline.transitions, expert_trajectories=trajectories, demonstration_rows=rows
        )

    def mixture(self, needs: DataNeeds) -> Mixture:
        """The rows that a method declares."""
        return mix(self.offline, self.expert, self.recipe, needs, self.task.environment.horizon)


def load_task(root: Path, suite: Suite, task: Task, recipe: Recipe | TrajectoryRecipe, rebuild: str) -> TaskData:
    """Read and check a task's parts; `rebuild` is the command that makes missing shards again.

    Raises:
        UserError: when a shard is missing or damaged.
    """
    (offline, offline_mark), (expert, expert_mark) = (
        PartCache(root, request.specification).load(request.transitions, rebuild)
        for request in requests(suite, task, recipe)
    )
    if isinstance(recipe, TrajectoryRecipe):
        _check_actions(task, recipe, offline, expert)
    check_columns(root, suite, task, recipe, rebuild)
    if isinstance(recipe, TrajectoryRecipe) and recipe.equal_transitions:
        offline = offline.first_transitions(expert.transitions)
    box = task.environment.spaces.actions
    offline, expert = (replace(part, actions=box.normalized(part.actions)) for part in (offline, expert))
    return TaskData(task, recipe, offline, expert, {"offline": offline_mark, "expert": expert_mark})


def declared_fingerprints(root: Path, suite: Suite, task: Task, recipe: Recipe | TrajectoryRecipe) -> dict[str, str]:
    """Fingerprints of a task's parts as their headers say; a part that is not whole is left out."""
    parts = zip(("offline", "expert"), requests(suite, task, recipe), strict=True)
    marks = {
        part: PartCache(root, request.specification).declared_fingerprint(request.transitions)
        for part, request in parts
    }
    return {part: mark for part, mark in marks.items() if mark is not None}


def check_columns(root: Path, suite: Suite, task: Task, recipe: Recipe | TrajectoryRecipe, rebuild: str) -> None:
    """Hold the files that a task is read from, once they are in the cache, against its environment.

    Raises:
        UserError: a file's rows are not as wide as the environment's.
    """
    read = [request for request in requests(suite, task, recipe) if request.path is not None]
    shapes = task.environment.spaces.shapes if read else {}
    for request in read:
        found = PartCache(root, request.specification).row_shapes(rebuild)
        for field, shape in shapes.items():
            if found[field] != shape:
                raise UserError(
                    f"The data file {request.path} is not of {task.name}: its {field} have {found[field][0]} columns, "
                    f"those of {task.environment.id} {shape[0] if shape else 0}.",
                    "Name another file, or another task with --tasks.",
                )


def _check_actions(task: Task, recipe: TrajectoryRecipe, offline: Episodes, expert: Episodes) -> None:
    needed = {recipe.offline: offline} | ({recipe.expert: expert} if recipe.expert_actions else {})
    for level, episodes in needed.items():
        if np.isnan(episodes.actions).any():
            raise UserError(
                f"The {level} part of {task.name} was recorded without actions.",
                "Mend its suite: an offline part needs them, and an expert part too unless its recipe says "
                "expert_actions=False.",
            )
