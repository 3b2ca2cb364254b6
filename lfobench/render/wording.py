"""How a footnote lists what differs: by value, with whom it concerns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from lfobench.contract.record import Record, canonical_json
from lfobench.render.table import Column

Columns = Mapping[Column, Sequence[Record]]


def either(values: Iterable[Any]) -> str:
    """Distinct values in ascending order where they are numbers: ``300,000 or 500,000``."""
    distinct = list({canonical_json(value): value for value in values}.values())
    if all(isinstance(value, int) and not isinstance(value, bool) for value in distinct):
        return " or ".join(f"{value:,}" for value in sorted(distinct))
    return " or ".join(str(value) for value in distinct)


def with_whom(said: Iterable[tuple[str, str]], between: str = ", ") -> str:
    """(what, whom) pairs: what is said once if all agree, else each with those it is said of: ``a (x, y), b (z)``."""
    concerned = _concerned(said)
    if len(concerned) == 1:
        return next(iter(concerned))
    return between.join(f"{what} ({', '.join(whom)})" for what, whom in concerned.items())


def mostly(said: Iterable[tuple[str, str]]) -> str:
    """The same, but for what is said of most: ``a, but b (x, y)``."""
    concerned = _concerned(said)
    most = max(concerned, key=lambda what: len(concerned[what]))
    others = [f"{what} ({', '.join(whom)})" for what, whom in concerned.items() if what != most]
    return f"{most}, but {', '.join(others)}" if others else most


def per_column(columns: Columns, describe: Callable[[Record], Iterable[str]]) -> str:
    """What `describe` says of each column's records, with the columns where they differ."""
    return with_whom(
        (said, column.label) for column, records in columns.items() for record in records for said in describe(record)
    )


def assignments(fields: Iterable[Mapping[str, Any]]) -> list[str]:
    """``tau = 0.06`` per field, with all its values."""
    values: dict[str, list[Any]] = {}
    for one in fields:
        for name, value in one.items():
            values.setdefault(name, []).append(value)
    return [f"{name} = {either(found)}" for name, found in values.items()]


def _concerned(said: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Those that each thing is said of, once each, in order."""
    concerned: dict[str, dict[str, None]] = {}
    for what, whom in said:
        concerned.setdefault(what, {})[whom] = None
    return {what: list(whom) for what, whom in concerned.items()}
