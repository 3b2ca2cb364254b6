"""``lfobench check`` and ``lfobench new``: a method of one's own, begun and checked."""

from __future__ import annotations

from pathlib import Path
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

    from lfobench import api
    from lfobench.cells.names import parse_assignments
    from lfobench.registry import load_method

    known = load_method(method)
    assigned = parse_assignments(assign or (), [known.name]).get(known.name, {})
    findings = api.check(known, protocol=protocol, preset=preset, set=assigned)
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
        verdict = "breaks a rule, so the rules after it were not checked, and `run` refuses it"
        verdict = verdict if broken else "keeps the contract"
        output.print(f"{escape(known.name)} {verdict}.", soft_wrap=True)
    raise typer.Exit(1 if broken else 0)


app = typer.Typer(name="new", help="A method or a suite of your own, as a file that runs.", no_args_is_help=True)

Name = Annotated[str, typer.Argument(help="Its name; the file is NAME.py, in this folder.")]


@app.command()
def method(name: Name) -> None:
    """Write NAME.py with a small method, which trains as it is.

    Example: lfobench new method mine
    """
    from lfobench.registry import method_names

    _write("method", name, method_names())
    output.out(f"{name}.py is a method. Next: lfobench run --methods {name}.py --suite locomotion --protocol smoke")


@app.command()
def suite(name: Name) -> None:
    """Write NAME.py with a suite of one task, which runs as it is.

    Example: lfobench new suite mine
    """
    from lfobench.registry import suite_names

    _write("suite", name, suite_names())
    output.out(f"{name}.py is a suite. Next: lfobench run --suite {name}.py --methods dilo,bc --protocol smoke")


def _write(kind: str, name: str, taken: list[str]) -> None:
    """Copy the template of a kind under a name.

    Raises:
        UserError: the name is taken, is none, or would hide a package; or there is a file of that name.
    """
    import keyword
    import re
    import sys
    from importlib.machinery import PathFinder
    from importlib.resources import files

    from lfobench.errors import UserError
    from lfobench.registry import NAME

    path = Path(f"{name}.py")
    if not re.fullmatch(NAME, name):
        raise UserError(f"'{name}' is no name.", "Letters, digits, '_', '+' and '-' make one.")
    if name in taken:
        raise UserError(f"There is a {kind} '{name}'.", "Choose another name.")
    if name in sys.stdlib_module_names or PathFinder.find_spec(name) is not None:
        raise UserError(f"{path} would hide the package '{name}' from the files beside it.", "Choose another name.")
    class_name = "".join(part.capitalize() for part in re.split(r"[-_+]", name))
    of_class = class_name if class_name.isidentifier() and not keyword.iskeyword(class_name) else f"Mine{class_name}"
    source = files("lfobench.templates").joinpath(f"{kind}.py").read_text(encoding="utf-8")
    source = re.sub(r"\bmine\b", name, re.sub(r"\bMine(?=Config\b|\b)", of_class, source))
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(source)
    except FileExistsError as error:
        raise UserError(f"{path} is there already.", "Choose another name, or move it away.") from error
    except OSError as error:
        raise UserError(f"Cannot write {path}: {error.strerror}.", "Work in another folder.") from error
