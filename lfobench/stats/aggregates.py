"""One number for a method over many tasks, with a stratified bootstrap interval.

All follow R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep reinforcement learning at
the edge of the statistical precipice", NeurIPS 2021, sections 4.1 to 4.3. That paper has as many runs in every
task. Where they differ here, every task counts equally, and every run of a task counts equally within it.

The interval of a method depends on its own scores alone. It is None where no task has two runs; a task with one run
adds no spread to it. Like any percentile bootstrap it is too narrow for few runs, though less so than for one task.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lfobench.score import tie
from lfobench.stats.intervals import Estimate, Interval, check_probability

Values: TypeAlias = NDArray[np.float64]
Counts: TypeAlias = NDArray[np.float64]

Scores: TypeAlias = Values | Sequence[Sequence[float] | Values]
"""One method's scores. An array is ``[runs, tasks]``; any other sequence holds the runs ``[n_k]`` of each task."""

REPLICATES = 50_000

LARGEST = 1e300
"""Either way: sums of larger scores, and differences between such sums, could leave the range of float64."""

# A block of counts of so many draws stays in a core's cache, which halves the time.
DRAWS_AT_ONCE = 1 << 14


@dataclass(frozen=True)
class Strata:
    """All runs of a method, task after task.

    Attributes:
        values: the scores ``[N]``, in increasing order within a task.
        sizes: runs of each task ``[K]``, summing to N.
    """

    values: Values
    sizes: NDArray[np.int64]

    @property
    def starts(self) -> NDArray[np.int64]:
        """First index of each task in `values`, ``[K]``."""
        return np.cumsum(self.sizes) - self.sizes

    @property
    def weights(self) -> Values:
        """Weight of each run ``[N]``, summing to N: tasks count equally, and so do the runs within a task.

        Exactly 1 everywhere when all tasks have the same number of runs.
        """
        return np.repeat(self.values.size / (self.sizes.size * self.sizes), self.sizes)

    @property
    def vary(self) -> bool:
        """Whether a task has two runs: a run that is alone in its task is drawn every time and shows no spread."""
        return bool((self.sizes > 1).any())


def strata(scores: Scores) -> Strata:
    """The strata of one method's scores, every task with at least one run.

    Raises:
        ValueError: there is no task, a task has no run, or a score is not finite or beyond `LARGEST`.
    """
    if isinstance(scores, np.ndarray):
        if scores.ndim != 2:
            raise ValueError(f"An array of scores is [runs, tasks]; got shape {scores.shape}.")
        scores = list(scores.T)
    tasks = [np.asarray(task, dtype=np.float64) for task in scores]
    if not tasks or any(task.ndim != 1 or task.size == 0 for task in tasks):
        raise ValueError("Scores need at least one task, and every task at least one run.")
    # Sorted, so that intervals do not depend on the order of the seeds.
    values = np.concatenate([np.sort(task) for task in tasks])
    if not (np.abs(values) <= LARGEST).all():
        raise ValueError(f"Scores must be finite, and within ±{LARGEST:g}.")
    return Strata(values, np.array([task.size for task in tasks]))


def resample(sizes: NDArray[np.int64], replicates: int, random: np.random.Generator, block: int) -> Iterator[Counts]:
    """Counts ``[N, B]`` of the runs of strata of these sizes ``[K]``, `block` replicates at a time.

    Within every stratum of n runs, n are drawn with replacement, independently of the other strata. Replicates are
    drawn one after the other from the stream, so they do not depend on the size of the blocks.
    """
    total = int(sizes.sum())
    starts = np.repeat(np.cumsum(sizes) - sizes, sizes)
    # A single bound is several times faster to draw under than one bound per run.
    bounds = int(sizes[0]) if (sizes == sizes[0]).all() else np.repeat(sizes, sizes)
    for done in range(0, replicates, block):
        held = min(block, replicates - done)
        cells = random.integers(0, bounds, size=(held, total))
        cells += starts
        cells *= held
        cells += np.arange(held)[:, None]
        yield np.bincount(cells.ravel(), minlength=total * held).reshape(total, held).astype(np.float64)


