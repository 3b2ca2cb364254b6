"""The manifest that says what is in a task's data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.contract.method import DataNeeds, Field
from lfobench.contract.suite import Recipe, TrajectoryRecipe
from lfobench.data import boundaries
from lfobench.data.source import TaskData


@dataclass(frozen=True)
class PartCounts:
    """One line of a manifest."""

    name: str
    episodes: int
    transitions: int
    terminated: int
    truncated: int
    mean_score: float | None
    fingerprint: str

    @property
    def sentence(self) -> str:
        """The line in words."""
        return (
            f"{self.name}: {self.episodes:,} episodes, {self.transitions:,} transitions, "
            f"{self.terminated:,} terminated, {self.truncated:,} truncated, "
            f"mean score {_spelled(self.mean_score)}, fingerprint {self.fingerprint[:16]}"
        )


@dataclass(frozen=True)
class RecordedManifest:
    """What a recipe of recorded trajectories turned out to hold.

    Attributes:
        task: its name.
        parts: as recorded, the offline one as far as it is read.
        offline_triples: (s, s', s'') rows of the offline part.
        expert_triples: those that are observed.
        sampled: whether they are a sample in random order, or all.
    """

    task: str
    parts: tuple[PartCounts, ...]
    offline_triples: int
    expert_triples: int
    sampled: bool

    def sentences(self) -> list[str]:
        """The recipe in words, with the counts; a recording's score is 100 where it succeeded, else 0."""
        how = "drawn uniformly from its trajectories, in random order" if self.sampled else "all of its trajectories"
        return [
            *(part.sentence for part in self.parts),
            f"offline triples: {self.offline_triples:,}, none across an end; no demonstration is among them",
            f"demonstration: {self.expert_triples:,} observation triples, {how}",
        ]


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
    demonstration_score: float | None
    exact_triples: int

    def sentences(self) -> list[str]:
        """The recipe in words, with the counts."""
        return [
            *(part.sentence for part in self.parts),
            f"offline mix: {self.offline_rows:,} transitions, {self.expert_rows_in_mix:,} of them expert, with actions",
            f"released triples: {self.triples:,}, of which {self.teleports:,} cross into another episode (teleport)",
            f"exact triples with absorbing ends: {self.exact_triples:,}",
            f"demonstration: {self.demonstration_rows:,} observation triples, from the first expert episode on "
            f"({self.demonstration_steps:,} steps, score {_spelled(self.demonstration_score)})",
            "the demonstrated trajectory, with its actions, is also inside the offline mix (as published)"
            if self.expert_rows_in_mix
            else "no expert trajectory is inside the offline mix",
        ]


def manifest(data: TaskData) -> Manifest | RecordedManifest:
    """Count a task's data."""
    return _recorded(data, data.recipe) if isinstance(data.recipe, TrajectoryRecipe) else _mixed(data, data.recipe)


def _recorded(data: TaskData, recipe: TrajectoryRecipe) -> RecordedManifest:
    fields: tuple[Field, ...] = ("observation", "second_next_observation")
    rows = data.mixture(DataNeeds(offline=fields, expert=fields, boundary="exact", termination="zero"))
    return RecordedManifest(
        task=data.task.name,
        parts=(
            _counts(f"offline ({recipe.offline})", data, data.offline, data.fingerprints["offline"]),
            _counts(f"expert ({recipe.expert})", data, data.expert, data.fingerprints["expert"]),
        ),
        offline_triples=len(rows.offline),
        expert_triples=len(rows.expert),
        sampled=recipe.expert_transitions is not None,
    )


def _mixed(data: TaskData, recipe: Recipe) -> Manifest:
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
            _counts(f"offline ({recipe.offline})", data, data.offline, data.fingerprints["offline"]),
            _counts(f"expert ({recipe.expert})", data, data.expert, data.fingerprints["expert"]),
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
    terminated = int(episodes.terminated.sum())
    count = len(episodes.lengths)
    return PartCounts(name, count, episodes.transitions, terminated, count - terminated, data.score(episodes), mark)


def _spelled(score: float | None) -> str:
    return "unknown" if score is None else f"{score:.1f}"
