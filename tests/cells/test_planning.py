from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import pytest
import tiny_suite
from helpers_engine import TINY

from lfobench.cells import plan as planning
from lfobench.cells.cell import Assigned
from lfobench.cells.plan import Request, make_plan
from lfobench.contract.suite import Suite
from lfobench.errors import UserError
from lfobench.registry import load_suite


def cpu() -> bool:
    return False


def gpu() -> bool:
    return True


@pytest.fixture
def locomotion(monkeypatch: pytest.MonkeyPatch) -> Suite:
    """The suite as declared, without reading anybody's weights."""
    suite = replace(load_suite("locomotion"), demonstrator=tiny_suite.demonstrator)
    monkeypatch.setattr(planning, "load_suite", lambda name: suite)
    return suite


def test_the_whole_table(locomotion: Suite) -> None:
    plan = make_plan(Request("dilo,smodice,oril,bco,bc", "locomotion", seeds="0-6", protocol="paper"), cpu)
    assert len(plan.cells) == 16 * 5
    assert len(plan.runs) == 16 * 5 * 7
    assert len({run.identity_hash for run in plan.runs}) == 560
    assert plan.tasks == list(locomotion.tasks)
    assert set(Counter(cell.method.name for cell in plan.cells).values()) == {16}
    assert [cell.method.name for cell in plan.cells[:5]] == ["dilo", "smodice", "oril", "bco", "bc"]


def test_paper_steps_come_from_the_task(locomotion: Suite) -> None:
    plan = make_plan(Request("dilo", "locomotion", protocol="paper"), cpu)
    steps = {cell.task.group: cell.identity["protocol"]["steps"] for cell in plan.cells}
    assert steps["random+expert"] == 300_000
    assert steps["random+few-expert"] == 500_000


def test_steps_can_be_assigned(locomotion: Suite) -> None:
    plan = make_plan(Request("dilo", "locomotion", protocol="paper", assigned=Assigned(50_000)), cpu)
    found = [cell.identity["protocol"] for cell in plan.cells]
    assert {(one["name"], one["steps"], one["steps_assigned"]) for one in found} == {("paper", 50_000, True)}


def test_assigning_the_steps_that_a_protocol_has_anyway_is_the_same_run() -> None:
    own = make_plan(Request("bc", TINY, protocol="quick"), cpu)
    assigned = make_plan(Request("bc", TINY, protocol="quick", assigned=Assigned(own.protocol.steps)), cpu)
    assert [run.identity_hash for run in own.runs] == [run.identity_hash for run in assigned.runs]


@pytest.mark.parametrize(
    ("protocol", "seeds"), [("paper", range(7)), ("quick", range(3)), ("demo", range(3)), ("smoke", range(2))]
)
def test_default_seeds_are_the_protocols(protocol: str, seeds: range) -> None:
    assert make_plan(Request("bc", TINY, protocol=protocol), cpu).seeds == tuple(seeds)


@pytest.mark.parametrize(
    ("device", "available", "runs_on", "protocol"),
    [
        ("auto", cpu, "cpu", "quick"),
        ("auto", gpu, "cuda", "paper"),
        ("cpu", gpu, "cpu", "quick"),
        ("cuda", gpu, "cuda", "paper"),
    ],
)
def test_auto_protocol_fits_the_device(device: str, available: Any, runs_on: str, protocol: str) -> None:
    plan = make_plan(Request("bc", TINY, device=device), available)
    assert (plan.device, plan.protocol.name) == (runs_on, protocol)
    assert protocol in plan.protocol_reason
    assert runs_on in plan.protocol_reason
    assert plan.cells[0].identity["protocol"]["name"] == protocol, "records carry the name that ran"
    assert make_plan(Request("bc", TINY, device=device, protocol="smoke"), available).protocol_reason == ""


def test_a_chosen_protocol_and_auto_are_one_run() -> None:
    auto = make_plan(Request("bc", TINY), cpu)
    chosen = make_plan(Request("bc", TINY, protocol="quick"), cpu)
    assert [run.identity_hash for run in auto.runs] == [run.identity_hash for run in chosen.runs]


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (Request("dillo", TINY), r"Unknown method 'dillo'.*Did you mean 'dilo'"),
        (Request("dilo,smodcie", TINY), r"Unknown method 'smodcie'.*Did you mean 'smodice'"),
        (Request("zzzzzz", TINY), r"Unknown method 'zzzzzz'.*Known: .*dilo"),
        (Request("", TINY), "No method is named"),
        (Request(" , ", TINY), "No method is named"),
        (Request("bc", "locomotoin"), r"Unknown suite 'locomotoin'.*Did you mean 'locomotion'"),
        (Request("bc", "no/such/file.py"), r"No suite file at no/such/file\.py"),
        (Request("bc", TINY, tasks="pole-random-exprt"), r"Unknown task.*Did you mean 'pole-random-expert'"),
        (Request("bc", TINY, seeds="1-"), "is not a list of seeds"),
        (Request("bc", TINY, seeds=""), "is not a list of seeds"),
        (Request("bc", TINY, tasks=""), "task"),
        (Request("bc", TINY, tasks=","), "task"),
        (Request("bc", TINY, protocol="quik"), r"Unknown protocol 'quik'.*Did you mean 'quick'"),
        (Request("bc", TINY, preset="papr"), r"Unknown preset of bc 'papr'.*Did you mean 'paper'"),
        (Request("bc", TINY, source="generatd"), r"Unknown source 'generatd'.*Did you mean 'generated'"),
        (Request("bc", TINY, device="gpu"), r"Unknown device 'gpu'"),
        (Request("bc", "locomotion", source="expert=/a.hdf5"), r"one environment.*have \d.*--tasks"),
        (Request("bc", TINY, device="cuda"), r"No CUDA device.*--device cpu"),
        (Request("bc", TINY, assignments=("dilo.tau=3",)), r"Unknown method in --set 'dilo'"),
        (Request("bc", TINY, assignments=(f"bc.learning_rate={'9' * 5000}",)), r"--set bc.learning_rate="),
        (Request("bc", TINY, assignments=(f"bc.learning_rate={'[' * 100_000}",)), r"--set bc.learning_rate="),
        (Request("bc", TINY, assignments=("bc.hidden=[true]",)), r"--set bc.hidden"),
        (Request("bc", TINY, assignments=("bc.hidden=[1.0]",)), r"--set bc.hidden"),
        (Request("bc", TINY, assignments=("bc.tau=3",)), r"Unknown field of bc in --set 'tau'"),
    ],
)
def test_mistakes_name_the_thing_and_the_way_out(request_: Request, message: str) -> None:
    with pytest.raises(UserError, match=message) as refused:
        make_plan(request_, cpu)
    assert "\n" not in str(refused.value)


def test_tasks_in_suite_order_methods_as_typed() -> None:
    request = Request("bc,dilo", TINY, tasks="pole-medium-expert,pole-random-expert", protocol="smoke")
    order = [(cell.task.name, cell.method.name) for cell in make_plan(request, cpu).cells]
    assert order == [
        ("pole-random-expert", "bc"),
        ("pole-random-expert", "dilo"),
        ("pole-medium-expert", "bc"),
        ("pole-medium-expert", "dilo"),
    ]
