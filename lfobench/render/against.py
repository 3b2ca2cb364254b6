"""Published numbers beside ours: ghost columns, each number with a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lfobench.contract.publication import Publication, TableOfMeans
from lfobench.errors import UserError
from lfobench.render.cell_text import AGREEMENTS
from lfobench.render.ghosts import published_columns, with_ghosts
from lfobench.render.table import Block, Cell, Column, Note, Row, Table
from lfobench.stats.equivalence import equivalence_test
from lfobench.stats.sample import Sample
from lfobench.stats.summary import Summary


@dataclass(frozen=True)
class PublishedScores:
    """One published table of normalised scores.

    Attributes:
        name: how the footnote calls it, e.g. ``dilo-2024, Table 1``.
        source: of its data, in our words.
        protocol: of its runs, in our words.
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
            "Only such a table can be held against records.",
        )
    claimed = sorted(claim.n for claim in table.claims)
    scores: dict[tuple[str, str], Summary] = {}
    for row in table.rows:
        for method, cell in row.cells.items():
            n = cell.n if cell.n is not None else min(claimed, default=None)
            if n is None:
                raise UserError(f"{publication.name}, {table.title} does not say n.", "Give it a column n.")
            scores[row.name, method] = Summary(n if cell.std is not None else 1, cell.mean, cell.std)
    said = " and ".join(f"{claim.n} ({claim.where})" for claim in table.claims)
    taken = f" The paper states n = {said}; the smallest is taken here." if len(claimed) > 1 else ""
    return PublishedScores(
        f"{publication.name}, {table.title}", table.source, table.protocol, scores, f"{table.environments}.{taken}"
    )


def with_published(table: Table, published: PublishedScores, margin: float, alpha: float, anyway: bool) -> Table:
    """`table` with a ghost column for every method that was published on one of its tasks.

    The verdict of a ghost cell is the equivalence test's of our cell in the same row against it.

    Raises:
        UserError: the table's source or protocol is another and `anyway` is false; nothing of the table was
            published; or two columns show one method, so that a verdict would be ambiguous.
    """
    differing = [
        f"{kind} is '{ours}' here and '{theirs}' there"
        for kind, ours, theirs in (
            ("source", table.source, published.source),
            ("protocol", table.protocol, published.protocol),
        )
        if ours != theirs
    ]
    if differing and not anyway:
        raise UserError(
            f"These records are not comparable with {published.name}: the {' and the '.join(differing)}.",
            "Add --anyway to see them side by side, labelled as such.",
        )
    tasks = {row.task for _, row in table.rows()}
    beside = published_columns(
        table,
        published.name,
        {method for task, method in published.scores if task in tasks},
        {method for _, method in published.scores},
    )

    def ghost(_block: Block, row: Row, column: Column, ours: Cell | None) -> Cell | None:
        theirs = published.scores.get((row.task, column.method))
        if theirs is None:
            return None
        if ours is None or ours.summary is None:
            return Cell(Sample(theirs))
        return Cell(Sample(theirs), agreement=equivalence_test(ours.summary, theirs, margin, alpha).agreement)

    return with_ghosts(table, beside, not differing, ghost, _notes(published, differing, margin, alpha))


def _notes(published: PublishedScores, differing: Sequence[str], margin: float, alpha: float) -> list[Note]:
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
    if differing:
        notes.append(
            Note("Not comparable", f"the {' and the '.join(differing)}; shown because --anyway was asked for.")
        )
    return notes
