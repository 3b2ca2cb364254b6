"""One published table as a CSV file: one cell a line, every mistake with its line.

Two headers are known, in any order of columns: ``method, mean, std`` with `n` and `highlighted` where known, and
``method, successes, trials`` with `highlighted` where known. All other columns together name the row.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

from lfobench.contract.publication import PrintedCount, PrintedMean, PublishedRow
from lfobench.errors import UserError

MEANS = ("mean", "std")
COUNTS = ("successes", "trials")
HEADERS = "the columns method, mean, std or method, successes, trials"
_OPTIONAL = {MEANS: ("n", "highlighted"), COUNTS: ("highlighted",)}
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.([0-9]*))?|\.([0-9]+))(?:[eE]([+-]?[0-9]+))?")

_Cell = TypeVar("_Cell", PrintedMean, PrintedCount)


class _Line(NamedTuple):
    """The fields of one line by column, and where it stands."""

    where: str
    fields: Mapping[str, str]

    def required(self, column: str) -> str:
        if not self.fields[column]:
            raise UserError(f"{self.where}: {column} is empty.", "Fill it in or remove the line.")
        return self.fields[column]

    def number(self, column: str) -> tuple[float, float]:
        """The value and the place value of its last digit."""
        text = self.required(column)
        match = _NUMBER.fullmatch(text)
        # As text first: float() also takes nan, inf and 1_000.
        exponent = (int(match[3] or 0) - len(match[1] or match[2] or "")) if match and len(text) < 100 else 0
        value, digit = (float(text), float(f"1e{exponent}")) if match else (math.nan, math.nan)
        if not (math.isfinite(value) and math.isfinite(digit)):
            raise UserError(
                f"{self.where}: {column} is '{text}', which is not a finite number.",
                "Write it like 97.87 or -3.3, without units or signs of significance.",
            )
        return value, digit

    def whole(self, column: str, least: int) -> int:
        text = self.required(column)
        if not re.fullmatch(r"[0-9]{1,9}", text) or int(text) < least:
            raise UserError(
                f"{self.where}: {column} is '{text}', which is not a whole number of at least {least}.",
                "Write it like 10.",
            )
        return int(text)

    def highlighted(self) -> bool | None:
        text = self.fields.get("highlighted", "")
        if text not in ("", "0", "1"):
            raise UserError(
                f"{self.where}: highlighted is '{text}'.", "Write 1 or 0, or leave it empty where no rule applies."
            )
        return text == "1" if text else None


def values_in(path: Path) -> tuple[str, str]:
    """Which of the two headers a file has: `MEANS` or `COUNTS`.

    Raises:
        UserError: neither, both, or the file cannot be read.
    """
    return _header(path, *_records(path)[0])


def read_rows_of_means(path: Path) -> tuple[PublishedRow[PrintedMean], ...]:
    """The rows of a table of means, in file order.

    Raises:
        UserError: naming the file, the line and the remedy.
    """
    return _rows(path, MEANS, _mean)


def read_rows_of_counts(path: Path) -> tuple[PublishedRow[PrintedCount], ...]:
    """The rows of a table of successes, in file order.

    Raises:
        UserError: naming the file, the line and the remedy.
    """
    return _rows(path, COUNTS, _count)


def _mean(line: _Line) -> PrintedMean:
    mean, mean_digit = line.number("mean")
    std, std_digit = line.number("std") if line.fields["std"] else (None, None)
    if std is not None and std < 0.0:
        raise UserError(f"{line.where}: std is {std:g}, and a spread is not negative.", "Correct it.")
    n = line.whole("n", 1) if "n" in line.fields else None
    return PrintedMean(mean, std, mean_digit, std_digit, n, line.highlighted())


def _count(line: _Line) -> PrintedCount:
    successes, trials = line.whole("successes", 0), line.whole("trials", 1)
    if successes > trials:
        raise UserError(f"{line.where}: {successes} successes are more than {trials} trials.", "Correct one of them.")
    return PrintedCount(successes, trials, line.highlighted())


def _rows(path: Path, values: tuple[str, str], read: Callable[[_Line], _Cell]) -> tuple[PublishedRow[_Cell], ...]:
    (number, header), *records = _records(path)
    if _header(path, number, header) != values:
        raise UserError(f"{path}, line {number}: there are no columns {', '.join(values)}.", f"It needs {HEADERS}.")
    reserved = {"method", *values, *_OPTIONAL[values]}
    rows: dict[tuple[str, ...], dict[str, _Cell]] = {}
    for number, fields in records:
        where = f"{path}, line {number}"
        if len(fields) != len(header):
            raise UserError(f"{where}: {len(fields)} fields under {len(header)} columns.", "Correct the line.")
        line = _Line(where, dict(zip(header, fields, strict=True)))
        place = tuple(line.required(column) for column in header if column not in reserved)
        cells, method = rows.setdefault(place, {}), line.required("method")
        if method in cells:
            raise UserError(f"{where}: a second number of {method} for {'-'.join(place)}.", "Remove one of the two.")
        cells[method] = read(line)
    columns = [column for column in header if column not in reserved]
    return tuple(PublishedRow(dict(zip(columns, place, strict=True)), cells) for place, cells in rows.items())


def _records(path: Path) -> list[tuple[int, list[str]]]:
    """Every line that is not blank with its number: the header and at least one more."""
    try:
        # Spreadsheets begin a UTF-8 file with a byte order mark.
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            records = [(reader.line_num, [field.strip() for field in fields]) for fields in reader if any(fields)]
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not a UTF-8 text: {error.reason} at byte {error.start}.", _SAVE) from error
    except csv.Error as error:
        raise UserError(f"{path}, line {reader.line_num}: not CSV: {error}.", _SAVE) from error
    except OSError as error:
        raise UserError(f"Cannot read {path}: {error.strerror}.", "Give a file that you may read.") from error
    for number, fields in records:
        # An escape sequence in a name would act on the terminal that shows it.
        if unprintable := next((field for field in fields if not field.isprintable()), None):
            raise UserError(
                f"{path}, line {number}: {unprintable!r} has a character that cannot be printed.", "Remove it."
            )
    if not records:
        raise UserError(f"{path} is empty.", f"It needs {HEADERS}.")
    if len(records) == 1:
        raise UserError(f"{path} has a header and no line below it.", "Add one line per cell.")
    return records


_SAVE = "Save it as CSV in UTF-8."


def _header(path: Path, number: int, header: list[str]) -> tuple[str, str]:
    where = f"{path}, line {number}"
    twice = next((column for column in header if header.count(column) > 1), None)
    if twice is not None:
        named = f"two columns '{twice}'" if twice else "columns without a name"
        raise UserError(f"{where}: there are {named}.", "Give every column a name of its own.")
    found = [values for values in (MEANS, COUNTS) if {"method", *values} <= set(header)]
    if len(found) != 1:
        kinds = "is both a table of means and one of successes" if found else f"has the columns {', '.join(header)}"
        raise UserError(f"{where}: the file {kinds}.", f"It needs {HEADERS}; all other columns name the row.")
    return found[0]
