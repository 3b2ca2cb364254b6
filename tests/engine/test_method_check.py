"""The check of methods: right ones pass, and every broken rule is named."""

from __future__ import annotations

import re

import pytest
from helpers_methods import BROKEN, SOUND, Momentum, Reading, Replacing

from lfobench.contract.method import Method
from lfobench.engine.method_check import READS_BACK, SHAPES, Finding, check_method, require_sound
from lfobench.errors import UserError
from lfobench.registry import load_method, method_names


def broken(findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.problem and finding.fatal]


@pytest.mark.parametrize("method", SOUND)
def test_ordinary_modules_and_optimisers_keep_the_contract(method: type[Method]) -> None:
    findings = check_method(method)
    assert broken(findings) == []
    assert len(findings) == 10


@pytest.mark.parametrize("name", method_names())
def test_shipped_methods_keep_the_contract(name: str) -> None:
    assert [finding.problem for finding in check_method(load_method(name)) if finding.problem] == []


@pytest.mark.parametrize(("method", "rule", "word"), BROKEN, ids=[method.__name__ for method, _, _ in BROKEN])
def test_a_broken_rule_is_named(method: type[Method], rule: str, word: str) -> None:
    (finding,) = broken(check_method(method))
    assert re.search(rule, finding.rule), finding
    assert word in finding.problem
    with pytest.raises(UserError, match="breaks the rule"):
        require_sound(method, method.Config(), SHAPES)


def test_a_value_that_is_read_back_costs_time_and_is_no_fault() -> None:
    findings = {finding.rule: finding for finding in check_method(Reading)}
    assert broken(list(findings.values())) == []
    assert re.search(r"helpers_methods\.py:\d+", findings[READS_BACK].problem)
    assert not {finding.rule: finding for finding in check_method(Momentum)}[READS_BACK].problem
    replaced = {finding.rule: finding for finding in check_method(Replacing)}
    assert broken(list(replaced.values())) == []
    assert "'weight' is replaced" in replaced[READS_BACK].problem
