"""Sealed JSON files: content and a hash over it, so that a later edit shows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lfobench.files import read_within, write_text
from lfobench.record import MOST_BYTES
from lfobench.text import content_hash

SEAL = "seal"
"""Key of the hash over everything else in a file."""


@dataclass(frozen=True)
class Sealed:
    """Content of a file.

    Attributes:
        content: its JSON data, without the seal.
        seal: the hash that it states; None where there is none.
    """

    content: Any
    seal: Any

    @property
    def intact(self) -> bool:
        """True if the content is what was sealed.

        Raises:
            ValueError: the content has numbers that are not finite.
        """
        return bool(self.seal == content_hash(self.content))


def write_sealed(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON data with its seal, atomically.

    Raises:
        UserError: the disk refuses.
    """
    write_text(path, json.dumps({**content, SEAL: content_hash(content)}, indent=1, allow_nan=False) + "\n")


def read_sealed(path: Path) -> Sealed:
    """The JSON data of a file and its seal, not compared yet.

    Raises:
        OSError: it cannot be read.
        ValueError: it is too large, or no JSON.
        RecursionError: it is nested too deep.
    """
    content = json.loads(read_within(path, MOST_BYTES))
    return Sealed(content, content.pop(SEAL, None) if isinstance(content, dict) else None)
