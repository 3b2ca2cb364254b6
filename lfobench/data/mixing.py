"""A task's data: the offline mix and the demonstration that a recipe defines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray, concatenate
from lfobench.contract.method import Boundary, DataNeeds, Termination
from lfobench.contract.suite import Recipe
from lfobench.data import boundaries
from lfobench.data.boundaries import Rows
from lfobench.errors import UserError

BLOCK = 2048

Float64Array = NDArray[np.float64]


def moments(observations: FloatArray, row: IntArray) -> tuple[Float64Array, Float64Array]:
    """Mean and standard deviation ``[obs]`` of the observations at `row` ``[R]``, accumulated in float64.

    Rows are added one after another, as NumPy's own reduction over the first axis adds them, so the numbers do not
    depend on `BLOCK`.
    """
    mean = _total(observations, row, lambda block: None) / np.float64(len(row))
    # One long row, because broadcasting a short one costs NumPy more than the arithmetic.
    means = np.tile(mean, BLOCK)

    def square_deviations(block: Float64Array) -> None:
        flat = block.reshape(-1)
        flat -= means[: len(flat)]
        np.multiply(flat, flat, out=flat)

    return mean, np.sqrt(_total(observations, row, square_deviations) / np.float64(len(row)))


def _total(observations: FloatArray, row: IntArray, change: Callable[[Float64Array], None]) -> Float64Array:
    """Sum ``[obs]`` over the rows of what `change` makes of every block."""
    size = observations.shape[1]
    taken, summands = np.empty((BLOCK, size), np.float32), np.empty((BLOCK + 1, size))
    total = np.zeros(size)
    for start in range(0, len(row), BLOCK):
        here = row[start : start + BLOCK]
        block = summands[1 : len(here) + 1]
        # Any other mode than "clip" fills `out` by way of another array.
        block[:] = observations.take(here, axis=0, out=taken[: len(here)], mode="clip")
        change(block)
        summands[0] = total
        # Adds row by row as sum(0) does, at a quarter of its cost.
        total = np.einsum("ij->j", summands[: len(here) + 1])
    return total


def standardize(observations: FloatArray, shift: FloatArray, scale: FloatArray) -> None:
    """Subtract and divide the contiguous ``[M, obs]`` in place."""
    shifts, scales = np.tile(shift, BLOCK), np.tile(scale, BLOCK)
    for start in range(0, len(observations), BLOCK):
        flat = observations[start : start + BLOCK].reshape(-1)
        flat -= shifts[: len(flat)]
        flat /= scales[: len(flat)]


STD_FLOOR = 1e-10


@dataclass(frozen=True)
class ObservationTransform:
    """Transform from raw observations to a method's observations, in the data and in the simulator.

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


def mix(offline: Episodes, expert: Episodes, recipe: Recipe, needs: DataNeeds, horizon: int) -> Mixture:
    """The rows of a recipe under the boundary rules that a method declares, or exact ones where the recipe says so.

    Args:
        offline: the suboptimal part.
        expert: the expert part; K trajectories of it join the offline data, with their actions.
        recipe: counts.
        needs: the method's declaration.
        horizon: steps at which the D4RL loader's count ends an expert trajectory.

    Raises:
        ValueError: for a boundary and a termination that no rule combines.
        UserError: for a sample of demonstrations that is larger than what it is drawn from.
    """
    _check(needs)
    indicator = needs.termination == "absorbing"
    if recipe.exact:
        needs = replace(needs, boundary="exact", termination="absorbing" if indicator else "zero")
    everything, observations = _stacked(offline, expert, indicator)
    absorbing = len(everything.observations)
    joining = recipe.expert_trajectories if needs.expert_joins else 0
    # Expert rows are made in their own count, and then moved to their place behind the offline part.
    place = (len(offline.observations), offline.transitions)
    if needs.boundary == "released":
        whole = boundaries.released_transitions(expert)
        taken = boundaries.released_expert_prefix(whole, joining, horizon).shifted(*place)
        offline_rows = boundaries.stack([boundaries.released_transitions(offline), taken])
        expert_rows = _released_demonstration(expert, recipe, _triples(needs))
        if _triples(needs):
            offline_rows = boundaries.released_triples(offline_rows)
        if indicator:
            offline_rows = boundaries.absorb_transitions(offline_rows, absorbing)
    else:
        mixed = everything.first_episodes(len(offline.lengths) + joining)
        offline_rows = _exact(mixed, needs, absorbing)
        observed = expert.first_episodes(recipe.observed)
        if recipe.expert_transitions is None:
            expert_rows = _exact(observed, needs, absorbing - place[0])
        else:
            expert_rows = _sample(observed, recipe.expert_transitions, needs)
    standardized = needs.standardize or recipe.standardize
    transform = _transform(observations[:absorbing], offline_rows, standardized, indicator)
    if indicator:
        observations[absorbing] = transform.absorbing()
    first = everything.first_observation
    used = np.zeros(absorbing + 1, np.bool_)
    used[offline_rows.observation] = True
    return Mixture(
        observations,
        everything.actions,
        offline_rows,
        expert_rows.shifted(*place),
        first[used[first]],
        transform,
        everything.lengths,
        everything.terminated,
    )


