"""Errors of somebody else's code: the line of theirs that is to blame, not the library's that noticed."""

from __future__ import annotations

import json

import torch

from lfobench.errors import MOST_OWN_LINES, own_lines, unknown_name


def caught(level: int, layer: torch.nn.Module) -> BaseException:
    try:
        _down(level, layer)
    except Exception as error:
        return error
    raise AssertionError("it was to fail")


def _down(level: int, layer: torch.nn.Module) -> None:
    if level:
        _down(level - 1, layer)
    else:
        layer(torch.zeros(3))


def test_the_innermost_line_is_the_users_though_torch_raised() -> None:
    lines = own_lines(caught(0, torch.nn.Sequential(torch.nn.Linear(2, 2))))
    assert "test_errors.py:" in lines[-1] and lines[-1].endswith("in _down: layer(torch.zeros(3))")
    assert all("torch/nn" not in line for line in lines)


def test_the_innermost_lines_are_few() -> None:
    assert len(own_lines(caught(9, torch.nn.Linear(2, 2)))) == MOST_OWN_LINES


def test_where_nobody_else_was_there_is_no_line() -> None:
    try:
        json.loads("{")
    except ValueError as error:
        assert len(own_lines(error)) == 1  # this one
        assert own_lines(error.with_traceback(None)) == ()


def test_a_name_that_is_close_is_offered() -> None:
    assert "Did you mean 'dilo'?" in str(unknown_name("method", "dilp", ["dilo", "bc"]))
