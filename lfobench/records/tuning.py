"""Choices of hyperparameters on disk, and the trials behind them.

Below the output folder, ``tuning/<task>/<method>-<preset>-<hash>.json`` is a choice, and ``tuning`` itself is a folder
of ordinary records, one per trial and seed.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from lfobench.cells.cell import Cell, Run
from lfobench.cells.names import parse_assignments, parse_grids, spelled_grid
from lfobench.cells.plan import Plan, Request
from lfobench.cells.tuning import Search, search_of, tune_command
from lfobench.errors import UserError
from lfobench.record import Record, Tuning
from lfobench.records.folder import TUNING, RecordFolder, differences, read_record, safe_name
from lfobench.records.sealed import read_sealed, write_sealed
from lfobench.score import Statistic, tie
from lfobench.text import content_hash

CRITERION = Statistic("last")
"""Score of a trial, which is evaluated once, when it is trained."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Trial(_Model):
    """One combination of the grid's values, and its scores."""

    values: dict[str, Any]
    scores: list[FiniteFloat] = Field(min_length=1, description="Per seed; 0 where it diverged.")
    diverged: list[int] = Field(description="Seeds that did.")

    @property
    def score(self) -> float:
        """Mean over seeds, by which trials are compared."""
        return statistics.fmean(self.scores)


class Choice(_Model):
    """Chosen values for one method on one task, and the trials behind them."""

    conditions: dict[str, Any] = Field(description="Conditions of the choice; see lfobench/cells/tuning.py.")
    seeds: list[int] = Field(min_length=1, description="Of every trial.")
    starts: int = Field(ge=1, description="Validation starts of every trial.")
    trials: list[Trial] = Field(min_length=1, description="In declared order.")
    tuning: Tuning
    packages: dict[str, str] = Field(description="Versions behind the first trial.")

    @property
    def best(self) -> Trial:
        """The trial of the chosen values."""
        return next(trial for trial in self.trials if trial.values == self.tuning.chosen)


def best(trials: Sequence[Trial], untuned: Mapping[str, Any]) -> Trial:
    """Trial with the highest score; of tied ones, that with the fewest diverged seeds.

    Of those, the one that keeps the most of the `untuned` values, because a tie is no reason to change them; then the
    first.
    """

    def merit(trial: Trial) -> tuple[int, int]:
        kept = sum(untuned.get(field) == value for field, value in trial.values.items())
        return -len(trial.diverged), kept

    scores = [trial.score for trial in trials]
    return max((trial for trial in trials if max(scores) - trial.score <= tie(scores)), key=merit)


def choose(search: Search, starts: int, records: Sequence[Sequence[Record]], earlier: Sequence[Record] = ()) -> Choice:
    """The choice among a search's combinations.

    Args:
        search: the grid.
        starts: validation starts of every trial.
        records: per combination, in the order of `search.tried`, one per seed.
        earlier: trials of preceding searches, which count as cost of the choice.
    """
    trials = [
        Trial(
            values=dict(cell.tuned),
            scores=[record.score(CRITERION) for record in members],
            diverged=[record.seed for record in members if record.status == "diverged"],
        )
        for cell, members in zip(search.tried, records, strict=True)
    ]
    trained = [record for members in records for record in members]
    everything = list({record.identity_hash: record for record in [*trained, *earlier]}.values())
    seeds = [record.seed for record in records[0]]
    tuning = Tuning(
        grid=search.grid,
        chosen=best(trials, search.cell.config.model_dump(mode="json")).values,
        criterion=f"mean score of the last evaluation over {starts} validation starts"
        + (f" and {len(seeds)} seeds" if len(seeds) > 1 else ""),
        runs=len(everything),
        steps=sum(record.provenance["gradient_steps"] for record in everything),
    )
    packages = records[0][0].provenance.get("packages", {})
    return Choice(
        conditions=search.conditions, seeds=seeds, starts=starts, trials=trials, tuning=tuning, packages=packages
    )


