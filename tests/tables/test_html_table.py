"""The fragment: the table's numbers, highlights and notes, and nothing that a page must fetch or run."""

from __future__ import annotations

import re
from collections.abc import Callable

from test_markup import Reader

from lfobench.record import Record
from lfobench.tables.building import build_table
from lfobench.tables.exporters.html import html


def rows(fragment: str) -> list[list[tuple[str, str]]]:
    """(class, text) of every cell of every body row."""
    body = re.search(r"<tbody>(.*)</tbody>", fragment, re.DOTALL)
    assert body
    return [
        [
            (attributes, Reader(content).text)
            for attributes, content in re.findall(r"<t[hd]([^>]*)>(.*?)</t[hd]>", row, re.DOTALL)
        ]
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", body[1], re.DOTALL)
    ]


def test_every_number_is_in_its_place_and_the_highlights_are_those_of_the_table(example: list[Record]) -> None:
    table = build_table(example)
    found = rows(html(table))
    assert [row[1][1] for row in found] == [row.label for _, row in table.rows()]
    for cells, (_, row) in zip(found, table.rows(), strict=True):
        for (attributes, text), cell in zip(cells[2:], row.cells, strict=True):
            assert ("highlighted" in attributes) == (cell is not None and cell.highlighted)
            if cell is not None and cell.summary is not None:
                assert text.startswith(f"{cell.summary.mean:.1f}")
                assert cell.summary.std is None or f"± {cell.summary.std:.1f}" in text


def test_notes_and_groups_are_there(example: list[Record]) -> None:
    table = build_table(example)
    text = Reader(html(table)).text
    for note in table.notes:
        assert note.text in text
    assert "Access to expert actions" in text


def test_names_are_escaped(make_cell: Callable[..., list[Record]]) -> None:
    hostile = "</td><script>alert(1)</script>"
    fragment = html(build_table([*make_cell([1.0, 2.0], hostile), *make_cell([4.0, 5.0], "dilo")]))
    assert "<script" not in fragment
    assert hostile in Reader(fragment).text


def test_a_fragment_fetches_and_runs_nothing(example: list[Record]) -> None:
    fragment = html(build_table(example))
    assert fragment.startswith('<figure class="lfobench-table">')
    assert not re.search(r"https?:|url\(|@import|<script|<link|\bsrc=|\bhref=|\bstyle=", fragment)


def test_a_column_with_one_seed_among_several_keeps_its_means_in_line(make_cell: Callable[..., list[Record]]) -> None:
    table = build_table([*make_cell([1.0, 2.0]), *make_cell([3.0], row="ant")])
    assert html(table).count("spread slot-3") == 2
