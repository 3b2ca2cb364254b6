"""Percentile bootstrap, stratified by task: runs are drawn again within every task, tasks are kept.

A replicate is a vector of counts: how often each run was drawn. Every statistic is a function of counts, so one
resampler serves them all, and tasks may have different numbers of runs.

References:
    B. Efron, "Bootstrap methods: another look at the jackknife", Annals of Statistics 7, 1979.
    R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep reinforcement learning at the edge
    of the statistical precipice", NeurIPS 2021, section 4.1: stratified bootstrap over tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lfobench.stats.intervals import Interval, check_probability

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
        """Where each task begins in `values`, ``[K]``."""
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
        resample(pool.sizes, replicates, np.random.default_rng([seed, side]), block) for side, pool in enumerate(pools)
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


def mean_interval(
    samples: Sequence[float] | Values, level: float = 0.95, replicates: int = REPLICATES, seed: int = 0
) -> Interval | None:
    """Percentile bootstrap interval of the mean of samples ``[n]``.

    None for a single sample, which has no spread. For few samples it is too narrow: of intervals at level 0.95 from
    5 normal samples, about 0.84 cover the mean; `intervals.t_interval` keeps its level there.

    Raises:
        ValueError: there is no sample, one is not finite, or `level` is not strictly between 0 and 1.
    """
    check_probability("level", level)
    pool = strata([samples])
    if not pool.vary:
        return None
    shares = pool.values / pool.values.size
    low, high = percentile_interval(bootstrap(lambda counts: shares @ counts, [pool], replicates, seed), level)
    return Interval(float(low), float(high), level)
