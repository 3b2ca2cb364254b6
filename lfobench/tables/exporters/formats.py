"""The textual formats by name, for ``lfobench table --format NAME``."""

from __future__ import annotations

from collections.abc import Callable

from lfobench.errors import unknown_name
from lfobench.tables.exporters.data import comma_separated, json_table
from lfobench.tables.exporters.html import html
from lfobench.tables.exporters.latex import latex
from lfobench.tables.exporters.markdown import markdown
from lfobench.tables.table import Table

FORMATS: dict[str, Callable[[Table], str]] = {
    "markdown": markdown,
    "latex": latex,
    "csv": comma_separated,
    "json": json_table,
    "html": html,
}


def export(table: Table, format_name: str) -> str:
    """`table` in the named format.

    Raises:
        UserError: there is no such format.
    """
    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
    return FORMATS[format_name](table)
