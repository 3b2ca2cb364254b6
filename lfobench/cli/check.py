"""``lfobench check``: a method against its contract, before it costs a night."""

from __future__ import annotations

from typing import Annotated

import typer

from lfobench.cli import options
from lfobench.cli.console import output, print_json


def check(
    method: Annotated[str, typer.Argument(help="A method: its name, FILE.py, FILE.py:Class or package.module:Class.")],
    protocol: Annotated[str, typer.Option(help="Whose budget of the method is checked.")] = "smoke",
    preset: options.Preset = "released",
    assign: options.Assignments = None,
    as_json: options.Json = False,
) -> None:
    """Check a method on random data, in seconds: state, resuming, seeds, actions, declarations.

    Example: lfobench check mine.py
    """
    from rich.markup import escape

    from lfobench.cells.cell import configure, load_protocol
    from lfobench.cells.names import parse_assignments
    from lfobench.engine.method_check import check_method
    from lfobench.registry import load_method

    known = load_method(method)
    assigned = parse_assignments(assign or (), [known.name]).get(known.name, {})
    findings = check_method(known, configure(known, preset, load_protocol(protocol), assigned).config)
    broken = any(finding.problem and finding.fatal for finding in findings)
    if as_json:
        rules = [{"rule": each.rule, "problem": each.problem, "fatal": each.fatal} for each in findings]
        print_json({"method": known.name, "sound": not broken, "rules": rules})
    else:
        for each in findings:
            mark = "[green]holds[/] " if not each.problem else "[red]broken[/]" if each.fatal else "[yellow]slow[/]  "
            output.print(f"{mark} {escape(each.rule)}", soft_wrap=True)
            if each.problem:
                output.print(f"       {escape(each.problem)}", soft_wrap=True)
        words = "breaks a rule, so the rules after it were not checked, and `run` refuses it"
        words = words if broken else "keeps the contract"
        output.print(f"{escape(known.name)} {words}.", soft_wrap=True)
    raise typer.Exit(1 if broken else 0)
