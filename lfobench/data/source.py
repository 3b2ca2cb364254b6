"""A task's data as read from disk, and the manifest that says what is in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lfobench.contract.method import DataNeeds, Field
from lfobench.contract.suite import Recipe, Suite, Task
from lfobench.data import boundaries
from lfobench.data.cache import PartCache
from lfobench.data.episodes import Episodes
from lfobench.data.mixing import Mixture, mix
from lfobench.plan.parts import requests


@dataclass(frozen=True)
class TaskData:
    """A task's episodes and what identifies them."""

    task: Task
    recipe: Recipe
    offline: Episodes
    expert: Episodes
    fingerprints: dict[str, str]

    @property
    def released_expert_rows(self) -> int:
        """Expert rows that the released walk mixes into the offline data."""
        rows = boundaries.released_transitions(self.expert)
        horizon, count = self.task.environment.horizon, self.recipe.expert_trajectories
        return len(boundaries.released_expert_prefix(rows, count, horizon))

    @property
    def demonstration_score(self) -> float:
        """Normalised score of the first expert episode, with which the demonstration starts."""
        return self.task.environment.normalized_score(float(self.expert.first_episodes(1).returns()[0]))

    def mixture(self, needs: DataNeeds) -> Mixture:
        """The rows that a method declares."""
        return mix(self.offline, self.expert, self.recipe, needs, self.task.environment.horizon)


def load_task(root: Path, suite: Suite, task: Task, recipe: Recipe, rebuild: str) -> TaskData:
    """Read and check a task's parts; `rebuild` is the command that makes missing shards again.

    Raises:
        UserError: when a shard is missing or damaged.
    """
    (offline, offline_mark), (expert, expert_mark) = (
        PartCache(root, request.specification).load(request.transitions, rebuild)
        for request in requests(suite, task, recipe)
    )
    return TaskData(task, recipe, offline, expert, {"offline": offline_mark, "expert": expert_mark})


@dataclass(frozen=True)
class PartCounts:
    """One line of a manifest."""

    name: str
    episodes: int
    transitions: int
    terminated: int
    truncated: int
    mean_score: float
    fingerprint: str


@dataclass(frozen=True)
class Manifest:
    """What a recipe turned out to hold, counted under the released rules.

    Attributes:
        task: its name.
        parts: the raw parts as read.
        offline_rows: transitions of the offline mix.
        expert_rows_in_mix: how many of them came from the expert part, with their actions.
        triples: (s, s', s'') rows of the mix.
        teleports: triples that end in the first observation of another episode.
        demonstration_rows: triples of the demonstration that can be sampled.
        demonstration_steps: length of the first expert episode, which they start with.
        demonstration_score: its normalised score.
        exact_triples: rows that the ``absorbing`` rules would keep.
    """

    task: str
    parts: tuple[PartCounts, ...]
    offline_rows: int
    expert_rows_in_mix: int
    triples: int
    teleports: int
    demonstration_rows: int
    demonstration_steps: int
    demonstration_score: float
    exact_triples: int

    def sentences(self) -> list[str]:
        """The recipe in words, with the counts."""
        parts = [
            f"{part.name}: {part.episodes:,} episodes, {part.transitions:,} transitions, "
            f"{part.terminated:,} terminated, {part.truncated:,} truncated, "
            f"mean score {part.mean_score:.1f}, fingerprint {part.fingerprint[:16]}"
            for part in self.parts
        ]
        return [
            *parts,
            f"offline mix: {self.offline_rows:,} transitions, {self.expert_rows_in_mix:,} of them expert, with actions",
            f"released triples: {self.triples:,}, of which {self.teleports:,} cross into another episode (teleport)",
            f"exact triples with absorbing ends: {self.exact_triples:,}",
            f"demonstration: {self.demonstration_rows:,} observation triples, from the first expert episode on "
            f"({self.demonstration_steps:,} steps, score {self.demonstration_score:.1f})",
            "the demonstrated trajectory, with its actions, is also inside the offline mix (as published)",
        ]


def manifest(data: TaskData) -> Manifest:
    """Count a task's data."""
    fields: tuple[Field, ...] = ("observation", "second_next_observation")
    released = data.mixture(DataNeeds(offline=fields, expert=fields))
    absorbing = data.mixture(DataNeeds(offline=fields, expert=fields, boundary="exact", termination="absorbing"))
    offline_rows = len(boundaries.released_transitions(data.offline))
    expert_rows = data.released_expert_rows
    first = data.expert.first_episodes(1)
    second = released.offline.second_next_observation
    assert second is not None
    teleports = int(np.count_nonzero(second != released.offline.observation + 2))
    return Manifest(
        task=data.task.name,
        parts=(
            _counts(f"offline ({data.recipe.offline})", data, data.offline, data.fingerprints["offline"]),
            _counts(f"expert ({data.recipe.expert})", data, data.expert, data.fingerprints["expert"]),
        ),
        offline_rows=offline_rows + expert_rows,
        expert_rows_in_mix=expert_rows,
        triples=len(released.offline),
        teleports=teleports,
        demonstration_rows=len(released.expert),
        demonstration_steps=first.transitions,
        demonstration_score=data.demonstration_score,
        exact_triples=len(absorbing.offline),
    )


def _counts(name: str, data: TaskData, episodes: Episodes, mark: str) -> PartCounts:
    returns: Sequence[float] = episodes.returns().tolist()
    score = data.task.environment.normalized_score(float(np.mean(returns)))
    terminated = int(episodes.terminated.sum())
    count = len(episodes.lengths)
    return PartCounts(name, count, episodes.transitions, terminated, count - terminated, score, mark)
