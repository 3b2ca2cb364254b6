"""Published columns: numbers of a publication next to ours, success counts or scores, with the result of a test."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

from lfobench.errors import UserError
from lfobench.records.publication import Publication, TableOfCounts, TableOfMeans
from lfobench.stats.intervals import Summary, equivalence_test
from lfobench.stats.successes import Count, Successes
from lfobench.stats.tests import Sample, p_value
from lfobench.tables.table import AGREEMENTS, Block, Cell, Column, ColumnKind, Note, Row, Table

PublishedCell = Callable[[Block, Row, Column, Cell | None], Cell | None]
"""The published cell that belongs to a cell of ours, given its block, row and column; None where there is none."""


def columns_in_common(table: Table, name: str, here: Collection[str], methods: Collection[str]) -> list[Column]:
    """Our columns whose methods were published, too.

    Args:
        table: ours.
        name: of the published table.
        here: methods that it has on a task of ours.
        methods: all that it has.

    Raises:
        UserError: it has nothing of ours, or two columns show one method, so that a verdict would be ambiguous.
    """
    columns = [column for column in table.columns if column.run_here and column.method in here]
    if not columns:
        raise UserError(
            f"{name} has no number for any task and method of this table.",
            f"It has the methods {', '.join(sorted(methods))}.",
        )
    names = [column.method for column in columns]
    repeated = next((method for method in names if names.count(method) > 1), None)
    if repeated is not None:
        labels = " and ".join(column.label for column in columns if column.method == repeated)
        raise UserError(
            f"{labels} would both be compared with the published {repeated}.",
            "Choose one, e.g. with --preset released.",
        )
    return columns


def with_columns(
    table: Table, ours: Sequence[Column], comparable: bool, published_cell: PublishedCell, notes: Sequence[Note]
) -> Table:
    """`table` with a published column for each of `ours`, and more notes."""
    kind: ColumnKind = "published" if comparable else "incomparable"
    added = tuple(Column(column.method, column.method, "", kind) for column in ours)
    blocks = tuple(
        replace(block, rows=tuple(_with_cells(block, row, table.columns, ours, published_cell) for row in block.rows))
        for block in table.blocks
    )
    return replace(table, columns=(*table.columns, *added), blocks=blocks, notes=(*table.notes, *notes))


def _with_cells(
    block: Block, row: Row, columns: Sequence[Column], ours: Sequence[Column], published_cell: PublishedCell
) -> Row:
    added = [
        published_cell(block, row, column, cell)
        for column, cell in zip(columns, row.cells, strict=True)
        if column in ours
    ]
    return replace(row, cells=(*row.cells, *added))


@dataclass(frozen=True)
class PublishedScores:
    """One published table of normalised scores.

    Attributes:
        name: how the footnote calls it, e.g. ``dilo-2024, Table 1``.
        source: of its data, a source of ours.
        protocol: of its runs, a protocol of ours.
        scores: by task and method.
        remark: what a reader must know of n, the simulator and the like; whole sentences.
    """

    name: str
    source: str
    protocol: str
    scores: Mapping[tuple[str, str], Summary]
    remark: str


def published_scores(publication: Publication) -> PublishedScores:
    """The scores of a publication's first table of normalised scores.

    n is what the table gives for a cell, else the smallest number that the paper states. A cell without a spread is
    shown and cannot be tested.

    Raises:
        UserError: no table says what source and protocol it is of, or none says n.
    """
    table = next((each for each in publication.tables if isinstance(each, TableOfMeans) and each.source), None)
    if table is None:
        raise UserError(
            f"{publication.name} has no table that says which source and protocol its scores are of.",
            "Only such a table can be compared with records.",
        )
    claimed = sorted(claim.n for claim in table.claims)
    scores: dict[tuple[str, str], Summary] = {}
    for row in table.rows:
        for method, cell in row.cells.items():
            n = cell.n if cell.n is not None else min(claimed, default=None)
            if n is None:
                raise UserError(f"{publication.name}, {table.title} does not say n.", "Give it a column n.")
            scores[row.name, method] = Summary(n if cell.std is not None else 1, cell.mean, cell.std)
    stated = " and ".join(f"{claim.n} ({claim.where})" for claim in table.claims)
    taken = f" The paper states n = {stated}; the smallest is taken here." if len(claimed) > 1 else ""
    return PublishedScores(
        f"{publication.name}, {table.title}", table.source, table.protocol, scores, f"{table.environments}.{taken}"
    )


def with_published(table: Table, published: PublishedScores, margin: float, alpha: float, anyway: bool) -> Table:
    """`table` with a published column for every method that was published on one of its tasks.

    A published cell carries the result of the equivalence test that compares our cell in the same row with it.

    Raises:
        UserError: the table's source or protocol is another and `anyway` is false; nothing of the table was
            published; or two columns show one method, so that a verdict would be ambiguous.
    """
    differences = [
        f"{kind} is '{ours}' here and '{theirs}' there"
        for kind, ours, theirs in (
            ("source", table.source, published.source),
            ("protocol", table.protocol, published.protocol),
        )
        if ours != theirs
    ]
    if differences and not anyway:
        raise UserError(
            f"These records are not comparable with {published.name}: the {' and the '.join(differences)}.",
            "Add --anyway to see them next to each other, labelled as such.",
        )
    tasks = {row.task for _, row in table.rows()}
    ours = columns_in_common(
        table,
        published.name,
        {method for task, method in published.scores if task in tasks},
        {method for _, method in published.scores},
    )

    def published_cell(_block: Block, row: Row, column: Column, our_cell: Cell | None) -> Cell | None:
        theirs = published.scores.get((row.task, column.method))
        if theirs is None:
            return None
        if our_cell is None or our_cell.summary is None:
            return Cell(Sample(theirs))
        return Cell(Sample(theirs), agreement=equivalence_test(our_cell.summary, theirs, margin, alpha).agreement)

    return with_columns(table, ours, not differences, published_cell, _notes(published, differences, margin, alpha))


def _notes(published: PublishedScores, differences: Sequence[str], margin: float, alpha: float) -> list[Note]:
    notes = [
        Note(
            "Published",
            f"{published.name}. {published.remark} Ours against it: {AGREEMENTS['matches']} matches, the difference is "
            f"shown to be below {margin:g} points (two one-sided Welch tests, each at {alpha:g}); "
            f"{AGREEMENTS['differs']} differs (Welch's test, p < {alpha:g}, each cell alone, not corrected); "
            f"{AGREEMENTS['undecided']} undecided, "
            "neither is shown.",
        )
    ]
    if differences:
        notes.append(
            Note("Not comparable", f"the {' and the '.join(differences)}; shown because --anyway was asked for.")
        )
    return notes


PLACE = ("task", "dataset")
"""Columns that name a published row: our environment's name, and our group of tasks."""


