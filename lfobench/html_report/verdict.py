"""The verdict: plain sentences generated from the numbers, and the limits of what the numbers can show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lfobench.errors import UserError
from lfobench.html_report.knobs import in_scope, pair_counts
from lfobench.plots.captions import LEVEL, Compared, compare
from lfobench.stats.aggregates import interquartile_mean, probability_of_improvement
from lfobench.stats.highlight import Outcome, Rule
from lfobench.stats.intervals import Estimate
from lfobench.stats.power import detectable_effect
from lfobench.tables.footnote import CORRECTIONS, SCOPES, TESTS
from lfobench.tables.table import Column, Row, Table
from lfobench.text import counted, short_number

REPLICATES = 10_000
"""Replicates of every bootstrap in the page; the ends of its intervals vary in the last digit shown."""

BOOTSTRAP = f"the {LEVEL:.0%} interval of a bootstrap stratified by task, {REPLICATES:,} replicates, where these differ"

_FEWEST_TASKS = 2
_POWER = 0.8


@dataclass(frozen=True)
class PairRow:
    """Two methods: on how many tasks the first is better or worse, and how probably a run of it is.

    Attributes:
        first: label of the first method.
        second: of the second.
        counts: tasks by verdict.
        improvement: empty without aggregates.
        hidden: whether the scope of the rule leaves the pair out.
    """

    first: str
    second: str
    counts: Mapping[str, int]
    improvement: str
    hidden: bool


@dataclass(frozen=True)
class Aggregates:
    """Interquartile means by method's label, over a number of shared tasks."""

    tasks: int
    means: Mapping[str, str]


@dataclass(frozen=True)
class Verdict:
    """The section's texts; `sentence`, `how`, `pairs_how`, `design` and what is `hidden` follow the knobs."""

    sentence: str
    how: str
    pairs: tuple[PairRow, ...]
    pairs_how: str
    aggregates: Aggregates | None
    design: str
    limits: tuple[str, ...]


def verdict(table: Table) -> Verdict:
    """The verdict under the table's own rule."""
    shared = _shared(table)
    aggregates = None
    if shared:
        means = {
            column.label: _estimate(interquartile_mean(scores, LEVEL, REPLICATES), 1)
            for column, scores in shared.scores.items()
        }
        aggregates = Aggregates(len(shared.tasks), means)
    return Verdict(
        sentence(table),
        how(table),
        tuple(_pairs(table, shared)),
        pairs_how(table.rule),
        aggregates,
        design(table),
        (_smallest_effect(table), *_left_out(shared)),
    )


def sentence(table: Table) -> str:
    """``Among the methods without expert actions, on 3 tasks: dilo is better than the second best on 2; …``."""
    rows = [row for _, row in table.rows()]
    outcomes: Counter[Outcome] = Counter(row.outcome for row in rows)
    parts = []
    if outcomes["better"] or outcomes["undecided"]:
        winners = Counter(_winner(table, row) for row in rows if row.outcome == "better")
        named = [f"{column.label} on {winners[column]}" for column in table.columns if winners[column]]
        parts.append(f"better than the second best: {', '.join(named) or 'none'}")
        parts.append(f"undecided on {outcomes['undecided']}")
    if outcomes["untested"]:
        parts.append(f"not tested on {outcomes['untested']}")
    if outcomes["all failed"]:
        parts.append(f"no success at all on {outcomes['all failed']}")
    if outcomes["unopposed"]:
        parts.append(f"nothing to compare on {outcomes['unopposed']}")
    return f"Among {SCOPES[table.rule.scope]}, on {counted(len(rows), 'task')}: {'; '.join(parts)}."


def how(table: Table) -> str:
    """The test behind better and worse, and the meaning of undecided."""
    rule = table.rule
    tested = sum(row.p is not None for _, row in table.rows())
    family = f"the {counted(tested, 'task')} tested"
    return (
        f"Better means {TESTS[rule.test]} of best against second best, p < {rule.alpha:g}, {_corrected(rule, family)}. "
        "Undecided means that the test cannot tell the two apart, not that they are equal."
    )


def pairs_how(rule: Rule) -> str:
    """The test behind the counts of pairs."""
    return f"{TESTS[rule.test]}, p < {rule.alpha:g}, {_corrected(rule, 'the tasks of each pair')}."


def design(table: Table) -> str:
    """Whether any result could have come out significant."""
    notes = [note.text for note in table.notes if note.label == "Design"]
    reachable = "With this many scores the chosen test can come out significant, where a difference is large enough."
    return notes[0] if notes else reachable


def _corrected(rule: Rule, family: str) -> str:
    if rule.correction == "none":
        return "not corrected for the number of tests"
    return f"corrected by {CORRECTIONS[rule.correction]} over {family}"


def _winner(table: Table, row: Row) -> Column:
    """The one highlighted method of a row that is decided."""
    return next(
        column for column, cell in zip(table.columns, row.cells, strict=True) if cell is not None and cell.highlighted
    )


def _shared(table: Table) -> Compared | None:
    """The tasks of all methods, where there are enough to speak of an aggregate."""
    try:
        compared = compare(table)
    except UserError:
        return None
    return compared if len(compared.tasks) >= _FEWEST_TASKS else None


def _pairs(table: Table, shared: Compared | None) -> Iterator[PairRow]:
    scope = in_scope(table)
    for counts in pair_counts(table):
        first, second = counts.first, counts.second
        improvement = ""
        if shared:
            estimate = probability_of_improvement(shared.scores[first], shared.scores[second], LEVEL, REPLICATES)
            improvement = _estimate(estimate, 2)
        yield PairRow(first.label, second.label, counts.by_verdict, improvement, not {first, second} <= scope)


def _estimate(estimate: Estimate, digits: int) -> str:
    form, interval = f"z.{digits}f", estimate.interval
    ends = f"[{short_number(interval.low, form)}, {short_number(interval.high, form)}]" if interval else "(no interval)"
    return f"{short_number(estimate.value, form)} {ends}"


def _smallest_effect(table: Table) -> str:
    sizes = [cell.sample.summary.n for _, column, cell in table.cells() if column.run_here and cell and cell.sample]
    fewest, alpha = min(sizes), table.rule.alpha
    if fewest < 2:
        return "Somewhere a method has a single seed, of which nothing is known but its score; it cannot be tested."
    if not 0.0 < alpha < 1.0:
        return f"At level {alpha:g} every verdict is settled beforehand."
    effect = detectable_effect(fewest, _POWER, alpha)
    return (
        f"With {fewest} seeds per method, Welch's test at p < {alpha:g} finds a difference with probability {_POWER:g} "
        f"only from {effect:.1f} standard deviations on; smaller ones mostly stay undecided."
    )


def _left_out(shared: Compared | None) -> Iterator[str]:
    if shared is None:
        yield f"Aggregates over tasks are left out: they need {_FEWEST_TASKS} tasks on which every method has a score."
    elif shared.left_out:
        yield f"The aggregates leave out {', '.join(shared.left_out)}, where a method has no score."
