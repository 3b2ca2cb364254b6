"""``lfobench plot SUITE``: the suite's tasks seen from above."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lfobench.cells.cell import load_protocol
from lfobench.cells.names import select_tasks, split_names
from lfobench.cells.parts import build_command
from lfobench.contract.suite import Suite, Task
from lfobench.data.source import demonstrated_paths, load_task
from lfobench.engine.trained import of_seed, outcomes_of, policy_of, scene_of, starts_of, traces_of
from lfobench.errors import UserError, unknown_name
from lfobench.files import cache_folder
from lfobench.plots.figure import PaperFigure
from lfobench.plots.kinds import PLOTS
from lfobench.plots.paths import Demonstrated, Field, Hit, RolledOut, field, field_points, hitting, paths
from lfobench.record import Record, Warning
from lfobench.registry import load_suite, load_suites, suite_names
from lfobench.selection import Selection
from lfobench.tables.comparable import arrange_columns
from lfobench.tables.counting import knobs
from lfobench.tables.table import Table

Warn = Callable[[Iterable[Warning]], object]

VIEWS = ("paths", "field", "hitting")
POSITION = slice(0, 2)
"""Columns of an observation that hold the measured position of the end-effector, in every environment with a scene."""

MOST_PANELS = 72


@dataclass(frozen=True)
class View:
    """What ``lfobench plot`` takes beside the records for a suite, as it was typed.

    Attributes:
        name: one of `VIEWS`; None where it was left out.
        tasks: globs.
        seed: whose policies are drawn.
        starts: numbers of fixed starts.
    """

    name: str | None
    tasks: str | None
    seed: int | None
    starts: str | None


def kind_of(kind: str, view: View) -> Suite | None:
    """The suite that a kind of plot names; None for one of `PLOTS`.

    Raises:
        UserError: it names neither, or its options are not for it.
    """
    if kind in PLOTS:
        given = {"--view": view.name, "--tasks": view.tasks, "--seed": view.seed, "--episodes": view.starts}
        if misplaced := [option for option, value in given.items() if value is not None]:
            raise UserError(
                f"Only the picture of a suite takes {' and '.join(misplaced)}; {kind} shows all records.",
                f"Leave the option out, or name a suite in the place of {kind}.",
            )
        return None
    if not kind.endswith(".py") and kind not in suite_names():
        raise unknown_name("kind of plot", kind, [*PLOTS, *_seen_from_above()])
    suite = load_suite(kind)
    scene_of(suite)
    if view.name is not None and view.name not in VIEWS:
        raise unknown_name("view", view.name, VIEWS)
    return suite


def _seen_from_above() -> Iterable[str]:
    return [name for name, suite in load_suites().loaded.items() if suite.scene is not None]


def draw(kind: str, suite: Suite, view: View, selected: Selection, out: Path, width: float, warn: Warn) -> PaperFigure:
    """The picture of a suite.

    Args:
        kind: the suite's name or path, as it was typed.
        suite: with a scene.
        view: what to draw.
        selected: records of the suite.
        out: folder that the policies lie in.
        width: inches.
        warn: called with what a reader of the picture should know.

    Raises:
        UserError: nothing that such a view shows, too many panels, or data or policies that are missing or damaged.
    """
    name = view.name or "paths"
    known = suite.tasks if view.tasks is None else select_tasks(suite.tasks, split_names(view.tasks))
    names = {task.name for task in known}
    records = of_seed([record for record in selected.records if record.task in names], view.seed or 0)
    if name == "field" and view.starts is not None:
        raise UserError("A field shows no episode.", "Leave --episodes out, or draw --view paths.")
    tasks = _tasks(suite, records, name)
    drawn = replace(selected, records=[each for each in records if each.task in tasks], failures=[])
    table = drawn.table(*knobs(selected.records))
    found = _Found(kind, suite, tasks, _arranged(drawn), out, view.starts, outcomes_of(selected.records), warn)
    return {"paths": _paths, "field": _field, "hitting": _hitting}[name](found, table, width)


def _tasks(suite: Suite, records: Iterable[Record], view: str) -> dict[str, Task]:
    """The tasks with records that can be shown in this view, in suite order."""
    scene = scene_of(suite)
    present = {record.task for record in records}
    shown = {}
    for task in suite.tasks:
        seen = scene(task.environment.name)
        possible = {"paths": True, "field": seen.observation_at is not None, "hitting": seen.puck_radius is not None}
        if task.name in present and possible[view]:
            shown[task.name] = task
    if not shown:
        lacking = {"field": "is observed by the place of its end-effector alone", "hitting": "has a puck"}
        raise UserError(
            f"None of {', '.join(sorted(present))} {lacking[view]}, so there is no {view} to draw.",
            "Choose another --view, or other --tasks.",
        )
    return shown


@dataclass(frozen=True)
class _Found:
    """Everything that a picture is made from.

    Attributes:
        kind: the suite as it was typed.
        suite: the suite.
        tasks: by name.
        records: by task name, then by column label.
        out: folder of the policies.
        starts: as they were typed.
        outcomes: all that the selected records know.
        warn: called with what a reader of the picture should know.
    """

    kind: str
    suite: Suite
    tasks: Mapping[str, Task]
    records: Mapping[str, Mapping[str, Record]]
    out: Path
    starts: str | None
    outcomes: set[str]
    warn: Warn


def _arranged(selected: Selection) -> dict[str, dict[str, Record]]:
    arranged: dict[str, dict[str, Record]] = {}
    for column, records in arrange_columns(selected.records, selected.methods).items():
        for record in records:
            arranged.setdefault(record.task, {})[column.label] = record
    return arranged


def _check_panels(count: int) -> None:
    if count > MOST_PANELS:
        raise UserError(
            f"The picture would have {count} panels; {MOST_PANELS} are the most.",
            "Name fewer tasks with --tasks, methods with --methods or starts with --episodes.",
        )


def _paths(found: _Found, table: Table, width: float) -> PaperFigure:
    _check_panels(sum(1 + len(of_task) for of_task in found.records.values()))
    panels: list[Demonstrated | RolledOut] = []
    for name, task in found.tasks.items():
        scene = scene_of(found.suite)(task.environment.name)
        records = found.records[name]
        protocol = load_protocol(str(next(iter(records.values())).identity["protocol"]["name"]))
        rebuild = build_command(found.kind, protocol.name, name)
        data = load_task(cache_folder(), found.suite, task, protocol.recipe_for(task), rebuild)
        lines = demonstrated_paths(data, POSITION)
        panels.append(Demonstrated(name, "demonstrations", scene, lines))
        for label, record in records.items():
            episodes, warnings = traces_of(found.out, record, task, starts_of(found.starts, record))
            found.warn(warnings)
            panels.append(RolledOut(name, label, scene, episodes))
    return paths(panels, table, width, found.outcomes)


def _field(found: _Found, table: Table, width: float) -> PaperFigure:
    _check_panels(sum(map(len, found.records.values())))
    panels = []
    for name, task in found.tasks.items():
        scene = scene_of(found.suite)(task.environment.name)
        assert scene.observation_at is not None
        points = field_points(scene)
        observations = scene.observation_at(points.reshape(-1, 2).astype(np.float32))
        for label, record in found.records[name].items():
            actions = task.environment.spaces.actions.in_units(policy_of(found.out, record).act(observations))
            # A diverged seed may answer NaN, which an evaluation takes for no motion.
            motion: NDArray[np.float64] = np.nan_to_num(actions * scene.stride, nan=0.0, posinf=0.0, neginf=0.0)
            panels.append(Field(name, label, scene, motion.reshape(points.shape)))
    return field(panels, table, width)


def _hitting(found: _Found, table: Table, width: float) -> PaperFigure:
    panels: list[Hit] = []
    for name, task in found.tasks.items():
        scene = scene_of(found.suite)(task.environment.name)
        for label, record in found.records[name].items():
            starts = starts_of(found.starts or "0", record)
            _check_panels(len(panels) + len(starts))
            episodes, warnings = traces_of(found.out, record, task, starts)
            found.warn(warnings)
            for episode in episodes:
                start = f", start {episode.start}" if len(starts) > 1 else ""
                panels.append(Hit(name, label + start, scene, episode))
    return hitting(panels, table, width)
