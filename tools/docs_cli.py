"""A hook of the documentation's generator: the page of the command line, from the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer.main

MARK = "<!-- commands -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page, with every command in the place of the mark."""
    if MARK not in markdown:
        return markdown
    from lfobench.cli import app

    return markdown.replace(MARK, "\n".join(_described(typer.main.get_command(app), "lfobench")))


def _described(command: Any, name: str) -> Iterator[str]:
    commands = getattr(command, "commands", None)
    if commands is not None:
        for each, below in commands.items():
            yield from _described(below, f"{name} {each}")
        return
    yield f"## {name}\n"
    given = [_argument(each) for each in command.params if each.param_type_name == "argument"]
    yield f"`{' '.join([name, *given, '[OPTIONS]'])}`\n"
    yield re.sub(r"Example: (.*)", r"`\1`", command.help or "") + "\n"
    options = [each for each in command.params if each.name != "help" and not getattr(each, "hidden", False)]
    if options:
        yield "| option | | default |\n| --- | --- | --- |"
    for each in options:
        spelled = [_argument(each)] if each.param_type_name == "argument" else [*each.opts, *each.secondary_opts]
        names = ", ".join(f"`{spelling}`" for spelling in spelled)
        text = " ".join((getattr(each, "help", None) or "").split())
        default = "" if each.default in (None, False, ...) or callable(each.default) else f"`{each.default}`"
        yield "| " + " | ".join(part.replace("|", "\\|") for part in (names, text, default)) + " |"
    yield ""


def _argument(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name).upper()
