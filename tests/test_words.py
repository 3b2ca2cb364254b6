from __future__ import annotations

import pytest

from lfobench.text import counted, harmless, harmless_lines, short_number, shown


def test_one_is_singular() -> None:
    assert (counted(1, "row has", "rows have"), counted(2_000, "row has", "rows have")) == (
        "1 row has",
        "2,000 rows have",
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Not Found", "Not Found"),
        ("a\nb", "a b"),
        ("\x1b[2J\x07", "\\x1b[2J\\x07"),
        ("\u202ename\udc80", "\\u202ename\\udc80"),
        ("it's", "it's"),
        ("x" * 40, "x" * 40),
        ("x" * 41, "x" * 39 + "…"),
        ("\x1b" * 3_000, "\\x1b" * 9 + "\\x1…"),
    ],
)
def test_text_from_outside_is_escaped_and_short(text: str, expected: str) -> None:
    assert shown(text) == expected


def test_a_path_stays_what_it_is_but_for_what_a_terminal_obeys() -> None:
    assert harmless("/we  ird/\x1b[2J.hdf5\nnext") == "/we  ird/\\x1b[2J.hdf5 next"


def test_lines_and_tabs_of_longer_text_stay() -> None:
    assert harmless_lines("a\n\tb\r\x1b\u2028c") == "a\n\tb\\r\\x1b\\u2028c"


@pytest.mark.parametrize(
    ("value", "form", "expected"),
    [
        (97.94, "z.1f", "97.9"),
        (-0.04, "z.1f", "0.0"),
        (999_999.94, "z.1f", "999999.9"),
        (1.25e12, "z.1f", "1.2e12"),
        (-1.7e308, "z.1f", "-1.7e308"),
        (3e6, "+z.1f", "+3.0e6"),
        (12_135.0, ",.1f", "12,135.0"),
    ],
)
def test_numbers_stay_short(value: float, form: str, expected: str) -> None:
    assert short_number(value, form) == expected
