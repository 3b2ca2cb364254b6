"""HTML and SVG elements from Python values: everything that is not already markup is escaped on its way in."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TypeAlias

from lfobench.words import harmless_lines

_VOID = frozenset({"br", "col", "input", "meta"})


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


Attribute: TypeAlias = str | float | bool | None


def element(tag: str, /, *content: str, **attributes: Attribute) -> Markup:
    """One element. Content that is not `Markup` is text.

    Underscores in attribute names become hyphens, and one at the end is dropped: ``class_``, ``data_row``. None and
    False leave an attribute out, True gives it no value.
    """
    start = f"<{tag}{''.join(_attribute(key, value) for key, value in attributes.items())}>"
    return Markup(start) if tag in _VOID else Markup(f"{start}{joined(content)}</{tag}>")


def joined(parts: Iterable[str]) -> Markup:
    """All parts one after the other; text among them is escaped."""
    return Markup(
        "".join(part if isinstance(part, Markup) else escape(harmless_lines(part), quote=False) for part in parts)
    )


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
    return f' {name}="{escape(harmless_lines(text))}"'
