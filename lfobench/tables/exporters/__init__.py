"""Formats of a table: a module each, named after its format, whose function ``export`` makes text of a table.

A new format is a new module here and nothing else. ``terminal`` draws on a console instead.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from lfobench.errors import unknown_name

if TYPE_CHECKING:
    from lfobench.tables.table import Table

FORMATS = tuple(sorted(module.name for module in iter_modules(__path__) if module.name != "terminal"))


def export(table: Table, format_name: str) -> str:
    """`table` in the named format.

    Raises:
        UserError: there is no such format.
    """
    check_format(format_name)
    text: str = import_module(f"{__name__}.{format_name}").export(table)
    return text


def check_format(format_name: str) -> None:
    """Refuse, before anything is read, a format that is not in `FORMATS`.

    Raises:
        UserError: naming the closest one.
    """
    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
