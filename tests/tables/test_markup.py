"""Elements: whatever is put in comes out as text, never as markup."""

from __future__ import annotations

from html.parser import HTMLParser

from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.tables.exporters.html import Markup, element, joined
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


@given(st.text(max_size=40))
@settings(max_examples=100)
def test_text_and_attributes_come_out_as_they_went_in(text: str) -> None:
    read = Reader(element("p", text, title=text))
    assert read.tags == ["p"]
    assert read.text == harmless_lines(text)
    assert read.attributes == [("title", harmless_lines(text))]


def test_markup_is_kept_and_attributes_follow_their_values() -> None:
    inner = element("b", "a < b")
    made = element("td", inner, " & ", class_="x", data_row="3", hidden=True, title=None, open=False, x=1.5)
    assert made == '<td class="x" data-row="3" hidden x="1.5"><b>a &lt; b</b> &amp; </td>'
    assert element("br") == "<br>"
    assert joined([Markup("<i>"), "<i>"]) == "<i>&lt;i&gt;"


def test_what_would_reach_beyond_a_name_is_made_visible() -> None:
    assert harmless_lines("a\u202eb\x00c\u2069d\ne") == "a\\u202eb\\x00c\\u2069d\ne"
    assert harmless_lines("שלום ± –") == "שלום ± –"