@dataclass(frozen=True)
class TuningFolder:
    """Choices and trials below an output folder."""

    root: Path

    @property
    def trials(self) -> RecordFolder:
        """The records of the trials."""
        return RecordFolder(self.root / TUNING)

    def path(self, search: Search) -> Path:
        """Path of a search's choice."""
        cell = search.cell
        name = f"{cell.method.name}-{cell.preset}-{search.hash[:12]}.json"
        return self.root / TUNING / safe_name(cell.task.name) / safe_name(name)

    def trial_records(self, search: Search, starts: int, seeds: Sequence[int]) -> list[list[Record]] | None:
        """Per combination and seed, the trial's record; None while one is missing."""
        found = [[self.trials.find(Run(cell, seed)) for seed in seeds] for cell in search.trials(starts)]
        complete = [[record for record in members if record is not None] for members in found]
        return complete if all(len(members) == len(seeds) for members in complete) else None

    def all_trials(self, search: Search) -> list[Record]:
        """Every trial behind this choice or an earlier one in its place."""
        cell = self.trials.records / safe_name(search.cell.task.name)
        found = (read_record(path) for path in sorted(cell.glob(f"{safe_name(search.cell.method.name)}-*.json")))
        return [record for record in found if isinstance(record, Record) and search.tried_before(record.identity)]

    def write(self, search: Search, choice: Choice) -> Path:
        """Store a choice atomically, in place of an earlier one for the same conditions."""
        path = self.path(search)
        write_sealed(path, choice.model_dump(mode="json"))
        return path

    def find(self, search: Search) -> Choice | None:
        """The intact choice for a search's conditions, if there is one."""
        choice = self._read(self.path(search))
        return choice if choice is not None and content_hash(choice.conditions) == search.hash else None

    def all_for(self, cell: Cell) -> list[tuple[Search, Choice]]:
        """Choices for a cell, made from any grid, also from one that is no longer declared."""
        folder = self.root / TUNING / safe_name(cell.task.name)
        found = []
        for path in sorted(folder.glob(f"{safe_name(cell.method.name)}-*.json")):
            choice = self._read(path)
            if choice is None or choice.conditions.get("method") != cell.method.name:
                continue
            grid = choice.tuning.grid
            if math.prod(map(len, grid.values())) != len(choice.trials):
                continue
            try:
                search = search_of(cell, {cell.method.name: grid})
            except UserError:
                continue  # the method has changed since
            if search is not None and content_hash(choice.conditions) == search.hash:
                found.append((search, choice))
        return found

    def problem(self, search: Search) -> str:
        """Reason why `find` finds nothing, as a sentence; with the nearest other choice for the method and task.

        Raises:
            UserError: when the folder cannot be looked into.
        """
        what = f"{search.cell.method.name} on {search.cell.task.name}"
        path = self.path(search)
        try:
            there = path.exists()
            others = sorted(path.parent.glob(f"{safe_name(search.cell.method.name)}-*.json"))
        except OSError as error:
            raise UserError(f"Cannot look into {path.parent}: {error.strerror}.", "Choose another --out.") from error
        if there:
            return f"The choice for {what} in {path} is damaged, or was edited after it was written."
        stale = {
            other: list(differences(choice.conditions, search.conditions))
            for other in others
            if (choice := self._read(other)) is not None and choice.conditions.get("method") == search.cell.method.name
        }
        if not stale:
            return f"There is no choice for {what} in {self.root}."
        nearest = min(stale, key=lambda other: len(stale[other]))
        return f"The choice for {what} in {nearest} was made under other conditions: {'; '.join(stale[nearest])}."

    @staticmethod
    def _read(path: Path) -> Choice | None:
        try:
            sealed = read_sealed(path)
            choice = Choice.model_validate(sealed.content)
        except (OSError, ValueError, ValidationError, RecursionError):
            return None
        return choice if sealed.intact else None


def with_choices(plan: Plan, request: Request, folder: TuningFolder) -> Plan:
    """The plan with the chosen values, where there is a grid; values of ``--set`` take precedence.

    Where neither ``--grid`` nor the task nor the method names a grid, the only choice that holds for a cell is taken.

    Raises:
        UserError: where a choice is missing or holds for something else, naming the command that makes it, where there
            are several, or where there is nothing to choose at all.
    """
    cells, lacking, declared = [], [], False
    methods = list(dict.fromkeys(cell.method.name for cell in plan.cells))
    assigned, asked = parse_assignments(request.assignments, methods), parse_grids(request.grids, methods)
    for cell in plan.cells:
        search = search_of(cell, asked)
        if search is None and (made := folder.all_for(cell)):
            _check_single(cell, made)
            search = made[0][0]
        if search is None:
            cells.append(cell)
            continue
        declared = True
        kept = assigned.get(cell.method.name, {}).keys()
        if search.grid.keys() <= kept:
            cells.append(cell)
        elif choice := folder.find(search):
            cells.append(search.chosen(choice.tuning, kept))
        else:
            lacking.append(search)
    if not declared:
        raise UserError(
            f"Neither the suite '{plan.suite.name}' nor a method declares a grid for these methods and tasks.",
            "Leave out --tuned, or choose first: lfobench tune --grid METHOD.FIELD=V1,V2.",
        )
    if lacking:
        more = f" In all, {len(lacking)} choices are missing or out of date." if len(lacking) > 1 else ""
        command = tune_command(request, plan.protocol.name, lacking, str(folder.root))
        raise UserError(f"{folder.problem(lacking[0])}{more}", f"Run first: {command}")
    return replace(plan, cells=tuple(cells))


def _check_single(cell: Cell, made: Sequence[tuple[Search, Choice]]) -> None:
    if len(made) > 1:
        name = cell.method.name
        grids = [" ".join(f"--grid {text}" for text in spelled_grid(name, search.grid)) for search, _ in made]
        raise UserError(
            f"There are {len(made)} choices for {name} on {cell.task.name}, from other grids.",
            f"Say which: {'; or '.join(grids)}",
        )
