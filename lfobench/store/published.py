"""Published numbers, as transcribed into CSV files under ``results/published``."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from lfobench.errors import UserError

_VALUES = ("method", "mean", "std", "highlighted")


@dataclass(frozen=True)
class PublishedCell:
    """One cell of a published table, in the unit that its ``provenance.toml`` states.

    Attributes:
        place: what the row is about: the leading columns of the file, e.g. ``{"env": "hopper", …}``.
        method: name of the method in lfobench's words.
        mean: the printed mean.
        std: the printed spread; None where the table prints none.
        highlighted: whether the authors highlighted it; None where they highlight nothing by rule.
    """

    place: dict[str, str]
    method: str
    mean: float
    std: float | None
    highlighted: bool | None


def read_published(path: Path) -> list[PublishedCell]:
    """The cells of one CSV of means, in file order.

    Raises:
        UserError: the file lacks a column or holds a value that is not a number.
    """
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        absent = [field for field in _VALUES if field not in (reader.fieldnames or ())]
        if absent:
            raise UserError(
                f"{path} is not a table of means: it has no column {', '.join(absent)}.",
                f"Its header must end in {','.join(_VALUES)}.",
            )
        return [_cell(path, reader.line_num, line) for line in reader]


def _cell(path: Path, number: int, line: dict[str, str]) -> PublishedCell:
    try:
        return PublishedCell(
            place={field: value for field, value in line.items() if field not in _VALUES},
            method=line["method"],
            mean=float(line["mean"]),
            std=float(line["std"]) if line["std"] else None,
            highlighted=bool(int(line["highlighted"])) if line["highlighted"] else None,
        )
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}, line {number}: {error}.", "Correct the value or leave it empty.") from error
