"""Published numbers: the papers that ship with lfobench by name, and any other table as a CSV file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from lfobench.contract.publication import (
    Claim,
    Publication,
    ScoreScale,
    StatedContradiction,
    TableOfCounts,
    TableOfMeans,
)
from lfobench.errors import UserError, unknown_name
from lfobench.store.published_file import COUNTS, HEADERS, read_rows_of_counts, read_rows_of_means, values_in

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
