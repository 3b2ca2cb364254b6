"""Published numbers: the papers that ship with lfobench by name, and any other table as a CSV file."""

from __future__ import annotations

import csv
import io
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from lfobench.errors import UserError, unknown_name
from lfobench.files import read_within
from lfobench.record import LARGEST_SCORE, usable
from lfobench.records.publication import (
    Claim,
    PrintedCount,
    PrintedMean,
    Publication,
    PublishedRow,
    ScoreScale,
    StatedContradiction,
    TableOfCounts,
    TableOfMeans,
)
from lfobench.text import short_number, shown

MEANS = ("mean", "std")
COUNTS = ("successes", "trials")
HEADERS = "the columns method, mean, std or method, successes, trials"
_OPTIONAL = {MEANS: ("n", "highlighted"), COUNTS: ("highlighted",)}
_NAMELESS = re.compile(r"|Unnamed: [0-9]+")
"""Headings of a column without one, as pandas writes and as it reads them."""

_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.([0-9]*))?|\.([0-9]+))(?:[eE]([+-]?[0-9]+))?")

_Cell = TypeVar("_Cell", PrintedMean, PrintedCount)


class _Line(NamedTuple):
    """Fields of one line by column, and its place in the file."""

    where: str
    fields: Mapping[str, str]

    def required(self, column: str) -> str:
        if not self.fields[column]:
            raise UserError(f"{self.where}: {column} is empty.", "Fill it in or remove the line.")
        return self.fields[column]

    def number(self, column: str) -> tuple[float, float]:
        """The value and the place value of its last digit."""
        written = self.required(column)
        text = written.replace("\N{MINUS SIGN}", "-").replace(",", ".")
        if re.search(r"±|\+/?-|\\pm", written):
            raise UserError(
                f"{self.where}: {column} is '{written}', a mean and its spread in one field.",
                "Write them into two columns, mean and std.",
            )
        match = _NUMBER.fullmatch(text)
        # As text first: float() also takes nan, inf and 1_000.
        exponent = (int(match[3] or 0) - len(match[1] or match[2] or "")) if match and len(text) < 100 else 0
        value, digit = (float(text), float(f"1e{exponent}")) if match else (math.nan, math.nan)
        if not (math.isfinite(value) and math.isfinite(digit)):
            raise UserError(
                f"{self.where}: {column} is '{shown(written)}', which is not a finite number.",
                "Write it like 97.87 or -3.3, without units, blanks or signs of significance.",
            )
        if not usable(value):
            raise UserError(
                f"{self.where}: {column} is '{shown(written)}', beyond ±{short_number(LARGEST_SCORE)}.",
                "Leave out diverged values, or write the table in another unit.",
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
    """Header of a file: `MEANS` or `COUNTS`.

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
    (number_of_header, header), *records = _records(path)
    if _header(path, number_of_header, header) != values:
        raise UserError(
            f"{path}, line {number_of_header}: there are no columns {', '.join(values)}.", f"It needs {HEADERS}."
        )
    reserved = {"method", *values, *_OPTIONAL[values]}
    if values == MEANS:
        _check_commas(path, header, records)
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
    _check_index(path, number_of_header, columns, rows)
    return tuple(PublishedRow(dict(zip(columns, place, strict=True)), cells) for place, cells in rows.items())


def _check_commas(path: Path, header: Sequence[str], records: Sequence[tuple[int, list[str]]]) -> None:
    """Refusal of commas that may group digits by thousands, and of points in a file of decimal commas."""
    places = [header.index(column) for column in MEANS]
    numbers = [(number, fields[place]) for number, fields in records for place in places if len(fields) == len(header)]
    commas = [(number, text) for number, text in numbers if "," in text]
    if not commas:
        return
    # A comma before three digits groups thousands in one country and begins the decimals in another.
    grouped = all(re.fullmatch(r"[0-9]{3}", text.rpartition(",")[2]) for _, text in commas)
    for number, text in commas if grouped else numbers:
        if grouped or "." in text:
            reason = (
                "may be grouped by thousands or have decimals" if grouped else "has a point where others have a comma"
            )
            raise UserError(
                f"{path}, line {number}: '{shown(text)}' {reason}.", "Write numbers with a point and no other sign."
            )


def _check_index(
    path: Path, number: int, columns: Sequence[str], rows: Mapping[tuple[str, ...], Mapping[str, object]]
) -> None:
    """Refusal of a column that numbers the lines: with it no two methods share a row, without it they do."""
    if len(columns) < 2 or any(len(cells) > 1 for cells in rows.values()):
        return
    methods = {place: method for place, cells in rows.items() for method in cells}
    for index, column in enumerate(columns):
        without: dict[tuple[str, ...], list[str]] = {}
        for place, method in methods.items():
            without.setdefault((*place[:index], *place[index + 1 :]), []).append(method)
        numbered = len({place[index] for place in rows}) == len(rows)
        if numbered and len(without) < len(rows) and all(len(set(each)) == len(each) for each in without.values()):
            raise UserError(
                f"{path}, line {number}: column '{column}' has another value in every line, so no two methods share a "
                "row.",
                "Remove it; pandas leaves its index out with to_csv(index=False).",
            )


def _records(path: Path) -> list[tuple[int, list[str]]]:
    """Every line that is not blank with its number: the header and at least one more."""
    try:
        # Spreadsheets begin a UTF-8 file with a byte order mark.
        text = _content(path).decode("utf-8-sig")
        reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=_separator(text))
        records = [
            (reader.line_num, [" ".join(re.split(_BLANKS, field.strip())) for field in fields])
            for fields in reader
            if any(fields)
        ]
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
_LARGEST = 16_000_000
"""Bytes of a table; the seed paper's largest has 10,000."""

_BLANKS = "[\N{NO-BREAK SPACE}\N{THIN SPACE}\N{NARROW NO-BREAK SPACE}]"


def _separator(text: str) -> str:
    """Comma, tab or semicolon: the first that gives a column of methods; a comma where none does."""
    first = next((line for line in text.splitlines() if line.strip()), "")
    for separator in ",\t;":
        with suppress(csv.Error):
            if "method" in (field.strip() for field in next(csv.reader([first], delimiter=separator))):
                return separator
    return ","


def _content(path: Path) -> bytes:
    try:
        return read_within(path, _LARGEST)
    except ValueError as error:
        raise UserError(f"{path} cannot be read: {error}.", "Give a CSV file of one table.") from error


def _header(path: Path, number: int, header: list[str]) -> tuple[str, str]:
    where = f"{path}, line {number}"
    twice = next((column for column in header if header.count(column) > 1), None)
    if twice is not None:
        named = f"two columns '{twice}'" if twice else "columns without a name"
        raise UserError(f"{where}: there are {named}.", "Give every column a name of its own.")
    if (nameless := next((column for column in header if _NAMELESS.fullmatch(column)), None)) is not None:
        subject = f"'{nameless}' is" if nameless else "there is"
        raise UserError(
            f"{where}: {subject} a column without a name, number {header.index(nameless) + 1} of {len(header)}.",
            "Name it or remove it; pandas leaves its index out with to_csv(index=False).",
        )
    found = [values for values in (MEANS, COUNTS) if {"method", *values} <= set(header)]
    if len(found) != 1:
        kinds = "is both a table of means and one of successes" if found else f"has the columns {', '.join(header)}"
        raise UserError(f"{where}: the file {kinds}.", f"It needs {HEADERS}; all other columns name the row.")
    return found[0]


_PROVENANCE = "provenance.toml"


def read_publication(name_or_path: str) -> Publication:
    """A shipped publication by its name, or the table in a CSV file by its path.

    Raises:
        UserError: no publication has this name and no file this path, or the file is not such a table.
    """
    shipped = publication_names()
    if name_or_path in shipped:
        return _shipped(_folder() / name_or_path)
    path = Path(name_or_path)
    try:
        present, folder = path.exists(), path.is_dir()
    except OSError as error:
        raise UserError(f"Cannot read {path}: {error.strerror}.", f"Give {_WHAT}.") from error
    if folder:
        raise UserError(f"{path} is a folder.", f"Give {_WHAT}.")
    if present:
        return _file(path)
    if path.suffix or len(path.parts) != 1:
        raise UserError(f"There is no file {path}.", f"Give {_WHAT}. Shipped: {', '.join(shipped)}.")
    unknown = unknown_name("publication", name_or_path, shipped)
    raise UserError(unknown.problem, f"{unknown.remedy} Or give the path of a CSV file with {HEADERS}.")


_WHAT = f"the name of a shipped publication or the path of a CSV file with {HEADERS}"


def publication_names() -> list[str]:
    """The publications that ship with lfobench."""
    return sorted(path.parent.name for path in _folder().glob(f"*/{_PROVENANCE}"))


def _folder() -> Path:
    """``lfobench/published`` in an installed package, ``results/published`` in a source checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "published"
    return installed if installed.is_dir() else package.parent / "results" / "published"


def _file(path: Path) -> Publication:
    if values_in(path) == COUNTS:
        return Publication(path.stem, "", (TableOfCounts(path.name, read_rows_of_counts(path)),))
    return Publication(path.stem, "", (TableOfMeans(path.name, read_rows_of_means(path)),))


def _shipped(folder: Path) -> Publication:
    provenance = tomllib.loads((folder / _PROVENANCE).read_text(encoding="utf-8"))
    entries = [entry for entry in provenance.values() if isinstance(entry, dict)]
    return Publication(
        folder.name,
        f"{provenance['paper']}, {provenance['venue']}, {provenance['version']}",
        tuple(_table(folder, entry) for entry in entries),
        tuple(StatedContradiction(**stated) for stated in provenance.get("contradictions", ())),
    )


def _table(folder: Path, entry: dict[str, Any]) -> TableOfMeans | TableOfCounts:
    path, compared = folder / entry["file"], tuple(entry["compared"])
    if entry["kind"] == "counts":
        return TableOfCounts(entry["title"], read_rows_of_counts(path), compared)
    return TableOfMeans(
        entry["title"],
        read_rows_of_means(path),
        compared,
        tuple(Claim(**claim) for claim in entry["n"]),
        tuple(ScoreScale(**{"rows": {}, **scale}) for scale in entry.get("scales", ())),
        entry.get("source", ""),
        entry.get("protocol", ""),
        entry.get("environments", ""),
    )
