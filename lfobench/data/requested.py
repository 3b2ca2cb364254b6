"""Requested data: tasks of a suite, from a source, in the amount that a protocol reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lfobench.cells.cell import Protocol
from lfobench.cells.parts import PartRequest, build_command, requests
from lfobench.cells.plan import choose_protocol, cuda_is_available
from lfobench.cells.sources import check_here, read_tasks, spelled
from lfobench.contract.suite import Suite, Task
from lfobench.data.build import ImportJob, ShardJob, missing_shards
from lfobench.data.cache import PartCache
from lfobench.data.library import Library
from lfobench.data.source import TaskData, check_columns, load_task
from lfobench.files import cache_folder
from lfobench.registry import load_suite


@dataclass(frozen=True)
class RequestedData:
    """Data by name, before any of it is made or read.

    Attributes:
        name: of the suite, or the path of its file.
        suite: behind it.
        tasks: the chosen ones, in the source's form, with the files that are on this machine.
        source: its name.
        protocol: which decides how much is read.
        cache: root of the shards.
    """

    name: str
    suite: Suite
    tasks: tuple[Task, ...]
    source: str
    protocol: Protocol
    cache: Path

    @property
    def requests(self) -> list[tuple[str, PartRequest]]:
        """Every part, with the name of the task that reads it."""
        return [
            (task.name, request)
            for task in self.tasks
            for request in requests(self.suite, task, self.protocol.recipe_for(task))
        ]

    def missing_shards(self) -> list[ShardJob | ImportJob]:
        """Shards that are not in the cache and can be made."""
        return missing_shards(self.cache, self.name, self.requests)

    def rows(self) -> list[dict[str, Any]]:
        """Per task and part: transitions needed (None of a part recorded by episodes), shards there, folder."""
        return [_row(task, request, PartCache(self.cache, request.specification)) for task, request in self.requests]

    def check_files(self) -> None:
        """Compare the imported files of the tasks with the environments' spaces.

        Raises:
            UserError: a file's rows are not as wide as the environment's.
        """
        for task in self.tasks:
            check_columns(self.cache, self.suite, task, self.protocol.recipe_for(task), self.rebuild(task))

    def load(self, task: Task) -> TaskData:
        """Read one of the tasks' data.

        Raises:
            UserError: a file is not on this machine, or a shard is missing or damaged.
        """
        check_here([task], self.name, self.source)
        return load_task(self.cache, self.suite, task, self.protocol.recipe_for(task), self.rebuild(task))

    def rebuild(self, task: Task) -> str:
        """The command that makes a task's missing shards."""
        return build_command(self.name, self.protocol.name, task.name, spelled(task, self.source))


def requested_data(suite: str, tasks: str | None, protocol: str, source: str) -> RequestedData:
    """The data behind names.

    Args:
        suite: a name, or the path of a file.
        tasks: globs; None takes all that the source has.
        protocol: a name, or ``auto``.
        source: as ``--source`` takes it.

    Raises:
        UserError: an unknown name, or a file of the user's that is not there.
    """
    loaded, cache = load_suite(suite), cache_folder()
    read = read_tasks(loaded, tasks, source, Library(cache).find)
    budget, _ = choose_protocol(protocol, "cuda" if cuda_is_available() else "cpu")
    return RequestedData(suite, loaded, read.tasks, read.source, budget, cache)


def _row(task: str, request: PartRequest, cache: PartCache) -> dict[str, Any]:
    shards = request.specification.shards_for(request.transitions)
    return {
        "task": task,
        "part": request.specification.level,
        "transitions": request.transitions,
        "episodes": request.trajectories,
        "shards": shards,
        "shards_present": shards - len(cache.missing(request.transitions)),
        "folder": str(cache.folder),
    }
