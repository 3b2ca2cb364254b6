"""A task's data: the offline mix and the demonstration that a recipe defines (methods.md 2.3 and 2.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray, concatenate
from lfobench.contract.method import Boundary, DataNeeds, Termination
from lfobench.contract.suite import Recipe, TrajectoryRecipe
from lfobench.data import boundaries
from lfobench.data.boundaries import Rows
from lfobench.data.standard import moments, standardize
from lfobench.errors import UserError

STD_FLOOR = 1e-10


@dataclass(frozen=True)
class ObservationTransform:
    """How raw observations become a method's observations, in the data and in the simulator.

    Attributes:
        shift: ``[obs]`` subtracted.
        scale: ``[obs]`` divided by.
        indicator: whether a trailing 0 is appended (1 marks the absorbing observation).
    """

    shift: FloatArray
    scale: FloatArray
    indicator: bool

    def __call__(self, observations: FloatArray) -> FloatArray:
        """``[..., obs] -> [..., obs (+ 1)]``, float32."""
        transformed: FloatArray = np.asarray((observations - self.shift) / self.scale, dtype=np.float32)
        if self.indicator:
            zero = np.zeros((*transformed.shape[:-1], 1), np.float32)
            transformed = np.concatenate((transformed, zero), axis=-1)
        return transformed

    @property
    def size(self) -> int:
        """Length of a transformed observation."""
        return len(self.shift) + int(self.indicator)

    def absorbing(self) -> FloatArray:
        """The absorbing observation: zeros and the indicator."""
        absorbing: FloatArray = np.eye(1, self.size, self.size - 1, dtype=np.float32)[0]
        return absorbing


@dataclass(frozen=True)
class Mixture:
    """A task's rows for one method, over one stack of observations and actions.

    Attributes:
        observations: ``[M, obs]`` transformed; the last row is the absorbing observation if there is one.
        actions: ``[A, act]``.
        offline: rows of the offline data.
        expert: rows of the demonstration.
        initial: ``[E]`` indices of the first observations of the offline data's episodes.
        transform: to be applied to the simulator's observations.
        lengths: ``[E]`` steps of every episode of both parts.
        terminated: ``[E]``; True where the environment ended it.
    """

    observations: FloatArray
    actions: FloatArray
    offline: Rows
    expert: Rows
    initial: IntArray
    transform: ObservationTransform
    lengths: IntArray
    terminated: BoolArray


def mix(
    offline: Episodes, expert: Episodes, recipe: Recipe | TrajectoryRecipe, needs: DataNeeds, horizon: int
) -> Mixture:
    """The rows of a recipe under the boundary rules that a method declares.

    Args:
        offline: the poor part.
        expert: the expert part; K trajectories of it join the offline data, with their actions, and none where the
            recipe counts trajectories.
        recipe: counts.
        needs: the method's declaration.
        horizon: steps at which the released expert walk counts a trajectory.

    Raises:
        ValueError: for a boundary and a termination that no rule combines.
    """
    _check(needs)
    if isinstance(recipe, TrajectoryRecipe) and recipe.standardize:
        needs = replace(needs, standardize=True)
    indicator = needs.termination == "absorbing"
    everything, observations = _stacked(offline, expert, indicator)
    absorbing = len(everything.observations)
    if isinstance(recipe, TrajectoryRecipe):
        offline_rows, expert_rows = _recorded(offline, expert, recipe, needs, absorbing)
    elif needs.boundary == "released":
        offline_rows, expert_rows = _released(offline, expert, recipe, needs, horizon)
        if indicator:
            offline_rows = boundaries.absorb_transitions(offline_rows, absorbing)
    else:
        offline_rows, expert_rows = _exact(offline, expert, everything, recipe, needs)
    transform = _transform(observations[:absorbing], offline_rows, needs)
    if indicator:
        observations[absorbing] = transform.absorbing()
    first = everything.first_observation
    used = np.zeros(absorbing + 1, np.bool_)
    used[offline_rows.observation] = True
    return Mixture(
        observations,
        everything.actions,
        offline_rows,
        expert_rows,
        first[used[first]],
        transform,
        everything.lengths,
        everything.terminated,
    )


def _stacked(offline: Episodes, expert: Episodes, indicator: bool) -> tuple[Episodes, FloatArray]:
    """Both parts, and the memory ``[M, obs (+ 1)]`` that their observations lie in.

    An indicator is a column of zeros beside the observations and a row behind them, so nothing is copied for it.
    """
    count, size = len(offline.observations) + len(expert.observations), offline.observations.shape[1]
    observations = np.empty((count + indicator, size + indicator), np.float32)
    observations[:, size:] = 0.0
    return concatenate([offline, expert], observations[:count, :size]), observations


def _released(offline: Episodes, expert: Episodes, recipe: Recipe, needs: DataNeeds, horizon: int) -> tuple[Rows, Rows]:
    expert_rows = boundaries.released_transitions(expert)
    taken = boundaries.released_expert_prefix(expert_rows, recipe.expert_trajectories, horizon)
    place = (len(offline.observations), offline.transitions)
    mixed = boundaries.stack([boundaries.released_transitions(offline), taken.shifted(*place)])
    if not _triples(needs):
        return mixed, expert_rows.first(recipe.demonstration_rows).shifted(*place)
    demonstration = boundaries.released_triples(expert_rows).first(recipe.demonstration_rows)
    # The authors' buffer never samples its last row.
    return boundaries.released_triples(mixed), demonstration.first(max(len(demonstration) - 1, 0)).shifted(*place)


def _exact(
    offline: Episodes, expert: Episodes, everything: Episodes, recipe: Recipe, needs: DataNeeds
) -> tuple[Rows, Rows]:
    mixed = everything.first_episodes(len(offline.lengths) + recipe.expert_trajectories)
    absorbing = len(everything.observations)
    place = (len(offline.observations), offline.transitions)
    demonstration = expert.first_episodes(1)
    if not _triples(needs):
        return boundaries.exact_transitions(mixed), boundaries.exact_transitions(demonstration).shifted(*place)
    # Expert rows are shifted into place, so their absorbing index is given relative to that place.
    return (
        boundaries.exact_triples(mixed, needs.termination, absorbing),
        boundaries.exact_triples(demonstration, needs.termination, absorbing - place[0]).shifted(*place),
    )


def _recorded(
    offline: Episodes, expert: Episodes, recipe: TrajectoryRecipe, needs: DataNeeds, absorbing: int
) -> tuple[Rows, Rows]:
    """Every row of both parts, or a sample of the expert's; nothing is shared between the parts.

    A sample is the same for every method, whether it reads s'' or not, so its rows are those that have one.

    Raises:
        UserError: when the sample is larger than what it is drawn from.
    """
    place = (len(offline.observations), offline.transitions)
    absorbs = needs.termination == "absorbing"

    def every_row(episodes: Episodes, nowhere: int) -> Rows:
        if _triples(needs):
            return boundaries.exact_triples(episodes, "absorbing" if absorbs else "zero", nowhere)
        rows = boundaries.exact_transitions(episodes)
        return boundaries.absorb_transitions(rows, nowhere) if absorbs else rows

    offline_rows = every_row(offline, absorbing)
    wanted = recipe.expert_transitions
    if wanted is None:
        return offline_rows, every_row(expert, absorbing - place[0]).shifted(*place)
    whole = boundaries.triples_within(expert)
    if wanted > len(whole):
        raise UserError(
            f"The recipe samples {wanted} expert transitions; its trajectories hold {len(whole)} that have s''.",
            "Lower expert_transitions, or record more expert_trajectories.",
        )
    chosen = whole.at(np.random.Generator(np.random.Philox(wanted)).permutation(len(whole))[:wanted])
    return offline_rows, (chosen if _triples(needs) else chosen.without_second()).shifted(*place)


def _check(needs: DataNeeds) -> None:
    rules: set[tuple[Boundary, Termination]] = {("released", "teleport"), ("exact", "zero")}
    rules.add(("exact" if _triples(needs) else "released", "absorbing"))
    if (needs.boundary, needs.termination) not in rules:
        rows = "triples" if _triples(needs) else "pairs"
        raise ValueError(f"no rule makes {needs.boundary} {rows} with termination '{needs.termination}'")


def _triples(needs: DataNeeds) -> bool:
    return "second_next_observation" in (*needs.offline, *needs.expert)


def _transform(observations: FloatArray, offline: Rows, needs: DataNeeds) -> ObservationTransform:
    """Transforms the raw `observations` ``[M, obs (+ 1)]``, whose indicator column is there already, in place."""
    width = observations.shape[1]
    shift, scale = np.zeros(width, np.float32), np.ones(width, np.float32)
    if needs.standardize:
        row = offline.observation[: offline.sampled]
        mean, std = moments(observations, row[row < len(observations)])
        shift, scale = mean.astype(np.float32), (std + STD_FLOOR).astype(np.float32)
        standardize(observations, shift, scale)
    indicator = needs.termination == "absorbing"
    size = width - indicator
    return ObservationTransform(shift[:size], scale[:size], indicator)