def _stacked(offline: Episodes, expert: Episodes, indicator: bool) -> tuple[Episodes, FloatArray]:
    """Both parts, and the memory ``[M, obs (+ 1)]`` that their observations lie in.

    An indicator is a column of zeros next to the observations and a row after them, so nothing is copied for it.
    """
    count, size = len(offline.observations) + len(expert.observations), offline.observations.shape[1]
    observations = np.empty((count + indicator, size + indicator), np.float32)
    observations[:, size:] = 0.0
    return concatenate([offline, expert], observations[:count, :size]), observations


def _released_demonstration(expert: Episodes, recipe: Recipe, triples: bool) -> Rows:
    """The first rows of the expert part, or those of its first trajectories, with no observation beyond them."""
    if recipe.demonstration_rows is None:
        rows = boundaries.released_transitions(expert.first_episodes(recipe.demonstrations))
        return boundaries.released_triples(rows) if triples else rows
    rows = boundaries.released_transitions(expert)
    if not triples:
        return rows.first(recipe.demonstration_rows)
    rows = boundaries.released_triples(rows).first(recipe.demonstration_rows)
    # The authors' buffer never samples its last row.
    return rows.first(max(len(rows) - 1, 0))


def _exact(episodes: Episodes, needs: DataNeeds, absorbing: int) -> Rows:
    if _triples(needs):
        return boundaries.exact_triples(episodes, needs.termination, absorbing)
    rows = boundaries.exact_transitions(episodes)
    return boundaries.absorb_transitions(rows, absorbing) if needs.termination == "absorbing" else rows


def _sample(observed: Episodes, wanted: int, needs: DataNeeds) -> Rows:
    """A sample of the rows that have s'', so that every method gets the same, whether it reads s'' or not.

    Raises:
        UserError: when the sample is larger than what it is drawn from.
    """
    whole = boundaries.triples_within(observed)
    if wanted > len(whole):
        raise UserError(
            f"The recipe samples {wanted} expert transitions; its trajectories hold {len(whole)} that have s''.",
            "Lower expert_transitions, or observe more demonstrations.",
        )
    chosen = whole.at(np.random.Generator(np.random.Philox(wanted)).permutation(len(whole))[:wanted])
    return chosen if _triples(needs) else chosen.without_second()


def _check(needs: DataNeeds) -> None:
    rules: set[tuple[Boundary, Termination]] = {("released", "teleport"), ("exact", "zero")}
    rules.add(("exact" if _triples(needs) else "released", "absorbing"))
    if (needs.boundary, needs.termination) not in rules:
        rows = "triples" if _triples(needs) else "pairs"
        raise ValueError(f"no rule makes {needs.boundary} {rows} with termination '{needs.termination}'")


def _triples(needs: DataNeeds) -> bool:
    return "second_next_observation" in (*needs.offline, *needs.expert)


def _transform(observations: FloatArray, offline: Rows, standardized: bool, indicator: bool) -> ObservationTransform:
    """Transforms the raw `observations` ``[M, obs (+ 1)]``, whose indicator column is there already, in place."""
    width = observations.shape[1]
    shift, scale = np.zeros(width, np.float32), np.ones(width, np.float32)
    if standardized:
        row = offline.observation[: offline.sampled]
        mean, std = moments(observations, row[row < len(observations)])
        shift, scale = mean.astype(np.float32), (std + STD_FLOOR).astype(np.float32)
        standardize(observations, shift, scale)
    size = width - indicator
    return ObservationTransform(shift[:size], scale[:size], indicator)
