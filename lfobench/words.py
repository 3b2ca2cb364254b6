"""Words of messages: counts with their nouns, and text from outside made harmless."""

from __future__ import annotations

MOST_SHOWN = 40
"""Characters of a name from a file, or of what a host says."""


def counted(number: int, one: str, many: str = "") -> str:
    """``1 row``, ``2,000 rows``; `many` where an s does not make it."""
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


def harmless(text: str) -> str:
    """Text on one line, with what a terminal would obey escaped."""
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in " ".join(text.splitlines()))


def shown(text: str, most: int = MOST_SHOWN) -> str:
    """Text from outside on one line of at most so many characters; those that a terminal would obey are escaped."""
    escaped = " ".join(harmless(text[: 2 * most]).split())
    return escaped if len(escaped) <= most and len(text) <= 2 * most else f"{escaped[: most - 1]}…"
