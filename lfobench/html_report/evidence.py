"""What a page needs to decide a table again under any knobs: every p-value, computed once, in Python.

The page's script holds the rule and no statistics; the numbers below are unrounded, so it decides as the command line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import get_args

from lfobench.stats.contrast import scores_compared
from lfobench.stats.highlight import Rule, adjusted, highlights, places
from lfobench.stats.options import HighlightTest, Scope, Test
from lfobench.stats.power import smallest_p
from lfobench.stats.tests import Sample, margin, p_value, without_spread
from lfobench.tables.table import Column, Row, Table, competes

SCOPES: tuple[Scope, ...] = get_args(Scope)


@dataclass(frozen=True)
class PairCounts:
    """The first method against the second, over the tasks of both; the correction is over those that were tested.

    Attributes:
        first: subject.
        second: what it is held against.
        better: tasks on which the first has the higher mean or success rate, and the test tells them apart.
        worse: the lower one.
        undecided: the test does not tell them apart.
        untested: there was no test.
    """

    first: Column
    second: Column
    better: int
    worse: int
    undecided: int
    untested: int


@dataclass(frozen=True)
class Evidence:
    """The samples of a table's runs and every test between two of them.

    Attributes:
        table: whose.
        p: by test and row, one p-value per pair of `pairs`; None where there is no test.
        unavailable: why a test cannot decide this table, by test and scope.
    """

    table: Table
    p: dict[HighlightTest, tuple[tuple[float | None, ...], ...]]
    unavailable: dict[tuple[HighlightTest, Scope], str]

    @property
    def tests(self) -> tuple[HighlightTest, ...]:
        """Those that the page can choose from: the tests of scores, and of counts where cells show counts."""
        return tests_of(self.table)

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """The tasks, in table order."""
        return tuple(row for _, row in self.table.rows())

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The methods that were run here, in table order."""
        return tuple(column for column in self.table.columns if column.run_here)

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Indices of two different `columns`, the first smaller, in the order of `p`."""
        return tuple(combinations(range(len(self.columns)), 2))

    def competing(self, scope: Scope) -> tuple[Column, ...]:
        """The methods in scope."""
        return tuple(column for column in self.columns if competes(column, scope))

    def samples(self, row: Row) -> tuple[Sample | None, ...]:
        """The samples of a row, one per column of `columns`."""
        return run_samples(self.table, row)

    def count(self, pair: int) -> PairCounts:
        """How often the first of a pair is better than the second under the table's own rule."""
        rule = self.table.rule
        first, second = self.pairs[pair]
        differences, p_values = [], []
        untested = 0
        for row, of_row in zip(self.rows, self.p[rule.test], strict=True):
            one, two = (self.samples(row)[side] for side in (first, second))
            p = of_row[pair]
            if one is None or two is None:
                continue
            if p is None:
                untested += 1
            else:
                differences.append(margin(rule.test, one, two))
                p_values.append(p)
        apart = [
            difference
            for difference, corrected in zip(differences, adjusted(p_values, rule.correction), strict=True)
            if corrected < rule.alpha
        ]
        better, worse = sum(each > 0.0 for each in apart), sum(each < 0.0 for each in apart)
        undecided = len(p_values) - better - worse
        return PairCounts(self.columns[first], self.columns[second], better, worse, undecided, untested)

    def places(self, row: Row, test: HighlightTest) -> list[int | None]:
        """The place of every column in a row, 0 the best and level ones the same; None of one without a sample."""
        samples = {index: sample for index, sample in enumerate(self.samples(row)) if sample is not None}
        by_column = {index: place for place, level in enumerate(places(samples, test)) for index in level}
        return [by_column.get(index) for index in range(len(self.columns))]

    def without_spread(self, row: Row, test: HighlightTest) -> list[int]:
        """The pairs of `pairs` of which a t-test has no spread to estimate in a row."""
        samples = self.samples(row)
        return [
            index
            for index, (first, second) in enumerate(self.pairs)
            if (one := samples[first]) and (two := samples[second]) and without_spread(test, one, two)
        ]

    def best_case(self, row: Row, test: HighlightTest, scope: Scope) -> tuple[float, int] | None:
        """The smallest p-value that the test could give in a row, and the scores that takes; None for no test."""
        samples = [
            sample
            for column, sample in zip(self.columns, self.samples(row), strict=True)
            if sample is not None and competes(column, scope)
        ]
        sizes = sorted(scores_compared(test, sample) for sample in samples)
        smallest = smallest_p(test, sizes[-1], sizes[-2]) if len(sizes) > 1 else None
        return None if smallest is None else (smallest, sizes[-1])


def tests_of(table: Table) -> tuple[HighlightTest, ...]:
    """The tests that can be made of the cells of a table."""
    return (*get_args(Test), "fisher") if table.counts else get_args(Test)


def gather(table: Table) -> Evidence:
    """Every test between every two methods of every row of `table`."""
    rows = [run_samples(table, row) for _, row in table.rows()]
    tests = tests_of(table)
    return Evidence(
        table,
        {test: tuple(_p_values(test, samples) for samples in rows) for test in tests},
        {(test, scope): reason for test in tests for scope in SCOPES if (reason := _obstacle(table, test, scope))},
    )


def run_samples(table: Table, row: Row) -> tuple[Sample | None, ...]:
    """The samples of a row's runs, one per column that was run here."""
    return tuple(
        cell.sample if cell else None for column, cell in zip(table.columns, row.cells, strict=True) if column.run_here
    )


def _p_values(test: HighlightTest, samples: Sequence[Sample | None]) -> tuple[float | None, ...]:
    return tuple(
        None if one is None or two is None else _higher_first(test, one, two) for one, two in combinations(samples, 2)
    )


def _higher_first(test: HighlightTest, one: Sample, two: Sample) -> float | None:
    """The p-value as the highlight rule asks for it, the better side first: random relabellings see the order."""
    first, second = (two, one) if two.summary.mean > one.summary.mean else (one, two)
    try:
        return p_value(test, first, second)
    except ValueError:
        return None


def _obstacle(table: Table, test: HighlightTest, scope: Scope) -> str | None:
    """What keeps a test from deciding the rows: starts that two methods do not share, say."""
    rule = Rule(test, scope)
    rows = [
        {
            column: cell.sample
            for column, cell in zip(table.columns, row.cells, strict=True)
            if cell is not None and cell.sample is not None and competes(column, rule.scope)
        }
        for _, row in table.rows()
    ]
    try:
        highlights(rows, rule)
    except ValueError as error:
        return str(error)
    return None
