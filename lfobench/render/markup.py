"""HTML and SVG elements from Python values: everything that is not already markup is escaped on its way in."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape
from typing import TypeAlias

_VOID = frozenset({"br", "col", "input", "meta"})

# Controls have no meaning in a page, and overrides of the writing direction would reach beyond the name they are in.
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


Attribute: TypeAlias = str | float | bool | None


def printable(text: str) -> str:
    """`text` with control characters and overrides of the writing direction made visible."""
    return _UNPRINTABLE.sub("\ufffd", text)


def element(tag: str, /, *content: str, **attributes: Attribute) -> Markup:
    """One element. Content that is not `Markup` is text.

    Underscores in attribute names become hyphens, and one at the end is dropped: ``class_``, ``data_row``. None and
    False leave an attribute out, True gives it no value.
    """
    start = f"<{tag}{''.join(_attribute(key, value) for key, value in attributes.items())}>"
    return Markup(start) if tag in _VOID else Markup(f"{start}{joined(content)}</{tag}>")


def joined(parts: Iterable[str]) -> Markup:
    """All parts one after the other; text among them is escaped."""
    return Markup("".join(part if isinstance(part, Markup) else escape(printable(part), quote=False) for part in parts))


def name_of(text: str) -> Markup:
    """A name inside a sentence, whose writing direction does not touch its neighbours."""
    return element("bdi", text)


def _attribute(key: str, value: Attribute) -> str:
    if value is None or value is False:
        return ""
    name = key.rstrip("_").replace("_", "-")
    if value is True:
        return f" {name}"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f' {name}="{escape(printable(text))}"'
