"""The number type of products: what may be asked for, what it means, and that it is part of what a run is."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import pytest
from helpers_engine import TINY, smoke_cell

from lfobench.cells.cell import Precision, Run, check_precision, effective
from lfobench.cells.plan import Request, make_plan
from lfobench.errors import UserError


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_what_a_device_has(device: str) -> None:
    for name in get_args(Precision):
        if (name, device) != ("tf32", "cpu"):
            assert check_precision(name, device) == name


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bf61", r"Unknown precision 'bf61'.*Did you mean 'bf16'"),
        ("float23", r"Unknown precision 'float23'.*Did you mean 'float32'"),
        ("half", r"Unknown precision 'half'.*Known: .*auto.*float32"),
        ("", r"Unknown precision ''"),
        ("tf32", r"TF32.*CUDA.*--precision auto, float32 or bf16"),
    ],
)
def test_what_a_cpu_has_not(name: str, message: str) -> None:
    with pytest.raises(UserError, match=message) as refused:
        check_precision(name, "cpu")
    assert "\n" not in str(refused.value)
    with pytest.raises(UserError, match=message):
        make_plan(Request("bc", TINY, device="cpu", precision=name), lambda: False)


@pytest.mark.parametrize(
    ("asked", "device", "means"),
    [
        ("auto", "cpu", "float32"),
        ("auto", "cuda", "tf32"),
        ("float32", "cpu", "float32"),
        ("float32", "cuda", "float32"),
        ("tf32", "cuda", "tf32"),
        ("bf16", "cpu", "bf16"),
        ("bf16", "cuda", "bf16"),
    ],
)
def test_what_a_precision_means_on_a_device(asked: Precision, device: str, means: Precision) -> None:
    assert effective(asked, device) == means


def test_precision_is_part_of_what_a_run_is() -> None:
    """As it was asked for: records of one command find each other, on whichever machine it runs."""
    cells = [smoke_cell("bc", precision=name) for name in ("auto", "float32", "bf16")]
    assert [cell.identity["precision"] for cell in cells] == ["auto", "float32", "bf16"]
    assert len({Run(cell, 0).identity_hash for cell in cells}) == 3
    assert smoke_cell("bc").identity == cells[0].identity, "auto is the default"
    assert replace(cells[0], precision="bf16").identity == cells[2].identity


def test_auto_is_one_run_on_both_devices() -> None:
    on_cpu, on_cuda = (
        make_plan(Request("bc", TINY, seeds="0", protocol="smoke", device=device), lambda: True).runs
        for device in ("cpu", "cuda")
    )
    assert [run.identity_hash for run in on_cpu] == [run.identity_hash for run in on_cuda]
