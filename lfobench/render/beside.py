"""A publication beside a table: its success counts beside ours, its scores beside ours."""

from __future__ import annotations

from math import inf

from lfobench.contract.publication import Publication
from lfobench.errors import UserError
from lfobench.render.against import published_scores, with_published
from lfobench.render.against_counts import counts_are_published, published_counts, with_published_counts
from lfobench.render.table import Table


def beside(table: Table, publication: Publication, margin: float, anyway: bool) -> Table:
    """`table` with a ghost column for every method that was published on one of its tasks.

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
