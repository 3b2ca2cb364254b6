"""``lfobench new``: a file of one's own to begin with, which runs as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lfobench.cli.console import output

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
    words = "".join(part.capitalize() for part in re.split(r"[-_+]", name))
    of_class = words if words.isidentifier() and not keyword.iskeyword(words) else f"Mine{words}"
    source = files("lfobench.templates").joinpath(f"{kind}.py").read_text(encoding="utf-8")
    source = re.sub(r"\bmine\b", name, re.sub(r"\bMine(?=Config\b|\b)", of_class, source))
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(source)
    except FileExistsError as error:
        raise UserError(f"{path} is there already.", "Choose another name, or move it away.") from error
    except OSError as error:
        raise UserError(f"Cannot write {path}: {error.strerror}.", "Work in another folder.") from error
