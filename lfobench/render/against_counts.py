"""Published success counts beside ours: Fisher's test tells them apart, or does not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lfobench.contract.publication import Publication, TableOfCounts
from lfobench.errors import UserError
from lfobench.render.cell_text import AGREEMENTS
from lfobench.render.ghosts import published_columns, with_ghosts
from lfobench.render.table import Block, Cell, Column, Note, Row, Table
from lfobench.stats.comparison import p_value
from lfobench.stats.sample import Sample
from lfobench.stats.successes import Count, Successes
from lfobench.stats.summary import Summary

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
        "Only such a table can be held against success counts; --test welch shows scores.",
    )


def counts_are_published(table: Table, publication: Publication) -> bool:
    """Whether a publication counts successes on a task of `table`."""
    try:
        return bool(published_counts(publication).methods_on(table))
    except UserError:
        return False


def with_published_counts(table: Table, published: PublishedCounts, alpha: float, anyway: bool) -> Table:
    """`table` with a ghost column for every method that was published on one of its tasks.

    The verdict of a ghost cell is Fisher's exact test of our pooled count in the same row against it, at `alpha`. No
    published count is of a source and a protocol of ours, so they are shown only where `anyway` is true.

    Raises:
        UserError: `anyway` is false; nothing of the table was published; or two columns show one method.
    """
    here = f"these episodes are simulated (source '{table.source}', protocol '{table.protocol}')"
    there = "its trials are of no source and no protocol of lfobench, as those of a real robot are"
    if not anyway:
        raise UserError(
            f"These records are not comparable with {published.name}: {here}, and {there}.",
            "Add --anyway to see them side by side, labelled as such.",
        )
    beside = published_columns(
        table, published.name, published.methods_on(table), {method for _, _, method in published.counts}
    )

    def ghost(block: Block, row: Row, column: Column, ours: Cell | None) -> Cell | None:
        count = published.counts.get((row.label, block.label, column.method))
        if count is None:
            return None
        # Nobody published scores by seed: the rate is shown as the score of one.
        theirs = Sample(Summary(1, 100.0 * count.rate, None), successes=Successes(count, count))
        if ours is None or ours.sample is None:
            return Cell(theirs)
        p = p_value("fisher", ours.sample, theirs)
        assert p is not None
        return Cell(theirs, agreement="differs" if p < alpha else "not told apart", agreement_p=p)

    notes = (
        Note(
            "Published",
            f"{published.name}: successes out of trials as printed, Wilson's 95% interval computed here. Ours against "
            f"them by Fisher's exact two-sided test, each cell alone, not corrected: {AGREEMENTS['differs']} differs "
            f"(p < {alpha:g}), {AGREEMENTS['not told apart']} not told apart, which is no proof that they agree; p "
            "stands behind the sign.",
        ),
        Note("Not comparable", f"{here}, and {there}; shown because --anyway was asked for."),
    )
    return with_ghosts(table, beside, False, ghost, notes)
