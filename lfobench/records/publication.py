"""Published tables: printed numbers, and a paper's statements about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar


@dataclass(frozen=True)
class PrintedMean:
    """One cell of a table of means, in the table's unit.

    Attributes:
        mean: the printed mean.
        std: the printed spread; None where the table prints none.
        mean_digit: place value of the last digit of the mean, e.g. 0.01 for 97.87.
        std_digit: the same of the spread; None where there is none.
        n: number of samples, where the table gives one per cell.
        highlighted: whether the authors highlighted it; None where they highlight nothing by rule.
    """

    mean: float
    std: float | None
    mean_digit: float
    std_digit: float | None
    n: int | None
    highlighted: bool | None

    @property
    def spreads(self) -> tuple[float, float] | None:
        """The smallest and the largest spread that are rounded to the printed one; None where none is printed."""
        if self.std is None or self.std_digit is None:
            return None
        return max(0.0, self.std - self.std_digit / 2.0), self.std + self.std_digit / 2.0

    @property
    def spread(self) -> float | None:
        """Spread for tests: the printed one; for a printed 0 the largest spread that is printed so."""
        return self.std if self.std != 0.0 or self.spreads is None else self.spreads[1]


@dataclass(frozen=True)
class PrintedCount:
    """One cell of a table of successes.

    Attributes:
        successes: number of successful trials.
        trials: number of all, at least 1.
        highlighted: as in `PrintedMean`.
    """

    successes: int
    trials: int
    highlighted: bool | None


PrintedCell = TypeVar("PrintedCell", PrintedMean, PrintedCount)


@dataclass(frozen=True)
class PublishedRow(Generic[PrintedCell]):
    """One row.

    Attributes:
        place: by the file's columns, e.g. ``{"env": "hopper", "dataset": "random-expert"}``.
        cells: by method, in file order.
    """

    place: Mapping[str, str]
    cells: Mapping[str, PrintedCell]

    @property
    def name(self) -> str:
        """The place joined by dashes; for the seed paper's Table 1 the task's name: ``hopper-random-expert``."""
        return "-".join(self.place.values())


@dataclass(frozen=True)
class Claim:
    """A number of samples that a paper states, and the place of the statement."""

    n: int
    where: str


@dataclass(frozen=True)
class ScoreScale:
    """Known properties of the scores of some rows, by which printed numbers can be checked.

    Attributes:
        rows: the places that it holds for, by column; empty for all.
        low: the smallest possible score.
        high: the largest.
        step: distance of the scores that a single episode can have; None where unknown or continuous.
        episodes: episodes whose mean is the score of one sample; None where unknown.
    """

    rows: Mapping[str, str]
    low: float
    high: float
    step: float | None = None
    episodes: int | None = None

    def holds_for(self, place: Mapping[str, str]) -> bool:
        """True if it holds for the row at `place`."""
        return all(place.get(column) == value for column, value in self.rows.items())


@dataclass(frozen=True)
class PublishedTable(Generic[PrintedCell]):
    """One table.

    Attributes:
        title: e.g. ``Table 1``.
        rows: in file order.
        compared: the methods among which the highlights are picked; empty where the paper does not say.
    """

    title: str
    rows: tuple[PublishedRow[PrintedCell], ...]
    compared: tuple[str, ...] = ()

    @property
    def methods(self) -> tuple[str, ...]:
        """Every method of any row, in file order."""
        return tuple(dict.fromkeys(method for row in self.rows for method in row.cells))


@dataclass(frozen=True)
class TableOfMeans(PublishedTable[PrintedMean]):
    """Means and spreads.

    Attributes:
        claims: the number of samples behind every cell, as the paper states it; several where it contradicts itself.
        scales: known properties of the scores.
        source: name of the data's source here; empty where it is none of these.
        protocol: name of the runs' protocol here; empty where it is none of these.
        environments: versions of the environments and their simulator.
    """

    claims: tuple[Claim, ...] = ()
    scales: tuple[ScoreScale, ...] = ()
    source: str = ""
    protocol: str = ""
    environments: str = ""


@dataclass(frozen=True)
class TableOfCounts(PublishedTable[PrintedCount]):
    """Successes out of trials."""


@dataclass(frozen=True)
class StatedContradiction:
    """Two contradicting statements of a paper, as transcribed.

    Attributes:
        about: the subject.
        first: one statement, and its place.
        second: the other.
    """

    about: str
    first: str
    second: str


@dataclass(frozen=True)
class Publication:
    """The tables of one paper, or one file of numbers.

    Attributes:
        name: e.g. ``dilo-2024``; the file's name for a file.
        paper: title, venue and version; empty for a file.
        tables: in the order of the paper.
        contradictions: of its text.
    """

    name: str
    paper: str
    tables: tuple[TableOfMeans | TableOfCounts, ...]
    contradictions: tuple[StatedContradiction, ...] = ()
