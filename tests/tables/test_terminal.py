from __future__ import annotations

import io
import re
from collections.abc import Callable

import pytest
from rich.cells import cell_len
from rich.console import Console

from lfobench.record import Record
from lfobench.tables.building import build_table
from lfobench.tables.exporters.terminal import terminal
from lfobench.tables.table import Table

METHODS = ("bc-expert", "bc", "oril")

EXAMPLE = """\
                   Access to expert actions              No expert actions
                   ────────────────────────  ──────────────────────────────────────────
                     bc-expert           bc         oril          smodice          dilo
───────────────────────────────────────────────────────────────────────────────────────
random+expert
  hopper             4.4 ± 0.6  45.3 ±  4.5  55.0 ± 22.9  66.6 ± 57.7* ✗1  100.9 ± 2.7*
  halfcheetah        4.4 ± 0.6  45.3 ±  4.5  55.0 ± 22.9  99.9 ±  0.8*     100.9 ± 2.7*
random+few-expert
  hopper             3.6 ± 0.9  37.8 ± 14.0  45.0 ± 26.0  83.2 ± 28.8*     100.9 ± 2.7*
  halfcheetah        3.6 ± 0.9  37.8 ± 14.0     –         83.2 ± 28.8*     100.9 ± 2.7*
───────────────────────────────────────────────────────────────────────────────────────
"""

MARKED = """\
               Access to expert actions             No expert actions                Expert
               ────────────────────────  ───────────────────────────────────────  ─────────────
                                     bc               oril                  dilo  demonstration
───────────────────────────────────────────────────────────────────────────────────────────────
random+expert
  hopper                     45.3 ± 4.5     89.3 ± 5.0      100.0 ±  4.0†*                103.3
  halfcheetah                   –           99.3 ± 4.5*     100.0 ±  4.0 *                103.3
  walker2d                      –        crashed        !2    9.0                         103.3
  ant                           –            6.2 ± 1.3*      66.7 ± 57.7 * ✗1 !2              –
───────────────────────────────────────────────────────────────────────────────────────────────
"""


def draw(table: Table, width: int = 100, color: bool = False, wide: bool = False) -> str:
    console = Console(
        file=io.StringIO(), width=width, force_terminal=color, color_system="truecolor" if color else None
    )
    console.print(terminal(table, wide))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_plain_output(example: list[Record]) -> None:
    body, _, footnote = draw(build_table(example, methods=METHODS)).partition("\n\n")
    assert f"{body}\n" == EXAMPLE
    assert footnote.startswith("Score")
    assert "Highlighted*" in footnote


def test_every_mark_keeps_its_place(marked: Table) -> None:
    body, _, footnote = draw(marked).partition("\n\n")
    assert f"{body}\n" == MARKED
    for label in ("†", "Demonstration", "Failed", "Diverged", "Missing"):
        assert any(line.startswith(label) for line in footnote.splitlines())


@pytest.mark.parametrize("color", [False, True])
def test_decimal_points_stand_below_each_other_whatever_the_marks(marked: Table, color: bool) -> None:
    body = re.sub(r"\x1b\[[0-9;]*m", "", draw(marked, color=color)).partition("\n\n")[0]
    rows = [line for line in body.splitlines()[5:] if line.startswith("  ")]
    means = [re.search(r" (100\.0|66\.7|9\.0)", row) for row in rows]
    assert len({found.end() for found in means if found}) == 1
    assert len([found for found in means if found]) == len(rows) == 4
    assert len({row.rindex("±") for row in rows if row.count("±") > 1}) == 1


@pytest.mark.parametrize("width", [48, 60, 80, 92, 120])
def test_marks_never_widen_a_line_beyond_the_terminal(marked: Table, width: int) -> None:
    drawn = draw(marked, width, wide=True)
    assert max(map(cell_len, drawn.splitlines())) <= width
    for whole in ("100.0 ±  4.0†*", "66.7 ± 57.7 * ✗1 !2", "89.3 ± 5.0", "103.3"):
        assert whole in drawn


def test_highlighted_numbers_are_bold(make_cell: Callable[..., list[Record]]) -> None:
    drawn = draw(build_table(make_cell([90.0, 91.0], "dilo") + make_cell([5.0, 6.0], "oril")), color=True)
    assert re.search(r"\x1b\[1;32m90\.5 ± 0\.7\x1b\[0m", drawn)
    assert not re.search(r"\x1b\[1;32m5\.5", drawn)
    assert "*" not in drawn


@pytest.mark.parametrize("width", [50, 60, 80, 100, 200])
def test_no_line_is_wider_than_the_terminal_and_no_number_is_cut(example: list[Record], width: int) -> None:
    drawn = draw(build_table(example, methods=METHODS), width, wide=True)
    assert max(map(len, drawn.splitlines())) <= width
    for number in ("4.4 ± 0.6", "45.3 ±  4.5", "55.0 ± 22.9", "66.6 ± 57.7* ✗1", "100.9 ± 2.7*"):
        assert number in drawn


@pytest.mark.parametrize("width", [76, 80])
def test_five_methods_fit_in_compact_cells_that_keep_every_number_and_mark(example: list[Record], width: int) -> None:
    body, _, footnote = draw(build_table(example, methods=METHODS), width).partition("\n\n")
    assert max(map(len, body.splitlines())) <= width
    assert footnote.startswith("Cells") and "--wide" in footnote
    for number in ("4.4±0.6", "45.3± 4.5", "55.0±22.9", "66.6±57.7* ✗1", "100.9±2.7*"):
        assert number in body
    assert "Cells" not in draw(build_table(example, methods=METHODS), 200)


def test_parts_of_a_wide_table_repeat_the_row_labels(example: list[Record]) -> None:
    *parts, _ = draw(build_table(example), 60, wide=True).split("\n\n")
    assert len(parts) > 1
    for part in parts:
        labels = [line.split()[0] for line in part.splitlines() if line.startswith("  ") and "±" in line]
        assert labels == ["hopper", "halfcheetah"] * 2


def test_a_single_seed_has_no_spread(make_record: Callable[..., Record]) -> None:
    drawn = draw(build_table([make_record(-8.9, "dilo"), make_record(-0.04, "oril")]))
    row = next(line for line in drawn.splitlines() if line.startswith("  hopper"))
    assert row.split() == ["hopper", "-8.9*", "0.0*"]


def test_markup_in_names_is_text(make_record: Callable[..., Record]) -> None:
    assert "[bold]dilo[/bold]" in draw(build_table([make_record(1.0, "[bold]dilo[/bold]")]))


def test_a_dagger_is_not_green_and_marks_are_red(marked: Table) -> None:
    drawn = draw(marked, color=True)
    assert re.search(r"\x1b\[1;32m100\.0 ±  4\.0\x1b\[0m†", drawn)
    assert re.search(r"\x1b\[31m ✗1 !2\x1b\[0m", drawn)
    assert re.search(r"\x1b\[2m103\.3\x1b\[0m", drawn), "what was not run here is dim"
