"""Options that several commands share, with one meaning each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Methods = Annotated[
    str,
    typer.Option(
        help="Comma-separated methods, e.g. dilo,smodice, or where one stands: file.py, file.py:Class, "
        "package.module:Class. See 'lfobench ls methods'."
    ),
]
SuiteName = Annotated[str, typer.Option("--suite", help="A suite's name, or the path of a file that defines SUITE.")]
Tasks = Annotated[str | None, typer.Option(help="Comma-separated globs over the suite's tasks, e.g. 'hopper-*'.")]
Seeds = Annotated[str | None, typer.Option(help="Numbers and ranges, e.g. 0-6. Default: the protocol's.")]
ProtocolName = Annotated[
    str, typer.Option("--protocol", help="paper, quick, demo, smoke, or auto: paper on a CUDA device, quick on a CPU.")
]
Steps = Annotated[int | None, typer.Option(min=1, help="Gradient steps, in place of the protocol's own number.")]
Preset = Annotated[str, typer.Option(help="released (the authors' code) or paper (what the paper says).")]
Assignments = Annotated[
    list[str] | None, typer.Option("--set", help="METHOD.FIELD=VALUE, repeatable, e.g. --set dilo.tau=3.")
]
Tuned = Annotated[
    bool, typer.Option("--tuned", help="With the values that 'lfobench tune' chose, where there is a choice.")
]
Grid = Annotated[
    list[str] | None,
    typer.Option(
        "--grid",
        help="METHOD.FIELD=V1,V2,…, repeatable: the values to choose from, in place of a declared grid; fields of one "
        "method multiply. E.g. --grid dilo.tau=0.1,1.",
    ),
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="Jobs at once. Default: what the cores, or the device's memory, hold.")
]
NoWait = Annotated[
    bool,
    typer.Option(
        "--no-wait", help="Do not wait for runs that another process is training; exit code 3 where some are left."
    ),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Print the plan and stop.")]
Source = Annotated[
    str,
    typer.Option(
        help="Where data comes from: generated, a source that the suite declares (d4rl, minari, …), or files of yours, "
        "offline=PATH,expert=PATH and keys=A+B for what an observation is made of. auto: generated where a suite can."
    ),
]
Device = Annotated[str, typer.Option(help="auto, cpu or cuda.")]
Precision = Annotated[
    str,
    typer.Option(
        help="Of matrix products: float32, tf32 (CUDA), bf16, or auto: tf32 on a CUDA device, float32 on a CPU."
    ),
]
Out = Annotated[Path, typer.Option(help="Folder of the records.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for scripts.")]

DEFAULT_METHODS = "dilo,smodice,oril,bco,bc"
DEFAULT_SUITE = "locomotion"
DEFAULT_OUT = Path("runs")
