"""The figures by name, for ``lfobench plot KIND``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from lfobench.errors import UserError, unknown_name
from lfobench.plots.comparisons import improvement, profiles, ranking, scores
from lfobench.plots.curves import curves
from lfobench.plots.figure import WIDTHS, PaperFigure
from lfobench.plots.metrics import metrics
from lfobench.plots.success_share import success_share
from lfobench.record import Record
from lfobench.tables.table import Table

Plot: TypeAlias = Callable[[Table, Sequence[Record], float, Sequence[str]], PaperFigure]


def _of_table(plot: Callable[[Table, float, Sequence[str]], PaperFigure]) -> Plot:
    return lambda table, _records, width, methods: plot(table, width, methods)


PLOTS: dict[str, Plot] = {
    "curves": curves,
    "scores": _of_table(scores),
    "profiles": _of_table(profiles),
    "improvement": lambda table, _records, width, _methods: improvement(table, width),
    "ranking": _of_table(ranking),
    "metrics": metrics,
    "share": success_share,
}


def check_kind(kind: str) -> None:
    """Refuse, before anything is read or computed, a kind that is not in `PLOTS`.

    Raises:
        UserError: naming the closest one.
    """
    if kind not in PLOTS:
        raise unknown_name("kind of plot", kind, PLOTS)


def draw(
    kind: str,
    table: Table,
    records: Sequence[Record],
    width: str = "column",
    methods: Sequence[str] = (),
    names: Sequence[str] = (),
) -> PaperFigure:
    """The figure of this kind.

    Args:
        kind: one of `PLOTS`.
        table: made of `records`.
        records: with the evaluations, which learning curves need.
        width: one of `style.WIDTHS`.
        methods: names in the order in which colours are handed out, see `style.looks`.
        names: of the training metrics that ``metrics`` draws; empty for all.

    Raises:
        UserError: an unknown kind or width, or too few tasks or methods for this kind.
    """
    check_kind(kind)
    if width not in WIDTHS:
        raise unknown_name("width", width, WIDTHS)
    if not any(column.run_here for column in table.columns):
        raise UserError("There are no runs to draw.", "Run `lfobench run` first.")
    if kind == "metrics":
        return metrics(table, records, WIDTHS[width], methods, names)
    if names:
        raise UserError(
            f"--metric chooses training metrics, and '{kind}' draws scores.", "Draw 'metrics', or leave it out."
        )
    return PLOTS[kind](table, records, WIDTHS[width], methods)
