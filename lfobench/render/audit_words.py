"""What the reports of audited tables are made of, and how their parts are spelt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lfobench.render.cell_text import MISSING
from lfobench.render.table import Note
from lfobench.stats.contradictions import Contradiction


@dataclass(frozen=True)
class Grid:
    """Rows of text: `columns` names the cells, the first of a row being what it is about."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class TableReport:
    """One table: what follows, the rows, and what a reader must know to judge them."""

    title: str
    summary: tuple[str, ...]
    grids: tuple[Grid, ...]
    notes: tuple[Note, ...]


def contradiction_notes(contradictions: Sequence[Contradiction]) -> Iterator[Note]:
    """One note for each of what was found in the numbers."""
    for found in contradictions:
        yield Note("Contradiction", f"{f'{found.where}: ' if found.where else ''}{found.text}.")


def p_text(p: float | None) -> str:
    """A p-value to four decimals; a dash where there was no test."""
    if p is None:
        return MISSING
    return "<0.0001" if p < 0.0001 else f"{p:.4f}"


def methods_text(methods: frozenset[str] | None) -> str:
    """Names in the order of the alphabet; a dash for none."""
    return ", ".join(sorted(methods)) if methods else MISSING


def listed(before: str, names: Sequence[str]) -> str:
    """``before`` and the names; nothing where there is no name."""
    return f"{before} {', '.join(names)}" if names else ""
