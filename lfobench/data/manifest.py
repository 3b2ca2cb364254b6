"""Manifest of a task's data: counts of its parts and rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lfobench.contract.episodes import Episodes
from lfobench.contract.method import DataNeeds, Field
from lfobench.data import boundaries
from lfobench.data.source import TaskData
from lfobench.text import counted


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
        """The line as a sentence."""
        return (
            f"{self.name}: {self.episodes:,} episodes, {self.transitions:,} transitions, "
            f"{self.terminated:,} terminated, {self.truncated:,} truncated, "
            f"mean score {_score_text(self.mean_score)}, fingerprint {self.fingerprint[:16]}"
        )


@dataclass(frozen=True)
class ExactManifest:
    """Counts of a recipe's data under exact boundaries.

    Attributes:
        task: its name.
        parts: in the amount that is read.
        expert_trajectories: that joined the offline data.
        offline_triples: (s, s', s'') rows of the offline data.
        expert_triples: those that are observed.
        sampled: whether they are a sample in random order, or all.
    """

    task: str
    parts: tuple[PartCounts, ...]
    expert_trajectories: int
    offline_triples: int
    expert_triples: int
    sampled: bool

    def sentences(self) -> list[str]:
        """Sentences about the recipe, with the counts; a recording's score is 100 where it succeeded, else 0."""
        how = "drawn uniformly from its trajectories, in random order" if self.sampled else "all of its trajectories"
        joined = counted(self.expert_trajectories, "expert trajectory is", "expert trajectories are")
        return [
            *(part.sentence for part in self.parts),
            f"offline triples: {self.offline_triples:,}, none across an end; "
            f"{joined if self.expert_trajectories else 'no demonstration is'} among them",
            f"demonstration: {self.expert_triples:,} observation triples, {how}",
        ]


@dataclass(frozen=True)
class Manifest:
    """Counts of a recipe's data under released boundaries.

    Attributes:
        task: its name.
        parts: in the amount that is read.
        offline_rows: transitions of the offline mix.
        expert_rows_in_mix: how many of them came from the expert part, with their actions.
        triples: (s, s', s'') rows of the mix.
        cross_episode: triples that end in the first observation of another episode.
        demonstration_rows: triples of the demonstration that can be sampled.
        demonstrations: number of the first expert episodes that they come from, or begin with.
        demonstration_steps: total length of these episodes.
        demonstration_score: their mean normalised score.
        exact_triples: rows that the ``absorbing`` rules would keep.
    """

    task: str
    parts: tuple[PartCounts, ...]
    offline_rows: int
    expert_rows_in_mix: int
    triples: int
    cross_episode: int
    demonstration_rows: int
    demonstrations: int
    demonstration_steps: int
    demonstration_score: float | None
    exact_triples: int

    def sentences(self) -> list[str]:
        """Sentences about the recipe, with the counts."""
        return [
            *(part.sentence for part in self.parts),
            f"offline mix: {self.offline_rows:,} transitions, {self.expert_rows_in_mix:,} of them expert, with actions",
            f"released triples: {self.triples:,}, {self.cross_episode:,} of them across two episodes (teleport)",
            f"exact triples with absorbing ends: {self.exact_triples:,}",
            f"demonstration: {self.demonstration_rows:,} observation triples, from the first expert episode on "
            f"({self.demonstration_steps:,} steps, score {_score_text(self.demonstration_score)})"
            if self.demonstrations == 1
            else f"demonstrations: {self.demonstration_rows:,} observation triples of the first {self.demonstrations} "
            f"expert episodes ({self.demonstration_steps:,} steps, mean score {_score_text(self.demonstration_score)})",
            "the demonstrated trajectory, with its actions, is also inside the offline mix (as published)"
            if self.expert_rows_in_mix
            else "no expert trajectory is inside the offline mix",
        ]


def manifest(data: TaskData) -> Manifest | ExactManifest:
    """Count a task's data."""
    return _exact(data) if data.recipe.exact else _by_method(data)


def _exact(data: TaskData) -> ExactManifest:
    recipe = data.recipe
    fields: tuple[Field, ...] = ("observation", "second_next_observation")
    rows = data.mixture(DataNeeds(offline=fields, expert=fields, boundary="exact", termination="zero"))
    return ExactManifest(
        task=data.task.name,
        parts=(
            _counts(f"offline ({recipe.offline})", data, data.offline, data.fingerprints["offline"]),
            _counts(f"expert ({recipe.expert})", data, data.expert, data.fingerprints["expert"]),
        ),
        expert_trajectories=min(recipe.expert_trajectories, len(data.expert.lengths)),
        offline_triples=len(rows.offline),
        expert_triples=len(rows.expert),
        sampled=recipe.expert_transitions is not None,
    )


def _by_method(data: TaskData) -> Manifest:
    recipe = data.recipe
    fields: tuple[Field, ...] = ("observation", "second_next_observation")
    released = data.mixture(DataNeeds(offline=fields, expert=fields))
    absorbing = data.mixture(DataNeeds(offline=fields, expert=fields, boundary="exact", termination="absorbing"))
    offline_rows = len(boundaries.released_transitions(data.offline))
    joining = boundaries.released_expert_prefix(
        boundaries.released_transitions(data.expert), recipe.expert_trajectories, data.task.environment.horizon
    )
    second = released.offline.second_next_observation
    assert second is not None
    cross_episode = int(np.count_nonzero(second != released.offline.observation + 2))
    return Manifest(
        task=data.task.name,
        parts=(
            _counts(f"offline ({recipe.offline})", data, data.offline, data.fingerprints["offline"]),
            _counts(f"expert ({recipe.expert})", data, data.expert, data.fingerprints["expert"]),
        ),
        offline_rows=offline_rows + len(joining),
        expert_rows_in_mix=len(joining),
        triples=len(released.offline),
        cross_episode=cross_episode,
        demonstration_rows=len(released.expert),
        demonstrations=recipe.observed,
        demonstration_steps=data.demonstrations.transitions,
        demonstration_score=data.demonstration_score,
        exact_triples=len(absorbing.offline),
    )


def _counts(name: str, data: TaskData, episodes: Episodes, mark: str) -> PartCounts:
    terminated = int(episodes.terminated.sum())
    count = len(episodes.lengths)
    return PartCounts(name, count, episodes.transitions, terminated, count - terminated, data.score(episodes), mark)


def _score_text(score: float | None) -> str:
    return "unknown" if score is None else f"{score:.1f}"
