"""``python -m benchmarks``: the engine measured against the authors' loops, and against the machine's own limits."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import torch
import typer
from rich.table import Table

from benchmarks import speed
from lfobench.cells.names import split_names
from lfobench.cells.plan import choose_device
from lfobench.cli import options
from lfobench.cli.console import errors, output, print_json
from lfobench.errors import UserError, unknown_name
from lfobench.files import writable_folder, write_text

STYLES = {"aim": "green", "must": "green", "missed": "bold red", "unmeasured": "dim"}


def bench(
    only: Annotated[
        str | None,
        typer.Option(
            help="Comma-separated sections: loading, cell, steps, ablations, bf16, seeds, evaluation, "
            "simulation, statistics, records."
        ),
    ] = None,
    device: options.Device = "auto",
    quick: Annotated[
        bool, typer.Option("--quick", help="Show that everything runs; the figures mean nothing.")
    ] = False,
    out: Annotated[
        Path, typer.Option(help="Folder of the raw values: a file per machine, and one more per selection of sections.")
    ] = Path("results/bench"),
    as_json: options.Json = False,
) -> None:
    """Time the engine, in alternation with plain reference loops, and compare it with its targets.

    Example: python -m benchmarks --only steps,evaluation
    """

    sections = list(speed.SECTIONS) if only is None else split_names(only)
    for name in sections:
        if name not in speed.SECTIONS:
            raise unknown_name("section", name, speed.SECTIONS)
    chosen = choose_device(device, torch.cuda.is_available)
    if not quick:
        writable_folder(out, "--out")
    findings, raw = speed.measure(chosen, quick, sections, lambda name: errors.print(f"measuring: {name}"))
    if as_json:
        print_json(raw)
    else:
        output.print(_table(findings, raw))
        _print_details(raw)
    if not quick:
        path = out / f"{raw['hardware']['slug']}.json"
        if only is not None and path.exists():
            path = path.with_name(f"{path.stem}-{'-'.join(sections)}.json")
        write_text(path, json.dumps(raw, indent=2) + "\n")
        errors.print(f"Raw values in {path}", soft_wrap=True)


def _table(findings: list[Any], raw: dict[str, Any]) -> Table:
    title = f"{raw['hardware']['name']}, {raw['hardware']['cores']} cores" + (" - quick, no figures" * raw["quick"])
    table = Table("measure", "must", "aim", "measured: median (min to max)", "", title=title, title_style="bold")
    for finding in findings:
        target = finding.target
        style = STYLES[finding.verdict]
        table.add_row(
            target.measure.replace("[", r"\["),
            target.bound(target.must),
            target.bound(target.aim),
            finding.text,
            f"[{style}]{finding.verdict}[/]",
        )
    return table


def _print_details(raw: dict[str, Any]) -> None:
    def spread(value: dict[str, float]) -> str:
        return f"{value['median']:.3g} ({value['minimum']:.3g} to {value['maximum']:.3g})"

    for step in raw.get("steps", []):
        output.print(
            f"{step['workload']}, batch {step['batch_size']}: authors' loop / engine "
            f"{spread(step['authors_over_engine'])}, engine / floor {spread(step['engine_over_floor'])}"
        )
    for entry in raw.get("ablations", []):
        ratio = spread(entry["without_over_with"])
        output.print(f"{entry['workload']}, batch {entry['batch_size']}, {entry['without']}: step / as it is {ratio}")
    for entry in raw.get("seeds", {}).get("seeds", []):
        ratio = spread(entry["seed_step_ratio"])
        output.print(f"{entry['seeds']} seeds in one program: a seed's step / alone {ratio}")
    for entry in raw.get("evaluation", []):
        output.print(
            f"{entry['environment']}, one environment at a time / lock step "
            f"{spread(entry['one_at_a_time_over_lock_step'])}, / {entry['workers']} processes "
            f"{spread(entry['one_at_a_time_over_workers'])}"
        )
    if cell := raw.get("cell"):
        parts = ", ".join(f"{part} {seconds:.2f} s" for part, seconds in cell["seconds"].items())
        output.print(f"one cell ({cell['protocol']}, {cell['steps']} steps, {cell['seeds']} seeds): {parts}")


def main() -> None:
    """A user's mistake is one line and exit code 2."""
    try:
        typer.run(bench)
    except UserError as error:
        errors.print(f"Error: {error}", soft_wrap=True, markup=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
