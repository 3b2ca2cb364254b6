"""A task's data as read from disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lfobench.cells.parts import PartRequest, requests
from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.contract.method import DataNeeds
from lfobench.contract.suite import Recipe, Suite, Task
from lfobench.data.cache import PartCache
from lfobench.data.mixing import Mixture, mix
from lfobench.errors import UserError
from lfobench.record import Counts


@dataclass(frozen=True)
class TaskData:
    """A task's episodes, their actions in a method's [-1, 1], and what identifies them."""

    task: Task
    recipe: Recipe
    offline: Episodes
    expert: Episodes
    fingerprints: dict[str, str]

    @property
    def files(self) -> dict[str, dict[str, str | None]]:
        """Name and hash of the file of each part that is read from one."""
        read = self.task.read_from
        parts = {} if read is None else {"offline": read.offline, "expert": read.expert}
        return {part: {"name": file.name, "sha256": file.sha256} for part, file in parts.items() if file is not None}

    def score(self, episodes: Episodes) -> float | None:
        """Mean normalised score of episodes; None where rewards are missing or are not the environment's."""
        comparable = self.task.read_from is None or self.task.read_from.returns
        if not comparable or not np.isfinite(episodes.rewards).all():
            return None
        return self.task.environment.normalized_score(float(episodes.returns().mean()))

    @property
    def demonstrations(self) -> Episodes:
        """The observed trajectories; the first one where a demonstration is counted in rows."""
        return self.expert.first_episodes(self.recipe.observed)

    @property
    def demonstration_score(self) -> float | None:
        """Mean normalised score of the demonstrations; None where it is unknown."""
        return self.score(self.demonstrations)

    def counts(self, needs: DataNeeds) -> Counts | None:
        """Present amounts of the recipe's data, under a method's rules; None where all is counted in trajectories."""
        recipe = self.recipe
        if recipe.offline_transitions is None:
            return None
        rows = self.demonstrations.transitions
        if recipe.demonstration_rows is not None and needs.boundary == "released":
            rows = min(recipe.demonstration_rows, self.expert.transitions)
        return Counts(
            offline_transitions=self.offline.transitions,
            expert_trajectories=min(recipe.expert_trajectories, len(self.expert.lengths)) if needs.expert_joins else 0,
            demonstration_rows=rows,
            demonstrations=None if recipe.demonstration_rows is not None else len(self.demonstrations.lengths),
        )

    def mixture(self, needs: DataNeeds) -> Mixture:
        """The rows that a method declares."""
        return mix(self.offline, self.expert, self.recipe, needs, self.task.environment.horizon)


def load_task(root: Path, suite: Suite, task: Task, recipe: Recipe, rebuild: str) -> TaskData:
    """Read and check a task's parts; `rebuild` is the command that makes missing shards again.

    Raises:
        UserError: when a shard is missing or damaged.
    """
    (offline, offline_mark), (expert, expert_mark) = (
        _loaded(root, request, rebuild) for request in requests(suite, task, recipe)
    )
    _check_actions(task, recipe, offline, expert)
    check_columns(root, suite, task, recipe, rebuild)
    if recipe.equal_transitions:
        offline = offline.first_transitions(expert.first_episodes(recipe.observed).transitions)
    box = task.environment.spaces.actions
    offline, expert = (replace(part, actions=box.normalized(part.actions)) for part in (offline, expert))
    return TaskData(task, recipe, offline, expert, {"offline": offline_mark, "expert": expert_mark})


def _loaded(root: Path, request: PartRequest, rebuild: str) -> tuple[Episodes, str]:
    """The requested amount of a part, and its fingerprint."""
    episodes, mark = PartCache(root, request.specification).load(request.transitions, rebuild)
    return episodes if request.trajectories is None else episodes.first_episodes(request.trajectories), mark


def declared_fingerprints(root: Path, suite: Suite, task: Task, recipe: Recipe) -> dict[str, str]:
    """Fingerprints of a task's parts by their headers; incomplete parts are left out."""
    parts = zip(("offline", "expert"), requests(suite, task, recipe), strict=True)
    marks = {
        part: PartCache(root, request.specification).declared_fingerprint(request.transitions)
        for part, request in parts
    }
    return {part: mark for part, mark in marks.items() if mark is not None}


def check_columns(root: Path, suite: Suite, task: Task, recipe: Recipe, rebuild: str) -> None:
    """Compare the imported files of a task with its environment's spaces.

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


def _check_actions(task: Task, recipe: Recipe, offline: Episodes, expert: Episodes) -> None:
    needed = [(recipe.offline, offline), *([(recipe.expert, expert)] if recipe.expert_actions else [])]
    for level, episodes in needed:
        if np.isnan(episodes.actions).any():
            raise UserError(
                f"The {level} part of {task.name} was recorded without actions.",
                "Fix its suite: an offline part needs them, and an expert part too unless its recipe says "
                "expert_actions=False.",
            )


def demonstrated_paths(data: TaskData, columns: slice) -> list[FloatArray]:
    """Lines ``[T + 1, 2]`` through the raw observed expert transitions; a line per transition where they are sampled.

    Args:
        data: of the task.
        columns: two of the observation's.
    """
    needs = DataNeeds(
        offline=("observation",),
        expert=("observation", "next_observation"),
        boundary="exact",
        termination="zero",
    )
    rows = data.mixture(needs).expert
    # The mixture's own observations may be standardised; its rows count through both parts, end to end.
    positions = np.concatenate([part.observations[:, columns] for part in (data.offline, data.expert)])
    breaks = np.flatnonzero(rows.next_observation[:-1] != rows.observation[1:]) + 1
    return [
        np.concatenate([positions[rows.observation[part]], positions[rows.next_observation[part[-1:]]]])
        for part in np.split(np.arange(len(rows)), breaks)
    ]
