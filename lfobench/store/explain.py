"""Why a run is reused or runs again: its identity against the nearest record, field by field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lfobench.contract.record import Record, canonical_json
from lfobench.plan.cells import Run


@dataclass(frozen=True)
class Explanation:
    """The answer for one run.

    Attributes:
        run: its label.
        identity: hash of the identity that was looked for.
        reused: whether a record with that identity is there.
        headline: the decision in words.
        differences: fields in which the nearest record differs, ``field: record's -> wanted``; of a reused record
            only its data, where the cache now holds other data under the same description.
        aside: earlier records of the run, which ``--rerun`` trained anew.
    """

    run: str
    identity: str
    reused: bool
    headline: str
    differences: tuple[str, ...]
    aside: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """For scripts."""
        return {
            "run": self.run,
            "identity": self.identity,
            "reused": self.reused,
            "differences": list(self.differences),
            "aside": list(self.aside),
        }


def explain(run: Run, records: Sequence[Record], data: Mapping[str, str], aside: Sequence[Path] = ()) -> Explanation:
    """Compare a run with the records of its method and task.

    Args:
        run: what is asked for.
        records: what there is.
        data: fingerprints of the run's data as the cache holds it, by part; without the parts that it lacks.
        aside: earlier records of the run.
    """
    found = _compared(run, records, data)
    if not aside:
        return found
    places = tuple(map(str, aside))
    return replace(found, headline=f"{found.headline} (trained before, set aside: {', '.join(places)})", aside=places)


def _compared(run: Run, records: Sequence[Record], data: Mapping[str, str]) -> Explanation:
    short = run.identity_hash[:12]
    same = next((record for record in records if record.identity_hash == run.identity_hash), None)
    if same is not None:
        made_from = same.provenance.get("data_fingerprints", {})
        both = made_from.keys() & data.keys()
        found = tuple(
            differences(
                {part: made_from[part] for part in both}, {part: data[part] for part in both}, "data_fingerprints."
            )
        )
        headline = f"{run.label}: reused, identity {short}"
        if found:
            headline += "; made from other data than this machine's cache holds"
        return Explanation(run.label, run.identity_hash, True, headline, found)
    kin = [record for record in records if record.method == run.cell.method.name and record.task == run.cell.task.name]
    if not kin:
        headline = f"{run.label}: will run, no record of this method on this task"
        return Explanation(run.label, run.identity_hash, False, headline, ())
    nearest = min(kin, key=lambda record: (len(list(differences(record.identity, run.identity))), record.seed))
    found = tuple(differences(nearest.identity, run.identity))
    headline = f"{run.label}: will run, identity {short}; the nearest record {nearest.identity_hash[:12]} differs in"
    return Explanation(run.label, run.identity_hash, False, headline, found)


def differences(record: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """``field: record's -> wanted`` for every leaf in which two identities differ."""
    for field in sorted({*record, *wanted}):
        one, two = record.get(field), wanted.get(field)
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            yield from differences(one, two, f"{prefix}{field}.")
        elif (field in record) != (field in wanted) or canonical_json(one) != canonical_json(two):
            yield f"{prefix}{field}: {_text(field, record)} -> {_text(field, wanted)}"


def _text(field: str, identity: Mapping[str, Any]) -> str:
    return canonical_json(identity[field]) if field in identity else "absent"