def bootstrap(
    statistic: Callable[..., Values],
    pools: Sequence[Strata],
    replicates: int = REPLICATES,
    seed: int = 0,
    draws_at_once: int = DRAWS_AT_ONCE,
) -> Values:
    """Replicates ``[R, ...]`` of a statistic of one or more methods, drawn from independent streams.

    `statistic` maps the counts of each method, ``[N, B]``, ``[M, B]``, ..., to values ``[B, ...]``. About
    `draws_at_once` draws are held at a time, and at least one replicate; up to rounding, the replicates do not depend
    on it.

    Raises:
        ValueError: there is no replicate to draw.
    """
    if replicates < 1:
        raise ValueError(f"A bootstrap needs at least one replicate; got {replicates}.")
    block = max(1, draws_at_once // sum(pool.values.size for pool in pools))
    streams = [
        resample(pool.sizes, replicates, np.random.default_rng([seed, index]), block)
        for index, pool in enumerate(pools)
    ]
    return np.concatenate([statistic(*counts) for counts in zip(*streams, strict=True)])


def percentile_interval(replicates: Values, level: float) -> tuple[Values, Values]:
    """Lower and upper ends ``[...]`` of the central `level` of replicates ``[R, ...]``.

    Raises:
        ValueError: `level` is not strictly between 0 and 1.
    """
    check_probability("level", level)
    tail = (1.0 - level) / 2.0
    low, high = np.quantile(replicates, [tail, 1.0 - tail], axis=0)
    return low, high


def interquartile_mean(scores: Scores, level: float = 0.95, replicates: int = REPLICATES, seed: int = 0) -> Estimate:
    """Mean of the middle half of all runs of all tasks.

    Of N runs in all, the weight of ⌊N/4⌋ is cut from each end of the sorted scores; a run at the edge may be cut in
    part. With as many runs in every task all weigh 1, and this is ``scipy.stats.trim_mean(scores, 0.25, axis=None)``.

    Raises:
        ValueError: the scores are empty or not finite, or `level` is not strictly between 0 and 1.
    """
    pool = strata(scores)
    return _estimate(pool, interquartile_statistic(pool), level, replicates, seed)


def interquartile_statistic(pool: Strata) -> Callable[[Counts], Values]:
    """The interquartile mean of every replicate, from how often each run of `pool` was drawn ``[N, B]``."""
    order = np.argsort(pool.values, kind="stable")
    values, weights = pool.values[order], pool.weights[order, None]
    low = float(values.size // 4)
    high = values.size - low

    def statistic(counts: Counts) -> Values:
        below = np.cumsum(counts[order] * weights, axis=0)
        kept = np.diff(np.clip(below, low, high), axis=0, prepend=low)
        return np.asarray(values @ kept / (high - low))

    return statistic


def mean(scores: Scores, level: float = 0.95, replicates: int = REPLICATES, seed: int = 0) -> Estimate:
    """Mean over tasks of the mean over runs.

    Raises:
        ValueError: the scores are empty or not finite, or `level` is not strictly between 0 and 1.
    """
    pool = strata(scores)
    return _mean_of(pool, pool.values, level, replicates, seed)


def median(scores: Scores, level: float = 0.95, replicates: int = REPLICATES, seed: int = 0) -> Estimate:
    """Median over tasks of the mean over runs.

    Raises:
        ValueError: the scores are empty or not finite, or `level` is not strictly between 0 and 1.
    """
    pool = strata(scores)
    shares = (pool.values / np.repeat(pool.sizes, pool.sizes))[:, None]

    def statistic(counts: Counts) -> Values:
        means = np.add.reduceat(counts * shares, pool.starts, axis=0)
        return np.asarray(np.median(means, axis=0))

    return _estimate(pool, statistic, level, replicates, seed)


def probability_of_improvement(
    first: Scores, second: Scores, level: float = 0.95, replicates: int = REPLICATES, seed: int = 0
) -> Estimate:
    """Probability that a run of the first method beats a run of the second on a task, averaged over tasks.

    Per task the Mann-Whitney statistic U / (n m): a tie counts one half. The two methods are drawn again from
    independent streams; they share tasks, not numbers of runs. Swapping them turns the value p into 1 - p exactly,
    and the interval up to the noise of the draws. There is no interval where every replicate is the same, as where all
    runs of one method beat all of the other on each task: that the bootstrap sees no spread does not mean certainty.

    Raises:
        ValueError: the scores are empty or not finite, the methods have different numbers of tasks, or `level` is
            not strictly between 0 and 1.
    """
    check_probability("level", level)
    pools = strata(first), strata(second)
    tasks = pools[0].sizes.size
    if pools[1].sizes.size != tasks:
        raise ValueError(f"Both methods need the same tasks; got {tasks} and {pools[1].sizes.size} of them.")
    rows, columns = (
        [slice(start, start + size) for start, size in zip(pool.starts, pool.sizes, strict=True)] for pool in pools
    )
    wins = [_wins(pools[0].values[row], pools[1].values[column]) for row, column in zip(rows, columns, strict=True)]

    def statistic(counts_first: Counts, counts_second: Counts) -> Values:
        total = np.zeros(counts_first.shape[1])
        for row, column, won in zip(rows, columns, wins, strict=True):
            total += ((won.T @ counts_first[row]) * counts_second[column]).sum(axis=0) / won.size
        return total / tasks

    value = float(statistic(*(np.ones((pool.values.size, 1)) for pool in pools))[0])
    if not any(pool.vary for pool in pools):
        return Estimate(value, None)
    drawn = bootstrap(statistic, pools, replicates, seed)
    return Estimate(value, None if drawn.min() == drawn.max() else _interval(drawn, level))


@dataclass(frozen=True)
class Profile:
    """A performance profile with its pointwise band.

    Attributes:
        thresholds: scores ``[T]``.
        values: fraction of runs with a higher score, ``[T]``, between 0 and 1.
        low: lower ends of the intervals, ``[T]``; None where no task has two runs.
        high: upper ends, ``[T]``, or None.
        level: nominal coverage at each threshold; all thresholds at once are covered less often.
    """

    thresholds: Values
    values: Values
    low: Values | None
    high: Values | None
    level: float


def performance_profile(
    scores: Scores,
    thresholds: Sequence[float] | Values,
    level: float = 0.95,
    replicates: int = REPLICATES,
    seed: int = 0,
) -> Profile:
    """Fraction of runs that score above each threshold ``[T]``, averaged over tasks.

    Raises:
        ValueError: the scores are empty or not finite, or `level` is not strictly between 0 and 1.
    """
    check_probability("level", level)
    pool = strata(scores)
    above = np.asarray(thresholds, dtype=np.float64)
    shares = (pool.values > above[:, None]) * (pool.weights / pool.values.size)
    values = shares.sum(axis=1)
    if not pool.vary:
        return Profile(above, values, None, None, level)
    drawn = bootstrap(lambda counts: (shares @ counts).T, [pool], replicates, seed)
    low, high = percentile_interval(drawn, level)
    return Profile(above, values, low, high, level)


def _wins(first: Values, second: Values) -> Values:
    """1 where a run ``[n]`` of the first beats one ``[m]`` of the second, 0 where it loses, 1/2 where they tie."""
    between = first[:, None] - second
    between[np.abs(between) <= tie(first, second)] = 0.0
    return np.asarray((np.sign(between) + 1.0) / 2.0)


def _mean_of(pool: Strata, values: Values, level: float, replicates: int, seed: int) -> Estimate:
    """Mean over tasks of the mean over runs of any value ``[N]`` of the runs."""
    shares = values * pool.weights / values.size
    return _estimate(pool, lambda counts: shares @ counts, level, replicates, seed)


def _estimate(
    pool: Strata, statistic: Callable[[Counts], Values], level: float, replicates: int, seed: int
) -> Estimate:
    check_probability("level", level)
    # Every run drawn once: the sample itself.
    value = float(statistic(np.ones((pool.values.size, 1)))[0])
    if not pool.vary:
        return Estimate(value, None)
    return Estimate(value, _interval(bootstrap(statistic, [pool], replicates, seed), level))


def _interval(drawn: Values, level: float) -> Interval:
    low, high = percentile_interval(drawn, level)
    return Interval(float(low), float(high), level)
