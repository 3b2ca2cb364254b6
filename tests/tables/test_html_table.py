"""The fragment: the table's numbers, highlights and notes, and nothing that a page must fetch or run."""

from __future__ import annotations

import re
from collections.abc import Callable
from html.parser import HTMLParser

from hypothesis import given, settings
from hypothesis import strategies as st
from jinja2 import DictLoader

from lfobench.record import Record
from lfobench.tables.building import build_table
from lfobench.tables.exporters.html import export, templates
from lfobench.text import harmless_lines


class Reader(HTMLParser):
    """The tags, attributes and text that a browser would see."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attributes

    def handle_data(self, data: str) -> None:
        self.text += data


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
    found = rows(export(table))
    assert [row[1][1] for row in found] == [row.label for _, row in table.rows()]
    for cells, (_, row) in zip(found, table.rows(), strict=True):
        for (attributes, text), cell in zip(cells[2:], row.cells, strict=True):
            assert ("highlighted" in attributes) == (cell is not None and cell.highlighted)
            if cell is not None and cell.summary is not None:
                assert text.startswith(f"{cell.summary.mean:.1f}")
                assert cell.summary.std is None or f"± {cell.summary.std:.1f}" in text


def test_notes_and_groups_are_there(example: list[Record]) -> None:
    table = build_table(example)
    text = Reader(export(table)).text
    for note in table.notes:
        assert note.text in text
    assert "Access to expert actions" in text


def test_names_are_escaped(make_cell: Callable[..., list[Record]]) -> None:
    hostile = "</td><script>alert(1)</script>"
    fragment = export(build_table([*make_cell([1.0, 2.0], hostile), *make_cell([4.0, 5.0], "dilo")]))
    assert "<script" not in fragment
    assert hostile in Reader(fragment).text


def test_a_fragment_fetches_and_runs_nothing(example: list[Record]) -> None:
    fragment = export(build_table(example))
    assert fragment.startswith('<figure class="lfobench-table">')
    assert not re.search(r"https?:|url\(|@import|<script|<link|\bsrc=|\bhref=|\bstyle=", fragment)


def test_a_column_with_one_seed_among_several_keeps_its_means_in_line(make_cell: Callable[..., list[Record]]) -> None:
    table = build_table([*make_cell([1.0, 2.0]), *make_cell([3.0], row="ant")])
    assert export(table).count("spread slot-3") == 2


@given(st.text(max_size=40))
@settings(max_examples=100)
def test_text_and_attributes_come_out_of_a_template_as_they_went_in(text: str) -> None:
    template = templates(DictLoader({"p": '<p title="{{ text }}">{{ text }}</p>'})).get_template("p")
    read = Reader(template.render(text=text))
    assert read.tags == ["p"]
    assert read.text == harmless_lines(text)
    assert read.attributes == [("title", harmless_lines(text))]


def test_a_name_cannot_reach_beyond_itself() -> None:
    assert harmless_lines("a\u202eb\x00c\u2069d\ne") == "a\\u202eb\\x00c\\u2069d\ne"
    assert harmless_lines("שלום ± –") == "שלום ± –"
