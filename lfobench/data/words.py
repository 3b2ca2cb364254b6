"""Words of messages: counts with their nouns, and text from outside made harmless."""

from __future__ import annotations

MOST_SHOWN = 40
"""Characters of a name from a file, or of what a host says."""


def counted(number: int, one: str, many: str) -> str:
    """``1 row has``, ``2,000 rows have``."""
    return f"{number:,} {one if number == 1 else many}"


def shown(text: str, most: int = MOST_SHOWN) -> str:
    """Text from outside on one line of at most so many characters; those that a terminal would obey are escaped."""
    escaped = "".join(each if each.isprintable() else repr(each)[1:-1] for each in " ".join(text[: 2 * most].split()))
    return escaped if len(escaped) <= most and len(text) <= 2 * most else f"{escaped[: most - 1]}…"
