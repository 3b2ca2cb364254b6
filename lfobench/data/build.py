"""Building parts: shard by shard, in parallel, resumable at every shard."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lfobench.cells.parts import FilePart, PartRequest, PartSpecification, specification
from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.contract.suite import Demonstrator, Environment, Level, ScriptedDemonstrator
from lfobench.data.cache import PartCache
from lfobench.data.isolated import import_file
from lfobench.errors import UserError
from lfobench.processes import die_with_parent, interrupts_held
from lfobench.registry import load_suite


def record(specification: PartSpecification, demonstrator: ScriptedDemonstrator) -> Episodes:
    """A recorded part: as many episodes as its specification says.

    Raises:
        ValueError: when the demonstrator records another number, what its environment would not, or what is no number.
    """
    wanted = specification.episodes or 0
    episodes = demonstrator.record(wanted, _generator(specification, 0))
    if len(episodes.lengths) != wanted:
        raise ValueError(f"the demonstrator was asked for {wanted} episodes and recorded {len(episodes.lengths)}")
    _check_recording(episodes, specification.environment)
    return episodes


def _check_recording(episodes: Episodes, environment: Environment) -> None:
    for name, wanted in environment.spaces.shapes.items():
        columns = getattr(episodes, name).shape[1:]
        if columns != wanted:
            raise ValueError(f"{name} has rows of shape {columns}; those of {environment.id} are of shape {wanted}")
    for name in ("observations", "rewards"):
        if not np.isfinite(getattr(episodes, name)).all():
            raise ValueError(f"{name} has a value that is not a finite number")
    if np.isnan(episodes.actions).all():
        return  # nothing was commanded; the recipe decides whether actions are needed
    box = environment.spaces.actions
    if not ((episodes.actions >= box.low) & (episodes.actions <= box.high)).all():
        raise ValueError(f"actions has a value that is not a number in {box}")


def roll_out(
    specification: PartSpecification, demonstrator: Demonstrator, shard: int, transitions: int | None = None
) -> Episodes:
    """Whole episodes of a shard until at least `transitions` steps are made; by default the whole shard."""
    wanted = specification.shard_transitions if transitions is None else transitions
    generator = _generator(specification, shard)
    environment = specification.environment.make()
    observations: list[FloatArray] = []
    actions: list[FloatArray] = []
    rewards: list[float] = []
    lengths: list[int] = []
    terminations: list[bool] = []
    try:
        while sum(lengths) < wanted:
            observation, _ = environment.reset(seed=int(generator.integers(2**31)))
            observations.append(np.asarray(observation, np.float32))
            length, terminated, truncated = 0, False, False
            while not (terminated or truncated):
                action = demonstrator.act(observations[-1], generator)
                observation, reward, terminated, truncated, _ = environment.step(action)
                observations.append(np.asarray(observation, np.float32))
                actions.append(action)
                rewards.append(float(reward))
                length += 1
            lengths.append(length)
            terminations.append(terminated)
    finally:
        environment.close()
    return Episodes(
        np.stack(observations),
        np.stack(actions).astype(np.float32),
        np.asarray(rewards, np.float32),
        np.asarray(lengths, np.int64),
        np.asarray(terminations, np.bool_),
    )


def _generator(specification: PartSpecification, shard: int) -> np.random.Generator:
    key = np.random.SeedSequence([int(specification.hash[:16], 16), shard])
    return np.random.Generator(np.random.Philox(key))


@dataclass(frozen=True)
class ShardJob:
    """One missing shard, named so that another process can build it."""

    root: Path
    suite: str
    task: str
    level: Level
    shard: int
    episodes: int | None = None


@dataclass(frozen=True)
class ImportJob:
    """A file whose shard is missing."""

    root: Path
    task: str
    part: FilePart
    path: Path

    @property
    def level(self) -> str:
        """Name of the part in messages."""
        return self.part.level


def missing_shards(root: Path, suite: str, wanted: Sequence[tuple[str, PartRequest]]) -> list[ShardJob | ImportJob]:
    """Shards missing from the requests (task name, part), each once; none of a file that is not on this machine."""
    jobs: dict[Path, ShardJob | ImportJob] = {}
    for task, request in wanted:
        part = request.specification
        cache = PartCache(root, part)
        for shard in cache.missing(request.transitions):
            if not isinstance(part, FilePart):
                jobs[cache.path(shard)] = ShardJob(root, suite, task, part.level, shard, part.episodes)
            elif request.path is not None:
                jobs[cache.path(shard)] = ImportJob(root, task, part, Path(request.path))
    return list(jobs.values())


def check_present(root: Path, wanted: Iterable[tuple[str, PartRequest]], rebuild: Callable[[str], str]) -> None:
    """Read every shard that the requests need and that is there, before anything is trained on it.

    Args:
        root: of the cache.
        wanted: what will be read, with the name of a task that reads it.
        rebuild: the command that makes a task's missing shards again.

    Raises:
        UserError: for the first damaged one, with its path and the remedy.
    """
    longest: dict[str, tuple[str, PartRequest]] = {}
    for task, request in wanted:
        _, known = longest.setdefault(request.specification.hash, (task, request))
        if (request.transitions or 0) > (known.transitions or 0):
            longest[request.specification.hash] = (task, request)
    for task, request in longest.values():
        PartCache(root, request.specification).check(request.transitions, rebuild(task))


def build_shard(job: ShardJob | ImportJob) -> ShardJob | ImportJob:
    """Make and store one shard, unless another process has by now: roll it out, record it, or read it from a file.

    Raises:
        UserError: when the disk refuses, the suite's simulator or demonstrator fails, or the file cannot be used.
    """
    if isinstance(job, ImportJob):
        if not PartCache(job.root, job.part).path(0).exists():
            import_file(job.root, job.path, job.part)
        return job
    suite = load_suite(job.suite)
    task = next(task for task in suite.tasks if task.name == job.task)
    part = specification(suite, task, job.level, job.episodes)
    if PartCache(job.root, part).path(job.shard).exists():
        return job
    try:
        assert suite.demonstrator is not None, "parts are specified before they are built"
        maker = suite.demonstrator(task.environment.name, job.level)
        episodes = record(part, maker) if isinstance(maker, ScriptedDemonstrator) else roll_out(part, maker, job.shard)
    except (Exception, SystemExit) as error:
        raise UserError(
            f"The {job.level} data of {job.task} cannot be made: {type(error).__name__}: {error}.",
            f"Fix the environment or demonstrator of suite '{suite.name}'.",
        ) from error
    PartCache(job.root, part).write(job.shard, episodes)
    return job


def build(jobs: Sequence[ShardJob | ImportJob], workers: int) -> Iterator[ShardJob | ImportJob]:
    """Build every job, yielding each as it is stored; closing the iterator stops after the running ones."""
    if workers == 1 or len(jobs) == 1:
        yield from map(build_shard, jobs)
        return
    context = multiprocessing.get_context("spawn")
    with interrupts_held():
        pool = ProcessPoolExecutor(min(workers, len(jobs)), mp_context=context, initializer=die_with_parent)
        pending: set[Future[ShardJob | ImportJob]] = {pool.submit(build_shard, job) for job in jobs}
    try:
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    except BrokenProcessPool as error:
        raise UserError(
            "A process died while building data; it may have run out of memory.",
            "The same command continues; try --workers 1.",
        ) from error
    finally:
        # Not `cancel_futures`: the pool's thread forgets it once this generator, the last to hold the pool, is closed.
        for future in pending:
            future.cancel()
        pool.shutdown(wait=False)
