"""Golden files: the whole text of a format, kept beside the tests. ``GOLDEN=write make test`` writes them anew."""

from __future__ import annotations

import os
from pathlib import Path


def check_golden(text: str, path: Path) -> None:
    """The text is the file's; a difference is shown line by line."""
    if os.environ.get("GOLDEN") == "write":
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert text.splitlines() == path.read_text(encoding="utf-8").splitlines()
