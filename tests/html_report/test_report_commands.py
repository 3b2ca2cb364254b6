"""The commands of a page: parsed as the command line parses them, they name the runs of its records and no others."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from itertools import product

import pytest
from helpers_records import make_cell, make_record
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.cells.names import parse_assignments, parse_seeds, split_names
from lfobench.html_report.reproduction import commands, run_commands, seed_list
from lfobench.record import Failure, Record
from lfobench.score import HEADLINE, Statistic
from lfobench.stats.highlight import DEFAULT_RULE, Rule

Runs = list[tuple[str, str, int, str]]


def options(arguments: Sequence[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    assert arguments[0] == "run"
    for name, value in zip(arguments[1::2], arguments[2::2], strict=True):
        found.setdefault(name, []).append(value)
    return found


def runs(commands: Sequence[Sequence[str]]) -> Runs:
    """(method, task, seed, settings) of every run that the commands make."""
    made = []
    for given_options in map(options, commands):
        methods = split_names(given_options["--methods"][0])
        assigned = parse_assignments(given_options.get("--set", []), methods)
        tasks, seeds = split_names(given_options["--tasks"][0]), parse_seeds(given_options["--seeds"][0])
        made += [
            (method, task, seed, repr(assigned.get(method, {})))
            for method, task, seed in product(methods, tasks, seeds)
        ]
    return sorted(made)


def of(records: Sequence[Record]) -> Runs:
    return sorted((each.method, each.task, each.seed, repr(each.identity["set"])) for each in records)


@given(st.sets(st.integers(0, 30), min_size=1, max_size=12))
@settings(max_examples=60)
def test_seeds_are_written_as_they_are_read(seeds: set[int]) -> None:
    assert parse_seeds(seed_list(sorted(seeds))) == sorted(seeds)


@given(
    st.sets(
        st.tuples(
            st.sampled_from("abc"), st.sampled_from(["ant", "hopper"]), st.integers(0, 3), st.sampled_from([0, 2])
        ),
        min_size=1,
        max_size=12,
    )
)
@settings(max_examples=40)
def test_any_set_of_runs_is_made_exactly_once(wanted: set[tuple[str, str, int, int]]) -> None:
    records = [
        make_record(1.0, method, seed, row=row, set={"tau": tau} if tau else {}) for method, row, seed, tau in wanted
    ]
    assert runs(run_commands(records)) == of(records)


def test_a_rectangle_of_runs_is_one_command() -> None:
    records = [
        record
        for row in ("hopper", "ant")
        for method in ("dilo", "bc")
        for record in make_cell([1.0, 2.0, 3.0], method, row=row)
    ]
    assert run_commands(records) == [
        shlex.split(
            "run --methods dilo,bc --suite locomotion --tasks hopper-random-expert,ant-random-expert "
            "--source generated --protocol quick --evaluation-every 1000 --evaluation-episodes 10 --final-episodes 0 "
            "--seeds 0-2 --preset released --out reproduction"
        )
    ]


@pytest.mark.parametrize("value", [3, 0.5, True, None, "text", "3", "none", 'a "b" c', [1, "x"], {"a": 1}])
def test_assigned_values_are_read_back_as_they_were(value: object) -> None:
    records = make_cell([1.0, 2.0], set={"tau": value})
    assert runs(run_commands(records)) == of(records)


def test_steps_and_precision_are_said_where_they_were_chosen() -> None:
    protocol = make_record(1.0).identity["protocol"] | {"steps": 500, "steps_assigned": True}
    (command,) = run_commands([make_record(1.0, protocol=protocol, precision="bf16")])
    found = options(command)
    assert found["--steps"] == ["500"]
    assert found["--precision"] == ["bf16"]


def test_evaluations_are_those_of_the_records() -> None:
    protocol = make_record(1.0).identity["protocol"] | {"evaluation_episodes": 7, "further_episodes": 100}
    commands_ = run_commands([make_record(1.0), make_record(1.0, "bc", protocol=protocol)])
    found = [(options(each)["--evaluation-episodes"], options(each)["--final-episodes"]) for each in commands_]
    assert found == [(["10"], ["0"]), (["7"], ["100"])]


def test_presets_are_commands_of_their_own() -> None:
    records = [make_record(1.0), make_record(1.0, preset="paper")]
    assert [options(each)["--preset"] for each in run_commands(records)] == [["released"], ["paper"]]


def test_crashed_runs_are_run_too() -> None:
    crashed = make_record(1.0, seed=2)
    failure = Failure(
        identity_hash=crashed.identity_hash, identity=crashed.identity, labels=crashed.labels, error="", traceback=[]
    )
    (command,) = run_commands(make_cell([1.0, 2.0]), [failure])
    assert options(command)["--seeds"] == ["0-2"]


def test_globs_in_a_task_s_name_match_that_task_alone() -> None:
    from fnmatch import fnmatchcase

    (command,) = run_commands([make_record(1.0, task="a[1]*b?")])
    (pattern,) = options(command)["--tasks"]
    assert fnmatchcase("a[1]*b?", pattern)
    assert not fnmatchcase("a1xxby", pattern)


def test_commands_survive_the_shell() -> None:
    hostile = "o'r\"il; rm -rf <x>"
    made = commands(
        [make_record(1.0, hostile)],
        [],
        Statistic("at", 1000),
        Rule(test="student", alpha=0.01),
        ["--methods", hostile],
    )
    (run,) = map(shlex.split, made.runs)
    assert run[:4] == ["lfobench", "run", "--methods", hostile]
    view = ["--out", "reproduction", "--stat", "at:1000", "--methods", hostile]
    assert shlex.split(made.table) == ["lfobench", "table", *view]
    assert shlex.split(made.page) == ["lfobench", "report", *view, "--to", "report.html"]
    knobs = ["--test", "student", "--scope", "group", "--correction", "none", "--alpha", "0.01"]
    assert shlex.split(made.knobs) == knobs


def test_the_statistic_is_written_out_because_its_default_depends_on_the_records() -> None:
    assert "--stat last5" in commands([make_record(1.0)], [], HEADLINE, DEFAULT_RULE).table
