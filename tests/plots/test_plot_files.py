"""Figures as files: the same bytes every time, text as text, hostile names as they are written."""

from __future__ import annotations

import functools
import os
import re
import subprocess
import sys
import zlib
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import pytest
from helpers_cli import PATIENCE
from helpers_records import make_cell
from matplotlib.text import Text

from lfobench.errors import UserError
from lfobench.plots.figure import FORMATS, PaperFigure, format_of, look, looks, one_line
from lfobench.plots.kinds import PLOTS, draw
from lfobench.record import Metrics, Record
from lfobench.tables.building import build_table
from lfobench.tables.table import Column

MAGIC = {"png": b"\x89PNG\r\n\x1a\n", "svg": b"<?xml", "pdf": b"%PDF-"}
HOSTILE = ("$x_1^2$", "_<b>&amp;", "100%\\ tab\tand\nline", "bell\x07\ud800")


def small() -> list[Record]:
    return [
        record
        for row in ("hopper", "ant")
        for place, name in enumerate("abc")
        for record in make_cell([10.0 * place, 10.0 * place + 7.0, 40.0], name, row=row)
    ]


@functools.cache
def shared(kind: str) -> PaperFigure:
    """A figure that several tests read."""
    return drawn(kind, small())


def with_share(record: Record) -> Record:
    """A record of one environment, whose offline data has another share of successes on each task."""
    identity = record.identity
    recipe = {**identity["recipe"], "success_share": len(record.task) / 100}
    environment = {"name": "one", "id": "One-v0", "random_return": 0.0, "expert_return": 100.0}
    return record.model_copy(update={"identity": {**identity, "recipe": recipe, "environment": environment}})


def drawn(kind: str, records: list[Record]) -> PaperFigure:
    loss = [
        Metrics(stage="train", step=100, values={"loss": 2.0}),
        Metrics(stage="train", step=200, values={"loss": 1.0}),
    ]
    measured = [record.model_copy(update={"metrics": loss}) for record in records]
    if kind == "share":
        measured = [with_share(record) for record in measured]
    return draw(kind, build_table(measured), measured)


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLOTS)
def test_equal_records_give_equal_bytes_and_names_as_they_are_written(kind: str) -> None:
    records = [
        record for row in ("a$b_c", "<d>") for name in HOSTILE for record in make_cell([10.0, 30.0], name, row=row)
    ]
    one, two = drawn(kind, records), drawn(kind, records)
    assert one.caption == two.caption
    for format_name in FORMATS:
        image = one.image(format_name)
        assert image.startswith(MAGIC[format_name])
        assert image == two.image(format_name)
    shown = [text.get_text().replace("\n", " ") for text in one.findobj(Text)]
    root = ElementTree.fromstring(one.image("svg"))
    written = ["".join(element.itertext()) for element in root.iter() if element.tag.endswith("}text")]
    for name in map(one_line, HOSTILE):
        assert any(name in text for text in shown)
    # Short enough to stand on one line.
    for name in HOSTILE[:2]:
        assert any(name in text for text in written)


@pytest.mark.parametrize("kind", ["curves", "scores", "ranking"])
def test_names_too_long_for_their_place_are_broken_and_stay_inside(kind: str) -> None:
    records = [
        record
        for row in ("long-" * 30, "hopper")
        for name in "abc"
        for record in make_cell([10.0, 30.0], name * 70, row=row)
    ]
    figure = drawn(kind, records)
    width, height = figure.get_size_inches() * figure.dpi
    names = [text for text in figure.findobj(Text) if re.search("aaa|bbb|ccc|long", text.get_text())]
    assert len(names) >= 3
    for text in names:
        box = text.get_window_extent()
        assert box.x0 > -2.0 and box.x1 < width + 2.0 and box.y0 > -2.0 and box.y1 < height + 2.0, text


def test_text_is_text_in_svg_and_truetype_in_pdf() -> None:
    figure = shared("scores")
    assert "hopper-random-expert" in figure.image("svg").decode()
    pdf = figure.image("pdf")
    streams = [zlib.decompress(part) for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.S)
               if part[:1] == b"\x78"]  # fmt: skip
    content = pdf + b"".join(streams)
    assert b"/CIDFontType2" in content or b"/TrueType" in content
    assert b"/Type3" not in content


def test_the_caption_goes_into_the_file_and_no_date_does() -> None:
    figure = shared("scores")
    assert "n = 3" in figure.caption
    assert "quick" in figure.caption
    assert "generated" in figure.caption
    svg = figure.image("svg").decode()
    assert "every dot is one seed" in svg
    assert "<dc:date>" not in svg
    assert b"CreationDate" not in figure.image("pdf")
    assert b"every dot is one seed" in figure.image("png")


def test_a_users_own_settings_change_nothing_and_are_left_alone() -> None:
    before = shared("scores").image("svg")
    with matplotlib.rc_context({"font.size": 20.0, "axes.facecolor": "red", "text.parse_math": True}):
        own = dict(matplotlib.rcParams)
        assert drawn("scores", small()).image("svg") == before
        assert dict(matplotlib.rcParams) == own


def test_no_display_and_no_pyplot_are_needed() -> None:
    """In a process of its own, whose environment asks for windows that it cannot open."""
    program = """
import sys
from helpers_records import make_cell
from lfobench.tables.building import build_table
from lfobench.plots.kinds import draw
records = make_cell([10.0, 20.0])
assert draw("scores", build_table(records), records)._repr_png_().startswith(b"\\x89PNG")
assert "matplotlib.pyplot" not in sys.modules
"""
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment |= {"MPLBACKEND": "tkagg", "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True, timeout=PATIENCE)


def test_the_file_name_says_the_format() -> None:
    assert [format_of(Path(name)) for name in ("a.png", "b.c.SVG", "d.pdf")] == ["png", "svg", "pdf"]
    for name in ("figure", "figure.eps", "pdf"):
        with pytest.raises(UserError, match=r"\.png, \.svg or \.pdf"):
            format_of(Path(name))


def test_unknown_kinds_and_widths_are_refused_with_the_closest() -> None:
    table = build_table(small())
    with pytest.raises(UserError, match="Did you mean 'curves'"):
        draw("curve", table, small())
    with pytest.raises(UserError, match="Did you mean 'column'"):
        draw("scores", table, small(), width="colum")


def test_looks_are_distinct_even_in_grey_and_do_not_depend_on_who_is_shown() -> None:
    assert len({(each.colour, each.marker, each.line) for each in map(look, range(64))}) == 64
    assert len({each.marker for each in map(look, range(8))}) == len({each.line for each in map(look, range(8))}) == 8
    columns = [Column(name, name.split(":")[0], "", "observations") for name in ("b", "a:one", "a:two", "new")]
    order = ("a", "b", "c")
    everyone = looks(columns, order)
    assert len(set(everyone.values())) == 4
    assert looks(columns[:1], order)[columns[0]] == everyone[columns[0]] == look(1)
