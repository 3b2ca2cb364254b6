"""All rows of Table 1 of DILO's paper are tasks, each of them also in a suite of its own."""

from __future__ import annotations

import csv
from pathlib import Path

from lfobench.cells.plan import Request, make_plan
from lfobench.registry import load_suite

PUBLISHED = Path(__file__).parents[2] / "results" / "published" / "dilo-2024" / "table1.csv"


def test_every_row_of_the_published_table_is_a_task() -> None:
    with PUBLISHED.open(encoding="utf-8") as file:
        rows = {(line["env"], line["dataset"]) for line in csv.DictReader(file)}
    tasks = load_suite("table1").tasks
    assert len(tasks) == 24
    # The row's data is named by what joins the offline part.
    assert {(task.environment.name, task.name.removeprefix(f"{task.environment.name}-")) for task in tasks} == rows


def test_the_paper_s_table_has_its_own_variants() -> None:
    tasks, of_suite = load_suite("table1-paper").tasks, load_suite("table1").tasks
    assert [task.name for task in tasks] == [task.name for task in of_suite]
    differing = {task.environment.name for task, other in zip(tasks, of_suite, strict=True) if task != other}
    assert differing == {"door", "hammer", "kitchen"}


def test_a_run_is_the_same_whichever_suite_it_is_named_by() -> None:
    def hashes(suite: str, tasks: str) -> list[str]:
        plan = make_plan(Request("bc", suite, tasks, protocol="smoke"), lambda: False)
        return [run.identity_hash for run in plan.runs]

    for suite, tasks in (("locomotion", "hopper-*"), ("adroit", "pen-*"), ("kitchen", "*")):
        assert hashes("table1", tasks if suite != "kitchen" else "kitchen-*") == hashes(suite, tasks)


def test_every_task_can_be_read_from_d4rl_s_files() -> None:
    plan = make_plan(Request("bc", "table1", protocol="paper", source="d4rl"), lambda: False)
    files = {
        file.name
        for task in plan.tasks
        if task.read_from
        for file in (task.read_from.offline, task.read_from.expert)
        if file
    }
    assert len(plan.tasks) == 24
    # Of locomotion 4 x (random, medium, expert), of Adroit 3 x (cloned, human, expert), and the kitchen's 3.
    assert len(files) == 12 + 9 + 3
