"""Everything that the page's knobs can show: the table decided under each of their settings, computed here.

The page's script holds no rule and no statistics. It switches between these views.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product
from typing import get_args

from lfobench.errors import UserError
from lfobench.stats.highlight import Rule, adjusted
from lfobench.stats.options import HighlightTest, Scope, Test
from lfobench.stats.tests import Sample, margin, p_value
from lfobench.tables.building import decided
from lfobench.tables.footnote import CORRECTIONS, SCOPES, TESTS, unit
from lfobench.tables.table import Column, Row, Table, competes

ALPHAS = (0.1, 0.05, 0.01, 0.005, 0.001)


@dataclass(frozen=True)
class PairCounts:
    """The first method compared with the second, over the tasks of both; the correction is over the tests made.

    Attributes:
        first: subject.
        second: the method that it is compared with.
        better: tasks on which the first has the higher mean or success rate, and the test tells them apart.
        worse: tasks on which it has the lower one.
        undecided: tasks on which the test does not tell them apart.
        untested: tasks without a test.
    """

    first: Column
    second: Column
    better: int
    worse: int
    undecided: int
    untested: int

    @property
    def by_verdict(self) -> dict[str, int]:
        """The four counts by name."""
        return {
            "better": self.better,
            "worse": self.worse,
            "undecided": self.undecided,
            "untested": self.untested,
        }


@dataclass(frozen=True)
class Knobs:
    """The settings of a page: every test that its cells allow, scope, correction and level.

    Attributes:
        table: under the rule that the page opens with.
        tables: the table under every rule that can decide it.
        obstacles: why a test cannot decide it, by test and scope.
    """

    table: Table
    tables: dict[Rule, Table]
    obstacles: dict[tuple[HighlightTest, Scope], str]


def knobs_of(table: Table) -> Knobs:
    """Decide the table under every setting of the knobs."""
    tables: dict[Rule, Table] = {}
    obstacles: dict[tuple[HighlightTest, Scope], str] = {}
    for test, scope in product(tests_of(table), SCOPES):
        for rule in _rules(test, scope, alphas_of(table)):
            try:
                tables[rule] = decided(table, rule)
            except UserError as error:
                obstacles[test, scope] = error.problem.removeprefix("The test cannot be made: ")
                break
    return Knobs(table, tables, obstacles)


def tests_of(table: Table) -> tuple[HighlightTest, ...]:
    """The tests that can be made of the cells of a table."""
    return (*get_args(Test), "fisher") if table.counts else get_args(Test)


def alphas_of(table: Table) -> tuple[float, ...]:
    """The levels to choose from, the table's own among them."""
    return tuple(sorted({*ALPHAS, table.rule.alpha}, reverse=True))


@dataclass(frozen=True)
class Choices:
    """Options of the page's form: (value, text) pairs; the tests by the unit that they count."""

    tests: dict[str, list[tuple[str, str]]]
    scopes: list[tuple[str, str]]
    corrections: list[tuple[str, str]]
    alphas: list[tuple[str, str]]


def choices(table: Table) -> Choices:
    """Options of the form for `table`."""
    tests: dict[str, list[tuple[str, str]]] = {}
    for test in tests_of(table):
        tests.setdefault(_UNITS[unit(test)], []).append((test, _short(TESTS[test])))
    return Choices(
        tests,
        list(SCOPES.items()),
        list(CORRECTIONS.items()),
        [(repr(alpha), f"{alpha:g}") for alpha in alphas_of(table)],
    )


_UNITS = {"seed": "over seeds", "start state": "over common start states", "episode": "over episodes"}


def _short(test: str) -> str:
    """``the two-sided Mann-Whitney test`` to ``Mann-Whitney test``: a choice needs no article."""
    name = test.replace("two-sided ", "").removeprefix("the ")
    return name[0].upper() + name[1:]


def pair_counts(table: Table) -> Iterator[PairCounts]:
    """Counts of verdicts for every pair of methods, under the table's own rule."""
    samples = [_samples(table, row) for _, row in table.rows()]
    for first, second in combinations((column for column in table.columns if column.run_here), 2):
        both = [(of_row[first], of_row[second]) for of_row in samples if first in of_row and second in of_row]
        yield _count(table.rule, first, second, both)


def in_scope(table: Table) -> set[Column]:
    """The methods that the table's rule compares."""
    return {column for column in table.columns if competes(column, table.rule.scope)}


def _rules(test: HighlightTest, scope: Scope, alphas: tuple[float, ...]) -> Iterator[Rule]:
    for correction, alpha in product(CORRECTIONS, alphas):
        yield Rule(test, scope, correction, alpha)


def _samples(table: Table, row: Row) -> dict[Column, Sample]:
    return {
        column: cell.sample
        for column, cell in zip(table.columns, row.cells, strict=True)
        if column.run_here and cell is not None and cell.sample is not None
    }


def _count(rule: Rule, first: Column, second: Column, samples: list[tuple[Sample, Sample]]) -> PairCounts:
    p_values = [_p_value(rule.test, *pair) for pair in samples]
    tested = [(margin(rule.test, *pair), p) for pair, p in zip(samples, p_values, strict=True) if p is not None]
    corrected = adjusted([p for _, p in tested], rule.correction)
    apart = [difference for (difference, _), p in zip(tested, corrected, strict=True) if p < rule.alpha]
    better, worse = sum(each > 0.0 for each in apart), sum(each < 0.0 for each in apart)
    return PairCounts(first, second, better, worse, len(tested) - better - worse, len(samples) - len(tested))


def _p_value(test: HighlightTest, one: Sample, two: Sample) -> float | None:
    """The p-value as in the highlight rule, the better sample first: random relabellings depend on the order."""
    first, second = (two, one) if two.summary.mean > one.summary.mean else (one, two)
    try:
        return p_value(test, first, second)
    except ValueError:
        return None
