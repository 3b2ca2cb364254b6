"""An audit of a publication as text: the verdict first, then every table with its rows and notes; and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast, get_args

from lfobench.errors import UserError, unknown_name
from lfobench.records.publication import Publication, TableOfCounts, TableOfMeans
from lfobench.stats.audit import (
    LARGEST_N_TRIED,
    MOST_SEEDS,
    POWER,
    AuditAtN,
    AuditedCounts,
    AuditedRow,
    CountsAudit,
    CountsRule,
    CountTest,
    Effect,
    MeansAudit,
    audit_counts,
    audit_means,
)
from lfobench.stats.contradictions import Contradiction
from lfobench.stats.highlight import Rule
from lfobench.stats.options import Correction, Test
from lfobench.stats.tests import FROM_SUMMARIES
from lfobench.tables.document import Document, Grid, Heading, Items, Notes, Paragraphs, Part, Section
from lfobench.tables.exporters.json import json_text
from lfobench.tables.footnote import CORRECTIONS, TESTS
from lfobench.tables.table import MISSING, Note
from lfobench.text import counted

COUNT_TESTS: dict[CountTest, str] = {
    "fisher": "Fisher's exact test",
    "boschloo": "Boschloo's exact test",
}

_NEEDED = "needs n"
_NO_N = "nothing was tested, because n is not stated (say it with --n)"


@dataclass(frozen=True)
class Audit:
    """A publication, and one audit per table of it."""

    publication: Publication
    tables: tuple[MeansAudit | CountsAudit, ...]


MOST_TRIALS_OF_BOSCHLOO = 1000
"""Its memory grows with the product of the trials, since it looks at every pair of counts."""


def audit_publication(
    publication: Publication,
    sizes: Sequence[int] = (),
    methods: Sequence[str] = (),
    test: str = "welch",
    count_test: str = "fisher",
    correction: str = "none",
    alpha: float = 0.05,
) -> Audit:
    """The audit of every table that has one of the `methods`.

    Args:
        publication: with its tables.
        sizes: samples behind each mean; as stated where there are none.
        methods: that compete; as the publication says where there are none.
        test: of means.
        count_test: of counts.
        correction: of the rule.
        alpha: level of the test.

    Raises:
        UserError: an unknown name, sizes of counts, or a test that is too costly or needs every score.
    """
    rule = _rule(test, correction, alpha)
    if count_test not in get_args(CountTest):
        raise unknown_name("test of counts", count_test, get_args(CountTest))
    counts_rule = CountsRule(cast("CountTest", count_test), rule.correction, rule.alpha)
    _check_sizes(sizes, publication)
    _check_methods(methods, publication)
    if count_test == "boschloo":
        _check_trials(publication)
    audits = []
    for table in publication.tables:
        if not methods or set(methods) & set(table.methods):
            compared = [method for method in methods if method in table.methods] or table.compared or table.methods
            audits.append(
                audit_means(table, compared, rule, sorted(set(sizes)))
                if isinstance(table, TableOfMeans)
                else audit_counts(table, compared, counts_rule)
            )
    return Audit(publication, tuple(audits))


def _rule(test: str, correction: str, alpha: float) -> Rule:
    chosen = next((known for known in FROM_SUMMARIES if known == test), None)
    if chosen is None:
        if test not in get_args(Test):
            raise unknown_name("test", test, FROM_SUMMARIES)
        raise UserError(
            f"'{test}' needs every score, and a published table holds only n, mean and standard deviation.",
            f"Choose {' or '.join(sorted(FROM_SUMMARIES, reverse=True))}.",
        )
    if correction not in get_args(Correction):
        raise unknown_name("correction", correction, get_args(Correction))
    if not 0.0 < alpha < 1.0:
        raise UserError(f"alpha = {alpha:g} is not a level that a test can have.", "Choose one such as 0.05.")
    return Rule(chosen, correction=cast("Correction", correction), alpha=alpha)


def _check_sizes(sizes: Sequence[int], publication: Publication) -> None:
    # Nine digits: far more than any table has, and few enough for every formula.
    if not all(2 <= size < 10**9 for size in sizes):
        raise UserError(
            f"{', '.join(map(str, sizes))} are not numbers of samples, each at least 2.", "Write, for example, 5."
        )
    if sizes and not any(isinstance(table, TableOfMeans) for table in publication.tables):
        raise UserError(f"{publication.name} counts successes, and states its trials.", "Leave out --n.")


def _check_methods(methods: Sequence[str], publication: Publication) -> None:
    known = {method for table in publication.tables for method in table.methods}
    if len(methods) == 1:
        raise UserError(f"'{methods[0]}' alone has nothing to be compared with.", f"Known: {', '.join(sorted(known))}.")
    for name in methods:
        if name not in known:
            raise unknown_name("method of this publication", name, known)


def _check_trials(publication: Publication) -> None:
    counts = [table for table in publication.tables if isinstance(table, TableOfCounts)]
    most = max((cell.trials for table in counts for row in table.rows for cell in row.cells.values()), default=0)
    if most > MOST_TRIALS_OF_BOSCHLOO:
        raise UserError(
            f"Boschloo's test is too costly for {most:,} trials (at most {MOST_TRIALS_OF_BOSCHLOO:,}).",
            "Use --count-test fisher.",
        )


def document(audit: Audit) -> Document:
    """The audit for a terminal and in Markdown."""
    publication = audit.publication
    parts: list[Part] = [Heading(f"Audit of {publication.name}", 1)]
    if publication.paper:
        parts.append(Paragraphs((publication.paper,), "dim"))
    parts.append(Paragraphs((verdict(audit),), "bold"))
    for table in audit.tables:
        parts += _means_parts(table) if isinstance(table, MeansAudit) else _counts_parts(table)
    if publication.contradictions:
        stated = tuple(f"{each.about}: {each.first}; {each.second}." for each in publication.contradictions)
        parts += [Heading("Stated by the transcriber, not computed"), Items(stated)]
    return Document(tuple(parts))


def verdict(audit: Audit) -> str:
    """One paragraph: what follows from the numbers and what does not."""
    parts = [
        f"{table.table.title}: {_means_verdict(table) if isinstance(table, MeansAudit) else _counts_verdict(table)}"
        for table in audit.tables
    ]
    computed = sum(len(table.contradictions) for table in audit.tables)
    stated = len(audit.publication.contradictions)
    found = f"Contradictions: {computed} in the numbers"
    return " ".join([*parts, f"{found}, {stated} in the text as its transcriber states." if stated else f"{found}."])


# Tables of means


def _means_verdict(audit: MeansAudit) -> str:
    if not audit.by_n:
        reproduced = _reproducing(audit)
        return f"{_NO_N}{f'; {reproduced}' if reproduced else ''}."
    sentences = []
    for at_n in audit.by_n:
        judged, winners = at_n.judged, at_n.winners
        follow = sum(bool(row.follows) for row in judged)
        text = f"{follow} of {len(judged)} printed highlights follow" if judged else "no printed highlight to judge"
        left = len(winners) - len(at_n.lost("holm"))
        single = counted(len(winners), "single winner")
        open_rows = len(at_n.undecided_by_print)
        blurred = f", {open_rows} not decided by the printed numbers" if open_rows else ""
        sentences.append(f"with {_n(at_n)}, {text}{blurred}, and Holm leaves {left} of {single}")
    return f"{'; '.join(sentences)}."


def _means_parts(audit: MeansAudit) -> Iterator[Part]:
    """Everything, with a grid of rows per number of samples."""
    yield Heading(audit.table.title)
    summary = [
        f"Rule: {TESTS[audit.rule.test]} of best against second best in a row, among {', '.join(audit.compared)}; the "
        f"best alone is highlighted if p < {audit.rule.alpha:g}, both otherwise. "
        f"Correction for multiple comparisons: {CORRECTIONS[audit.rule.correction]}.",
        *(_follows(audit, at_n) for at_n in audit.by_n),
    ]
    if not audit.by_n:
        summary.append(f"{_sentence(_NO_N)}.")
    if reproduced := _reproducing(audit):
        summary.append(f"{_sentence(reproduced)}.")
    yield Paragraphs(tuple(summary))
    yield from (_at_n(audit, at_n) for at_n in audit.by_n)
    if not audit.by_n:
        yield _without_n(audit)
    yield Notes(tuple(_means_notes(audit)))


def _follows(audit: MeansAudit, at_n: AuditAtN) -> str:
    where = " and ".join(claim.where for claim in audit.table.claims if claim.n == at_n.n)
    judged, winners = at_n.judged, at_n.winners
    text = f"With {_n(at_n)}{f' ({where})' if where else ''}: "
    if open_rows := at_n.undecided_by_print:
        text += f"{counted(len(open_rows), 'row is', 'rows are')} not decided by the printed numbers"
        text += f"{_listed(':', [row.name for row in open_rows])}. "
    if judged:
        contrary = [
            f"{row.name} ({_names(row.printed)} printed, {_names(row.ruled)} by the rule)"
            for row in judged
            if not row.follows
        ]
        text += f"{len(judged) - len(contrary)} of {len(judged)} printed highlights follow"
        text += f"{_listed('; not', contrary)}. "
    text += f"{counted(len(winners), 'row has', 'rows have')} a single winner before any correction"
    corrections: tuple[Correction, ...] = ("holm", "bh")
    for correction in corrections:
        lost = at_n.lost(correction)
        text += f"; {CORRECTIONS[correction]} over {len(at_n.tested)} rows leaves {len(winners) - len(lost)}"
        text += _listed(", without", [row.name for row in lost])
    return f"{text}."


def _reproducing(audit: MeansAudit) -> str:
    """Numbers of samples for which the rule gives every printed highlight; empty where that cannot be asked."""
    tried = f"n from 2 to {LARGEST_N_TRIED}"
    n = audit.reproducing
    if n:
        ranged = (
            f"n = {n[0]} to {n[-1]}" if len(n) > 2 and n[-1] - n[0] == len(n) - 1 else f"n = {', '.join(map(str, n))}"
        )
        return f"the rule gives every printed highlight for {ranged}, of {tried}"
    printed = any(cell.highlighted is not None for row in audit.table.rows for cell in row.cells.values())
    if any(at_n.n is None for at_n in audit.by_n) or not printed:
        return ""
    return f"the rule gives every printed highlight for no {tried}"


def _at_n(audit: MeansAudit, at_n: AuditAtN) -> Grid:
    rows = [
        (
            row.name,
            _names(row.printed),
            f"{'does not follow: ' if row.follows is False else ''}{_outcome(audit, at_n, row)}",
            _p_range(row),
            _p(row.holm),
            _p(row.bh),
            _needed(effect),
        )
        for row, effect in zip(at_n.rows, audit.effects, strict=True)
    ]
    columns = ("highlighted", "verdict", "p", "Holm", "BH", _NEEDED)
    return Grid(columns, [Section(f"{audit.table.title}, {_n(at_n)}", "italic", rows)])


def _without_n(audit: MeansAudit) -> Grid:
    rows = []
    for row, effect in zip(audit.table.rows, audit.effects, strict=True):
        marked = frozenset(method for method in audit.compared if method in row.cells and row.cells[method].highlighted)
        rows.append((row.name, _names(marked), effect.best if effect else MISSING, _needed(effect)))
    return Grid(("highlighted", "best", _NEEDED), [Section(f"{audit.table.title}, n not stated", "italic", rows)])


def _outcome(audit: MeansAudit, at_n: AuditAtN, row: AuditedRow) -> str:
    if row.outcome == "untested":
        return "not tested"
    if row.outcome == "unopposed":
        return "no competitor"
    if not row.decided:
        return "not decided by the printed numbers"
    if row.outcome == "better":
        lost = audit.rule.correction != "holm" and row in at_n.lost("holm")
        # Where the highlight follows, its column names the winner already.
        named = "" if row.follows else f"{_names(row.ruled)} "
        return f"{named}better{', Holm undecided' if lost else ''}"
    return f"undecided{', better uncorrected' if row in at_n.winners else ''}"


def _p_range(row: AuditedRow) -> str:
    """p; where unprinted digits decide, the range that they leave open."""
    if row.p_range is None or row.decided:
        return _p(row.p)
    low, high = map(_p, row.p_range)
    return f"{low} to {high}"


def _means_notes(audit: MeansAudit) -> Iterator[Note]:
    yield from _contradiction_notes(audit.contradictions)
    yield Note(
        _NEEDED.capitalize(),
        f"samples of each of the two for power {POWER:g} by Welch's test at {audit.rule.alpha:g}; in brackets, at the "
        "first step of Holm, the level over the number of rows. It takes the printed difference and spreads for the "
        "true ones, which favours differences that were printed because they were large.",
    )
    for at_n in audit.by_n:
        for row, effect in zip(at_n.rows, audit.effects, strict=True):
            if row.p_range is None or row.decided or effect is None:
                continue
            yield Note(
                "Not decided",
                f"{row.name}, {_n(at_n)}: {_spreads(audit, row, effect)}, p up to {row.p_range[1]:.2g} and down to "
                f"{row.p_range[0]:.2g}: not decided by the printed numbers.",
            )
    if audit.by_n:
        yield Note("Holm, BH", "p corrected over the rows tested, by Holm and by Benjamini and Hochberg.")
    yield Note(
        "Spread",
        "what the table prints after ± is read as the sample standard deviation, rounded to the digits printed; ± 0 as "
        "the largest that prints so. A verdict holds for every spread that prints alike, with the means as printed.",
    )


def _spreads(audit: MeansAudit, row: AuditedRow, effect: Effect) -> str:
    """``± 0 may be up to ± 0.5``, of the two methods that were compared."""
    cells = next(each for each in audit.table.rows if each.name == row.name).cells
    texts = dict.fromkeys(
        f"± {cell.std:g} may be up to ± {cell.spreads[1]:g}"
        for method in (effect.best, effect.second)
        if (cell := cells[method]).spreads is not None
    )
    return ", ".join(texts)


def _n(at_n: AuditAtN) -> str:
    return "n as each cell states" if at_n.n is None else f"n = {at_n.n}"


def _needed(effect: Effect | None) -> str:
    if effect is None:
        return MISSING
    if effect.needed is None:
        return f">{MOST_SEEDS}"
    return f"{effect.needed} ({effect.needed_by_holm or f'>{MOST_SEEDS}'})"


# Tables of counts


def _counts_verdict(audit: CountsAudit) -> str:
    better = [row for row in audit.rows if row.outcome == "better"]
    closest, test = audit.closest, COUNT_TESTS[audit.rule.test]
    if closest is None:
        return "no row has two methods to compare."
    text = (
        f"{counted(len(better), 'row has', 'rows have') if better else 'no row has'} a better method by {test}"
        f"{_listed(':', [row.name for row in better])} (smallest p {_p(closest.p)}, {closest.name})"
    )
    highlighted = [row for row in audit.rows if row.printed]
    merely = [row for row in highlighted if row.merely_largest]
    return f"{text}; {len(merely)} of {len(highlighted)} highlighted rows mark merely the largest count."


def _counts_parts(audit: CountsAudit) -> Iterator[Part]:
    """Everything: verdicts in one grid of rows, rates in another."""
    rule, title = audit.rule, audit.table.title
    yield Heading(title)
    yield Paragraphs(
        (
            f"Rule: {COUNT_TESTS[rule.test]}, two-sided, of best against second best in a row, among "
            f"{', '.join(audit.compared)}; better if p < {rule.alpha:g}. "
            f"Correction for multiple comparisons: {CORRECTIONS[rule.correction]}.",
            _sentence(_counts_verdict(audit)),
        )
    )
    verdicts = [
        (row.name, _names(row.printed), _counts_outcome(row), _p(row.p), _p(row.holm), _p(row.bh)) for row in audit.rows
    ]
    rates = [
        (row.name, *(_rate(audit, index, method) for method in audit.compared)) for index, row in enumerate(audit.rows)
    ]
    yield Grid(("highlighted", "verdict", "p", "Holm", "BH"), [Section(title, "italic", verdicts)])
    yield Grid(audit.compared, [Section(f"{title}, successes", "italic", rates)])
    yield Notes(
        (
            *_contradiction_notes(audit.contradictions),
            Note("Brackets", "Wilson's 95% interval of the success rate."),
            Note(
                "Trials", "taken as independent; trials of one trained policy share its seed, and then p is too small."
            ),
        )
    )


def _counts_outcome(row: AuditedCounts) -> str:
    if row.outcome == "better":
        return f"{_names(row.best)} better"
    return "no competitor" if row.outcome == "unopposed" else "undecided"


def _rate(audit: CountsAudit, index: int, method: str) -> str:
    cell, interval = audit.table.rows[index].cells.get(method), audit.rows[index].intervals.get(method)
    if cell is None or interval is None:
        return MISSING
    return f"{cell.successes}/{cell.trials} [{interval.low:.2f}, {interval.high:.2f}]"


# Texts of both


def _contradiction_notes(contradictions: Sequence[Contradiction]) -> Iterator[Note]:
    for found in contradictions:
        yield Note("Contradiction", f"{f'{found.where}: ' if found.where else ''}{found.text}.")


def _p(p: float | None) -> str:
    """A p-value to four decimals; a dash where there was no test."""
    if p is None:
        return MISSING
    return "<0.0001" if p < 0.0001 else f"{p:.4f}"


def _names(methods: frozenset[str] | None) -> str:
    """Names in the order of the alphabet; a dash for none."""
    return ", ".join(sorted(methods)) if methods else MISSING


def _listed(before: str, names: Sequence[str]) -> str:
    """``before`` and the names; nothing where there is no name."""
    return f"{before} {', '.join(names)}" if names else ""


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


# JSON


def json_audit(audit: Audit) -> str:
    """One object: the verdict, a finding per table, the contradictions of the text.

    Numbers of samples are null where more than ``most_samples`` would be needed.
    """
    publication = audit.publication
    return json_text(
        {
            "publication": publication.name,
            "paper": publication.paper,
            "verdict": verdict(audit),
            "power": POWER,
            "most_samples": MOST_SEEDS,
            "tables": [
                _means_value(table) if isinstance(table, MeansAudit) else _counts_value(table) for table in audit.tables
            ],
            "stated_contradictions": [
                {"about": stated.about, "first": stated.first, "second": stated.second}
                for stated in publication.contradictions
            ],
        }
    )


def _means_value(audit: MeansAudit) -> dict[str, Any]:
    return {
        **_table_value(audit, "means"),
        "claims_of_n": [{"n": claim.n, "where": claim.where} for claim in audit.table.claims],
        "n_that_give_every_highlight": list(audit.reproducing),
        "by_n": [_at_n_value(at_n) for at_n in audit.by_n],
        "effects": [
            {"row": row.name, **_effect_value(effect)}
            for row, effect in zip(audit.table.rows, audit.effects, strict=True)
        ],
        "contradictions": [asdict(each) for each in audit.contradictions],
    }


def _at_n_value(at_n: AuditAtN) -> dict[str, Any]:
    return {
        "n": at_n.n,
        "printed_highlights": len(at_n.judged),
        "follow": sum(bool(row.follows) for row in at_n.judged),
        "rows_tested": len(at_n.tested),
        "single_winners": len(at_n.winners),
        "lost_by_holm": [row.name for row in at_n.lost("holm")],
        "lost_by_bh": [row.name for row in at_n.lost("bh")],
        "not_decided_by_the_printed_numbers": [row.name for row in at_n.undecided_by_print],
        "rows": [
            {**_row_value(row), "p_range": row.p_range, "follows": row.follows, "by_the_rule": sorted(row.ruled)}
            for row in at_n.rows
        ],
    }


def _effect_value(effect: Effect | None) -> dict[str, Any]:
    return {
        "best": effect and effect.best,
        "second": effect and effect.second,
        "difference": effect and effect.difference,
        "n_needed": effect and effect.needed,
        "n_needed_by_holm": effect and effect.needed_by_holm,
    }


def _counts_value(audit: CountsAudit) -> dict[str, Any]:
    return {
        **_table_value(audit, "counts"),
        "smallest_p": audit.closest and audit.closest.p,
        "merely_the_largest_count": [row.name for row in audit.rows if row.merely_largest],
        "rows": [
            {
                **_row_value(row),
                "best": sorted(row.best),
                "wilson_95": {method: [interval.low, interval.high] for method, interval in row.intervals.items()},
            }
            for row in audit.rows
        ],
        "contradictions": [asdict(each) for each in audit.contradictions],
    }


def _table_value(audit: MeansAudit | CountsAudit, kind: str) -> dict[str, Any]:
    rule = audit.rule
    return {
        "table": audit.table.title,
        "kind": kind,
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "compared": list(audit.compared),
    }


def _row_value(row: AuditedRow | AuditedCounts) -> dict[str, Any]:
    return {
        "row": row.name,
        "printed": None if row.printed is None else sorted(row.printed),
        "outcome": row.outcome,
        "p": row.p,
        "holm": row.holm,
        "bh": row.bh,
    }
