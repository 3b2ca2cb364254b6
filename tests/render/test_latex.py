from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from lfobench.contract.record import Record, Warning
from lfobench.render.building import build_table
from lfobench.render.formats import export
from lfobench.render.latex import escape

ROWS = (
    r"\multicolumn{4}{l}{random+expert} \\",
    r"\quad hopper & $45.3 \pm 4.5$ & \lfobenchbest{$66.6 \pm 57.7$}\rlap{$^{\times1}$}"
    r" & \lfobenchbest{$100.9 \pm 2.7$} \\",
    r"\quad halfcheetah & $45.3 \pm 4.5$ & \lfobenchbest{$99.9 \pm \phantom{0}0.8$}"
    r" & \lfobenchbest{$100.9 \pm 2.7$} \\",
)

HOSTILE = r"""\input{x} 100% $x_1^2$ #1 & {a} ~b~ <c> |d| "e" `f' --g-- [h] *i ''j,, é 中 ±·−–✗"""


def test_rows_highlights_and_column_groups(example: list[Record]) -> None:
    kept = [
        record
        for record in example
        if record.method in {"bc", "smodice", "dilo"} and record.labels.group == "random+expert"
    ]
    text = export(build_table(kept), "latex")
    assert "\n".join(ROWS) in text
    assert r"\multicolumn{1}{c}{Access to expert actions} & \multicolumn{2}{c}{No expert actions} \\" in text
    assert r"\cmidrule(lr){2-2} \cmidrule(lr){3-4}" in text
    assert r"\begin{tabular}{lrrr}" in text
    assert r"\providecommand{\lfobenchbest}" in text


def test_the_notes_stand_below(example: list[Record]) -> None:
    table, _, notes = export(build_table(example), "latex").partition(r"\end{tabular}")
    assert r"\textbf{Protocol:} paper: 300,000 or 500,000 gradient steps" in notes
    assert r"p \textless{} 0.05" in notes
    assert "Protocol" not in table


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bc-expert", "bc-expert"),
        ("50%_of $5 & #1", r"50\%\_of \$5 \& \#1"),
        ("a\\b{c}", r"a\textbackslash{}b\{c\}"),
        ("--", "-{}-"),
        ("two\n lines", "two lines"),
        ("中", "U+4E2D"),
    ],
)
def test_escape(text: str, expected: str) -> None:
    assert escape(text) == expected


def test_no_engine_is_needed_to_see_that_every_outside_string_is_escaped(
    make_record: Callable[..., Record],
) -> None:
    text = export(build_table(hostile_records(make_record)), "latex")
    assert r"\input" not in text
    assert "100%" not in text.partition("\n")[2]


def hostile_records(make_record: Callable[..., Record]) -> list[Record]:
    names = {"row": HOSTILE, "group": "*" + HOSTILE, "task": HOSTILE}
    warning = Warning(what=HOSTILE, remedy=HOSTILE)
    return [
        make_record(1.0, HOSTILE, preset=HOSTILE, set={HOSTILE: HOSTILE}, warnings=[warning], **names),
        make_record(1.0, "[b]", seed=3, diverged_at=5, **names),
        make_record(1.0, "plain", sees_expert_actions=True, **names),
        make_record(1.0, "plain", sees_expert_actions=True, row="[x", group="[y"),
    ]


@pytest.mark.parametrize("records", ["example", "hostile"])
def test_compiles_as_it_is(
    records: str, example: list[Record], make_record: Callable[..., Record], tmp_path: Path
) -> None:
    engine = shutil.which("pdflatex")
    if engine is None:
        pytest.skip("no TeX engine: pdflatex is not on the path")
    table = export(build_table(example if records == "example" else hostile_records(make_record)), "latex")
    (tmp_path / "table.tex").write_text(
        "\\documentclass{article}\n\\usepackage{booktabs}\n\\usepackage{xcolor}\n"
        f"\\begin{{document}}\n{table}\\end{{document}}\n",
        encoding="utf-8",
    )
    command = [engine, "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "table.tex"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False)
    assert run.returncode == 0, run.stdout[-2000:]
    assert (tmp_path / "table.pdf").stat().st_size > 0
