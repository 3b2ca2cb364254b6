"""The verdict: plain sentences generated from the numbers, and what the numbers cannot say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from lfobench.errors import UserError
from lfobench.html_report.knobs import in_scope, pair_counts
from lfobench.plots.captions import Compared, compare
from lfobench.record import Failure, Record, Warning
from lfobench.stats.aggregates import interquartile_mean, probability_of_improvement
from lfobench.stats.highlight import Outcome, Rule
from lfobench.stats.intervals import Estimate
from lfobench.stats.power import detectable_effect
from lfobench.tables.exporters.html import Markup, element, joined, name_of
from lfobench.tables.footnote import CORRECTIONS, SCOPES, TESTS
from lfobench.tables.table import Column, Row, Table
from lfobench.text import short_number

LEVEL = 0.95
REPLICATES = 10_000
"""Of every bootstrap in the page; the ends of its intervals vary in the last digit shown."""

_FEWEST_TASKS = 2
_POWER = 0.8


def verdict(table: Table) -> Markup:
    """The section; what depends on the knobs carries an ``id`` that the page's script knows."""
    shared = _shared(table)
    return element(
        "section",
        element("h2", "Verdict"),
        element("p", sentence(table), id="verdict", class_="verdict", aria_live="polite"),
        element("p", how(table), id="how", class_="how"),
        _pairs(table, shared),
        _aggregates(shared) if shared else Markup(""),
        element("h3", "What this can and cannot show"),
        element("ul", *(element("li", limit) for limit in limits(table, shared))),
        id="verdict-section",
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
    return f"Among {SCOPES[table.rule.scope]}, on {tasks(len(rows))}: {'; '.join(parts)}."


def how(table: Table) -> str:
    """The test behind the words, and what undecided means."""
    rule = table.rule
    tested = sum(row.p is not None for _, row in table.rows())
    return (
        f"Better means {TESTS[rule.test]} of best against second best, p < {rule.alpha:g}, "
        f"{_corrected(rule, f'the {tasks(tested)} tested')}. "
        "Undecided means that the test cannot tell the two apart, not that they are equal."
    )


def pairs_how(rule: Rule) -> str:
    """The test behind the counts of pairs."""
    return f"{TESTS[rule.test]}, p < {rule.alpha:g}, {_corrected(rule, 'the tasks of each pair')}."


def tasks(count: int) -> str:
    """``1 task``, ``2 tasks``."""
    return f"{count} {'task' if count == 1 else 'tasks'}"


def limits(table: Table, shared: Compared | None) -> Iterator[Markup]:
    """What this design could not have shown, what was left out, which runs went wrong; the first follows the knobs."""
    design = [note.text for note in table.notes if note.label == "Design"]
    yield element("span", design[0] if design else REACHABLE, id="design")
    yield element("span", _smallest_effect(table))
    if shared is None:
        yield element(
            "span",
            f"Aggregates over tasks are left out: they need {_FEWEST_TASKS} tasks on which every method has a score.",
        )
    elif shared.left_out:
        yield element(
            "span",
            f"The aggregates leave out {', '.join(shared.left_out)}, where a method has no score.",
        )
    for label in ("Seeds", "Diverged", "Failed", "Missing"):
        for note in table.notes:
            if note.label == label:
                yield element(
                    "span", element("b", f"{label}: "), element("span", note.text, class_="note"), data_note=label
                )


REACHABLE = "With this many scores the chosen test can come out significant, where a difference is large enough."


def _winner(table: Table, row: Row) -> Column:
    """The one highlighted method of a row that is decided."""
    return next(
        column for column, cell in zip(table.columns, row.cells, strict=True) if cell is not None and cell.highlighted
    )


def _corrected(rule: Rule, family: str) -> str:
    if rule.correction == "none":
        return "not corrected for the number of tests"
    return f"corrected by {CORRECTIONS[rule.correction]} over {family}"


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


def _shared(table: Table) -> Compared | None:
    """The tasks of all methods, where there are enough to speak of an aggregate."""
    try:
        compared = compare(table)
    except UserError:
        return None
    return compared if len(compared.tasks) >= _FEWEST_TASKS else None


def _pairs(table: Table, shared: Compared | None) -> Markup:
    counted = list(pair_counts(table))
    if not counted:
        return Markup("")
    numbers = ["better", "worse", "undecided", "untested"]
    headings = ["Method", "against", *numbers, *(["P(better run)"] if shared else [])]
    scope = in_scope(table)
    rows = []
    for index, counts in enumerate(counted):
        one, two = counts.first, counts.second
        cells = [element("td", str(getattr(counts, name)), class_="number", data_count=name) for name in numbers]
        if shared:
            chance = probability_of_improvement(shared.scores[one], shared.scores[two], LEVEL, REPLICATES)
            cells.append(element("td", _estimate(chance, 2), class_="number"))
        rows.append(
            element(
                "tr",
                element("th", name_of(one.label), scope="row"),
                element("td", name_of(two.label)),
                *cells,
                data_pair=str(index),
                hidden=not {one, two} <= scope,
            )
        )
    improvement = (
        f" P(better run): probability that a run of the first scores higher than a run of the second on the same "
        f"task, averaged over the {len(shared.tasks)} shared tasks; ties count one half. In brackets {_bootstrap()}."
        if shared
        else ""
    )
    return element(
        "div",
        element("h3", "Pair by pair"),
        element(
            "div",
            element(
                "table",
                element("thead", element("tr", *(element("th", heading, scope="col") for heading in headings))),
                element("tbody", *rows),
                class_="plain",
            ),
            class_="scroll",
        ),
        element(
            "p",
            "Tasks on which the first method is better or worse than the second: ",
            element("span", pairs_how(table.rule), id="pairs-how"),
            improvement,
            class_="caption",
        ),
        id="pairs",
        hidden=len(scope) < 2,
    )


def _aggregates(shared: Compared) -> Markup:
    rows = [
        element(
            "tr",
            element("th", name_of(column.label), scope="row"),
            element("td", _estimate(interquartile_mean(scores, LEVEL, REPLICATES), 1), class_="number"),
        )
        for column, scores in shared.scores.items()
    ]
    few = (
        " So few tasks are a small sample of all that one could ask; the interval says nothing of other tasks."
        if len(shared.tasks) < 10
        else ""
    )
    return element(
        "div",
        element("h3", "Over all tasks"),
        element(
            "div",
            element(
                "table",
                element(
                    "thead",
                    element(
                        "tr", element("th", "Method", scope="col"), element("th", "Interquartile mean", scope="col")
                    ),
                ),
                element("tbody", *rows),
                class_="plain",
            ),
            class_="scroll",
        ),
        element(
            "p",
            f"Mean of the middle half of all runs of the {len(shared.tasks)} shared tasks; in brackets {_bootstrap()}."
            f"{few}",
            class_="caption",
        ),
    )


def _bootstrap() -> str:
    return f"the {LEVEL:.0%} interval of a bootstrap stratified by task, {REPLICATES:,} replicates, where these differ"


def _estimate(estimate: Estimate, digits: int) -> str:
    interval = estimate.interval
    form = f"z.{digits}f"
    ends = (
        f" [{short_number(interval.low, form)}, {short_number(interval.high, form)}]" if interval else " (no interval)"
    )
    return f"{short_number(estimate.value, form)}{ends}"


def problems_section(records: Sequence[Record], failures: Sequence[Failure], warnings: Sequence[Warning]) -> Markup:
    """Failures with their tracebacks, divergences, warnings; a plain sentence where there are none."""
    diverged = [record for record in records if record.status == "diverged"]
    concerned: dict[tuple[str, str], list[str]] = {}
    for warning in warnings:
        concerned.setdefault((warning.what, warning.remedy), [])
    for record in records:
        for warning in record.warnings:
            concerned.setdefault((warning.what, warning.remedy), []).append(_place(record))
    parts = [_failures(failures), _diverged(diverged), _warnings(concerned)]
    nothing = element("p", "No run failed, none diverged, and no record carries a warning.")
    return element(
        "section",
        element("h2", "Failures and warnings"),
        joined(part for part in parts if part) or nothing,
        id="problems",
    )


def _failures(failures: Sequence[Failure]) -> Markup:
    if not failures:
        return Markup("")
    entries = [
        element(
            "details",
            element("summary", name_of(_place(failure)), ": ", failure.error),
            element("pre", "\n".join(failure.traceback) or "No traceback was kept.", tabindex="0"),
        )
        for failure in failures
    ]
    return joined(
        [
            element("h3", f"Failed runs ({len(failures)})"),
            element("p", "They have no score and are in no mean; running the same command tries them again."),
            *entries,
        ]
    )


def _diverged(records: Sequence[Record]) -> Markup:
    if not records:
        return Markup("")
    entries = [
        element(
            "li",
            name_of(_place(record)),
            f": at step {record.diverged_at:,}" if record.diverged_at is not None else "",
        )
        for record in records
    ]
    return joined(
        [
            element("h3", f"Diverged runs ({len(records)})"),
            element("p", "They count with score 0."),
            element("ul", *entries),
        ]
    )


def _warnings(concerned: Mapping[tuple[str, str], Sequence[str]]) -> Markup:
    if not concerned:
        return Markup("")
    entries = [
        element("li", f"{what} {remedy}", *([" Runs: ", name_of("; ".join(runs)), "."] if runs else []))
        for (what, remedy), runs in concerned.items()
    ]
    return joined([element("h3", f"Warnings ({len(entries)})"), element("ul", *entries)])


def _place(run: Record | Failure) -> str:
    return f"{run.method} on {run.task}, seed {run.seed}"