@dataclass(frozen=True)
class PublishedCounts:
    """One published table of successes.

    Attributes:
        name: how the footnote calls it, e.g. ``dilo-2024, Robot table``.
        counts: by environment, group and method.
    """

    name: str
    counts: Mapping[tuple[str, str, str], Count]

    def methods_on(self, table: Table) -> set[str]:
        """Methods that it has on a task of `table`."""
        places = {(row.label, block.label) for block, row in table.rows()}
        return {method for environment, group, method in self.counts if (environment, group) in places}


def published_counts(publication: Publication) -> PublishedCounts:
    """The counts of a publication's first table of successes whose rows are named as ours are.

    Raises:
        UserError: there is none.
    """
    for table in publication.tables:
        if isinstance(table, TableOfCounts) and all(set(row.place) == set(PLACE) for row in table.rows):
            counts = {
                (row.place["task"], row.place["dataset"], method): Count(cell.successes, cell.trials)
                for row in table.rows
                for method, cell in row.cells.items()
            }
            return PublishedCounts(f"{publication.name}, {table.title}", counts)
    raise UserError(
        f"{publication.name} has no table of successes with the columns {', '.join(PLACE)}, method, successes, trials.",
        "Only such a table can be compared with success counts; --test welch shows scores.",
    )


def counts_are_published(table: Table, publication: Publication) -> bool:
    """Whether a publication counts successes on a task of `table`."""
    try:
        return bool(published_counts(publication).methods_on(table))
    except UserError:
        return False


