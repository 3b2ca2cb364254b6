"""Folders of synthetic records, sealed as a run seals them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lfobench.record import Failure, Record
from lfobench.records.folder import FAILURE_SUFFIX
from lfobench.records.sealed import SEAL
from lfobench.text import content_hash


def write_records(folder: Path, records: Iterable[Record]) -> Path:
    """The folder, with a file per record."""
    for record in records:
        content = record.model_dump(mode="json")
        path = folder / "records" / record.task / f"{record.method}-{record.identity_hash[:12]}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({**content, SEAL: content_hash(content)}), encoding="utf-8")
    return folder


def write_crash(folder: Path, record: Record) -> None:
    """The record's run, crashed."""
    failure = Failure(
        identity_hash=record.identity_hash, identity=record.identity, labels=record.labels, error="gone", traceback=[]
    )
    path = folder / "failures" / f"{record.identity_hash[:12]}{FAILURE_SUFFIX}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(failure.model_dump_json(), encoding="utf-8")


def with_provenance(record: Record, **fields: Any) -> Record:
    """The record with more provenance."""
    return record.model_copy(update={"provenance": {**record.provenance, **fields}})
