from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers_folders import with_provenance

from lfobench.record import Record, Warning
from lfobench.stats.intervals import Summary
from lfobench.tables.building import build_table
from lfobench.tables.exporters import export
from lfobench.tables.exporters.latex import escape
from lfobench.tables.published_columns import PublishedScores, with_published
from lfobench.tables.table import Table

ROWS = (
    r"\multicolumn{4}{@{}l}{random+expert} \\",
    r"\quad hopper & $45.3 \pm 4.5$ & \lfobenchbest{$66.6 \pm 57.7$}$^{\times1}$"
    r" & \lfobenchbest{$100.9 \pm 2.7$} \\",
    r"\quad halfcheetah & $45.3 \pm 4.5$ & \lfobenchbest{$99.9 \pm \phantom{0}0.8$}\phantom{$^{\times1}$}"
    r" & \lfobenchbest{$100.9 \pm 2.7$} \\",
)

MARKED = (
    r"Task & bc & oril & dilo &  \\",
    r"\quad hopper & $45.3 \pm 4.5$ & $89.3 \pm 5.0$\phantom{$^{!2}$}"
    r" & \lfobenchbest{$100.0 \pm \phantom{0}4.0$}\rlap{$^{\dagger}$}\phantom{$^{\times1\,!2}$} & $103.3$ \\",
    r"\quad walker2d & \textendash{}$\phantom{{} \pm 0.0}$ & crashed$^{!2}$$\phantom{{} \pm 0.0}$"
    r" & $9.0\phantom{{} \pm 00.0}$\phantom{$^{\times1\,!2}$} & $103.3$ \\",
    r"\quad ant & \textendash{}$\phantom{{} \pm 0.0}$ & \lfobenchbest{$6.2 \pm 1.3$}\phantom{$^{!2}$}"
    r" & \lfobenchbest{$66.7 \pm 57.7$}$^{\times1\,!2}$ & \textendash{} \\",
    r"\textbf{$\dagger$:} stands out with p \textless{} 0.05",
)

HOSTILE = r"""\input{x} 100% $x_1^2$ #1 & {a} ~b~ <c> |d| "e" `f' --g-- [h] *i ''j,, é 中 ±·−–✗†≈≠"""


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
    assert r"\begin{tabular}{@{}lrrr@{}}" in text
    assert r"\providecommand{\lfobenchbest}" in text


def test_every_mark_has_room_that_the_other_cells_leave_too(marked: Table) -> None:
    text = export(marked, "latex")
    for line in MARKED:
        assert line in text
    assert r"& \multicolumn{1}{c}{Expert} \\" in text


def test_published_numbers_have_their_group_and_their_sign(make_cell: Callable[..., list[Record]]) -> None:
    table = beside_published(build_table(make_cell([90.0, 91.0, 92.0, 90.5, 91.5]) + make_cell([1.0, 2.0], row="ant")))
    text = export(table, "latex")
    assert r"& \multicolumn{1}{c}{Published} \\" in text
    assert r"& $92.0 \pm 0.8$$^{\approx}$ \\" in text
    assert r"& \textendash{}\phantom{$^{\approx}$}$\phantom{{} \pm 0.0}$ \\" in text


def beside_published(table: Table) -> Table:
    scores = {("hopper-random-expert", column.method): Summary(5, 92.0, 0.8) for column in table.columns}
    theirs = PublishedScores(f"{HOSTILE}, Table 1", table.source, table.protocol, scores, HOSTILE)
    return with_published(table, theirs, 5.0, 0.05, False)


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


# --- with an engine --------------------------------------------------------------------------------------------------


def compiled(table: Table, folder: Path, preamble: str = "") -> str:
    """The engine's log of the table in a plain article."""
    engine = shutil.which("pdflatex")
    if engine is None:
        pytest.skip("no TeX engine: pdflatex is not on the path")
    (folder / "table.tex").write_text(
        f"\\documentclass{{article}}\n\\usepackage{{booktabs}}\n\\usepackage{{xcolor}}\n{preamble}\n"
        f"\\begin{{document}}\n{export(table, 'latex')}\\end{{document}}\n",
        encoding="utf-8",
    )
    command = [engine, "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "table.tex"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", check=False)
    assert run.returncode == 0, run.stdout[-2000:]
    assert (folder / "table.pdf").stat().st_size > 0
    return (folder / "table.log").read_text(encoding="latin-1")


@pytest.mark.parametrize("which", ["example", "hostile", "marked", "published"])
def test_compiles_as_it_is(
    which: str, example: list[Record], marked: Table, make_record: Callable[..., Record], tmp_path: Path
) -> None:
    table = (
        marked if which == "marked" else build_table(hostile_records(make_record) if which == "hostile" else example)
    )
    said = compiled(beside_published(table) if which == "published" else table, tmp_path)
    assert "Missing character" not in said


def of_the_seed_paper(make_cell: Callable[..., list[Record]]) -> list[Record]:
    """Six methods, numbers as wide as they get, a task with a long name."""
    spread = [-60.0, 30.0, 30.0]
    return [
        record
        for method in ("bc-expert", "bc", "oril", "bco", "smodice", "dilo")
        for row in ("halfcheetah", "hopper")
        for record in make_cell(
            [(100.0 if method in ("smodice", "dilo") else 70.0) + offset for offset in spread],
            method,
            row=row,
            sees_expert_actions=method in ("bc-expert", "bc"),
        )
    ]


def test_six_methods_fit_the_width_of_a_page(make_cell: Callable[..., list[Record]], tmp_path: Path) -> None:
    assert "Overfull" not in compiled(build_table(of_the_seed_paper(make_cell)), tmp_path)


def test_six_methods_and_the_demonstration_fit_the_page_of_a_conference(
    make_cell: Callable[..., list[Record]], tmp_path: Path
) -> None:
    """5.5 inches of text, as the machine-learning conferences have."""
    records = [with_provenance(record, demonstration_score=103.2) for record in of_the_seed_paper(make_cell)]
    assert "Overfull" not in compiled(build_table(records), tmp_path, r"\setlength{\textwidth}{5.5in}")