def with_published_counts(table: Table, published: PublishedCounts, alpha: float, anyway: bool) -> Table:
    """`table` with a published column for every method that was published on one of its tasks.

    A published cell carries the result of Fisher's exact test, at `alpha`, of our pooled count in the same row against
    it. No published count is of a source and a protocol of ours, so they are shown only where `anyway` is true.

    Raises:
        UserError: `anyway` is false; nothing of the table was published; or two columns show one method.
    """
    here = f"these episodes are simulated (source '{table.source}', protocol '{table.protocol}')"
    there = "its trials are of no source and no protocol of lfobench, as those of a real robot are"
    if not anyway:
        raise UserError(
            f"These records are not comparable with {published.name}: {here}, and {there}.",
            "Add --anyway to see them next to each other, labelled as such.",
        )
    ours = columns_in_common(
        table, published.name, published.methods_on(table), {method for _, _, method in published.counts}
    )

    def published_cell(block: Block, row: Row, column: Column, our_cell: Cell | None) -> Cell | None:
        count = published.counts.get((row.label, block.label, column.method))
        if count is None:
            return None
        # Nobody published scores by seed: the rate is shown as the score of one.
        theirs = Sample(Summary(1, 100.0 * count.rate, None), successes=Successes(count, count))
        if our_cell is None or our_cell.sample is None:
            return Cell(theirs)
        p = p_value("fisher", our_cell.sample, theirs)
        assert p is not None
        return Cell(theirs, agreement="differs" if p < alpha else "not told apart", agreement_p=p)

    notes = (
        Note(
            "Published",
            f"{published.name}: successes out of trials as printed, Wilson's 95% interval computed here. Ours against "
            f"them by Fisher's exact two-sided test, each cell alone, not corrected: {AGREEMENTS['differs']} differs "
            f"(p < {alpha:g}), {AGREEMENTS['not told apart']} not told apart, which is no proof that they agree; p "
            "follows the sign.",
        ),
        Note("Not comparable", f"{here}, and {there}; shown because --anyway was asked for."),
    )
    return with_columns(table, ours, False, published_cell, notes)


def with_publication(table: Table, publication: Publication, margin: float, anyway: bool) -> Table:
    """`table` with a published column for every method that was published on one of its tasks.

    Args:
        table: ours.
        publication: theirs.
        margin: points within which a score matches a published one; counts are compared without a margin.
        anyway: show numbers that are not comparable, labelled as such.

    Raises:
        UserError: a margin that is not positive, a level that leaves nothing of the test, or numbers that are not there
            or not comparable.
    """
    if not 0.0 < margin < inf:
        raise UserError(f"--margin {margin:g} is not a margin.", "Give a number of points above 0, e.g. 5.")
    alpha = table.rule.alpha
    if table.counts:
        return with_published_counts(table, published_counts(publication), alpha, anyway)
    if table.success_rates and counts_are_published(table, publication):
        raise UserError(
            f"{publication.name} counts successes on these tasks, and --test {table.rule.test} shows scores.",
            "Leave out --test, or give --test fisher.",
        )
    if not 0.0 < alpha < 0.5:
        raise UserError(f"alpha = {alpha:g} leaves nothing of an equivalence test.", "Choose one below 0.5.")
    return with_published(table, published_scores(publication), margin, alpha, anyway)
