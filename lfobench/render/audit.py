"""An audit for a terminal and in Markdown: the verdict first, then the tables."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import wrap

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from lfobench.render.audit_text import Audit, stated_contradictions, table_reports, verdict
from lfobench.render.audit_words import Grid, TableReport
from lfobench.render.layout import Section, aligned, wrapped
from lfobench.render.markdown import escape
from lfobench.render.table import Note

_STATED = "Stated by the transcriber, not computed"


def terminal(audit: Audit) -> RenderableType:
    """What ``Console.print`` draws an audit from."""
    return _Terminal(audit)


def markdown(audit: Audit) -> str:
    """The audit in GitHub-flavoured Markdown."""
    publication = audit.publication
    lines = [f"# Audit of {escape(publication.name)}", ""]
    if publication.paper:
        lines += [f"{escape(publication.paper)}.", ""]
    lines += [escape(verdict(audit)), ""]
    for report in table_reports(audit):
        lines += _markdown_table(report)
    if stated := stated_contradictions(audit):
        lines += [f"## {_STATED}", "", *(f"- {escape(text)}" for text in stated), ""]
    return "\n".join(lines)


class _Terminal:
    def __init__(self, audit: Audit) -> None:
        self.audit = audit

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        audit, width = self.audit, options.max_width
        if audit.publication.paper:
            yield Text(audit.publication.paper, "dim")
            yield Text()
        yield from _paragraph(verdict(audit), width, "bold")
        for report in table_reports(audit):
            yield Text()
            yield Text(report.title, "bold")
            for sentence in report.summary:
                yield from _paragraph(sentence, width)
            for grid in report.grids:
                yield Text()
                yield from aligned(grid.columns, [Section(grid.heading, "italic", grid.rows)], width)
            yield Text()
            yield from wrapped(report.notes, width)
        if stated := stated_contradictions(audit):
            yield Text()
            yield Text(_STATED, "bold")
            yield from wrapped([Note("-", text) for text in stated], width)


def _paragraph(text: str, width: int, style: str = "") -> Iterator[Text]:
    # A task's name is easier to read and to search for in one piece.
    for line in wrap(text, width, break_on_hyphens=False):
        yield Text(line, style)


def _markdown_table(report: TableReport) -> Iterator[str]:
    yield from (f"## {escape(report.title)}", "")
    for sentence in report.summary:
        yield from (escape(sentence), "")
    for grid in report.grids:
        yield from _markdown_grid(grid)
    yield from (f"- **{escape(note.label)}**: {escape(note.text)}" for note in report.notes)
    yield ""


def _markdown_grid(grid: Grid) -> Iterator[str]:
    yield _line((grid.heading, *grid.columns))
    yield _line((":--", *("--:" for _ in grid.columns)), escaped=False)
    yield from (_line(row) for row in grid.rows)
    yield ""


def _line(fields: tuple[str, ...], escaped: bool = True) -> str:
    return f"| {' | '.join(escape(field) if escaped else field for field in fields)} |"
