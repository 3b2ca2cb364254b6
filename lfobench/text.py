"""Text: counts with their nouns, short numbers, text from outside made harmless, canonical JSON and its hash."""

from __future__ import annotations

import hashlib
import json
from typing import Any

MOST_SHOWN = 40
"""Characters of a name from a file, or of what a host says."""


def counted(number: int, one: str, many: str = "") -> str:
    """``1 row``, ``2,000 rows``; `many` where an s does not make it."""
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


def short_number(value: float, form: str = "z.1f") -> str:
    """A number in `form`; from a million on in two digits and a power of ten: ``97.9``, ``1.2e12``.

    "z" prints -0.04 as 0.0 rather than -0.0.
    """
    if abs(value) < _LONGEST_NUMBER:
        return format(value, form)
    digits, _, power = format(value, f"{'+' if form.startswith('+') else ''}.1e").partition("e")
    return f"{digits}e{int(power)}"


_LONGEST_NUMBER = 1e6


def harmless(text: str) -> str:
    """Text on one line, with what a terminal would obey escaped: control codes, marks of the writing direction."""
    return _escaped(" ".join(text.splitlines()))


def harmless_lines(text: str) -> str:
    """The same of text that keeps its line feeds and tabs."""
    return _escaped(text, "\n\t")


def _escaped(text: str, kept: str = "") -> str:
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() or each in kept else ascii(each)[1:-1] for each in text)


def shown(text: str, most: int = MOST_SHOWN) -> str:
    """Text from outside on one line of at most so many characters; those that a terminal would obey are escaped."""
    escaped = " ".join(harmless(text[: 2 * most]).split())
    return escaped if len(escaped) <= most and len(text) <= 2 * most else f"{escaped[: most - 1]}…"


def canonical_json(value: Any) -> str:
    """The one spelling of a JSON value that hashes are taken of."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def content_hash(value: Any) -> str:
    """SHA-256 (hex) of the canonical JSON of `value`."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()
