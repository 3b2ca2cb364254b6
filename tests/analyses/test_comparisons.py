"""Which cells are compared, what forbids it, and how the outcome is drawn."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from typing import Any

import pytest
from helpers_folders import with_provenance
from helpers_records import make_cell, make_record
from rich.console import Console

from lfobench.analyses.compare import (
    Compared,
    NamedRuns,
    Pairing,
    compare,
    pair_folders,
    pair_methods,
    summary,
    warnings_of,
)
from lfobench.analyses.compare_formats import document, json_comparison
from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.score import HEADLINE
from lfobench.stats.highlight import Rule

HOPPER = ("hopper-random-expert", "dilo")
RULE = Rule(correction="holm")
GOOD, BAD = [100.0, 101.0, 99.0], [50.0, 51.0, 49.0]


def folders(before: Sequence[Record], after: Sequence[Record], allowed: Sequence[str] = ()) -> Pairing:
    return pair_folders(NamedRuns("before", "A", before), NamedRuns("after", "B", after), HEADLINE, allowed=allowed)


def judged(before: Sequence[Record], after: Sequence[Record], rule: Rule = RULE, **options: Any) -> Compared:
    return compare(folders(before, after, **options), rule, HEADLINE)


def methods(records: Sequence[Record], first: str = "dilo", second: str = "smodice") -> Compared:
    return compare(pair_methods(records, [], first, second, HEADLINE), RULE, HEADLINE)


def draw(compared: Compared, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(document(compared))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def note(compared: Compared, label: str) -> str:
    return next(each["text"] for each in json.loads(json_comparison(compared))["notes"] if each["label"] == label)


# --- two methods -----------------------------------------------------------------------------------------------------


def two_methods() -> list[Record]:
    return [
        *make_cell(GOOD),
        *make_cell(BAD, "smodice"),
        *make_cell([60.0, 70.0], row="walker2d"),
        *make_cell([62.0, 66.0], "smodice", row="walker2d"),
        *make_cell([1.0, 2.0], row="ant"),
    ]


def test_methods_are_compared_on_the_tasks_of_both() -> None:
    compared = methods(two_methods())
    assert summary(compared) == "dilo against smodice: better on 1 task, worse on 0, undecided on 1"
    assert compared.pairing.only_subject == (("ant-random-expert", ""),)
    assert "Only in dilo" in draw(compared)
    assert warnings_of(compared) == []


def test_the_other_way_round_it_is_worse() -> None:
    compared = methods(two_methods(), "smodice", "dilo")
    assert summary(compared).startswith("smodice against dilo: better on 0 tasks, worse on 1")
    assert not compared.regressed


def test_variants_of_a_method_are_named_by_their_column() -> None:
    records = [*make_cell(GOOD), *make_cell(BAD, preset="paper")]
    assert methods(records, "dilo:released", "dilo:paper").having("better") == [("hopper-random-expert", "")]
    with pytest.raises(UserError, match="'dilo:released' or 'dilo:paper'"):
        methods([*records, *make_cell(BAD, "smodice")])


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [("dilo", "smo", "Did you mean 'smodice'"), ("dilo", "dilo", "same records"), ("x1", "dilo", "Unknown method")],
)
def test_names_that_do_not_do(first: str, second: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        methods(two_methods(), first, second)


def test_methods_without_a_common_task() -> None:
    with pytest.raises(UserError, match="no cell in common"):
        methods([*make_cell(GOOD), *make_cell(BAD, "smodice", row="ant")])


def test_methods_under_other_conditions() -> None:
    with pytest.raises(UserError, match="simulator"):
        methods([*make_cell(GOOD), *make_cell(BAD, "smodice", simulator={"gymnasium": "2", "mujoco": "3.3.7"})])


# --- two folders -----------------------------------------------------------------------------------------------------


def test_a_regression_is_found_in_the_cell_where_it_is() -> None:
    before = [*make_cell(GOOD), *make_cell([40.0, 60.0], "bc")]
    after = [*make_cell(BAD, method_version=2), *make_cell([41.0, 62.0], "bc", method_version=2)]
    compared = judged(before, after)
    assert compared.regressed
    assert compared.having("worse") == [HOPPER]
    assert summary(compared) == "B against A: worse on 1 cell, undecided on 1, better on 0"
    assert not judged(after, before).regressed


def test_the_same_runs_are_identical_and_not_tested() -> None:
    same = [*make_cell(GOOD), *make_cell([40.0, 60.0], "bc")]
    compared = judged(same, list(reversed(same)))
    assert compared.having("identical") == list(compared.pairing.pairs)
    assert not compared.regressed
    assert warnings_of(compared) == []
    assert summary(compared).endswith("identical 2")


def test_identical_cells_take_no_part_in_the_correction() -> None:
    changed = [make_cell([60.0, 64.0, 66.0]), make_cell([50.0, 53.0, 56.0], method_version=2)]
    alone = judged(changed[0], changed[1])
    same = [record for row in ("a", "b", "c", "d") for record in make_cell(GOOD, row=row)]
    beside = judged([*changed[0], *same], [*changed[1], *same])
    assert len(beside.having("identical")) == 4
    # The label alone differs: beside records of version 1, version 2 is named.
    assert list(beside.contrast.cells.values()) == list(alone.contrast.cells.values())


def test_one_more_seed_is_not_identical() -> None:
    before = make_cell(GOOD)
    (pair,) = folders(before, [*before, make_record(98.0, seed=3)]).pairs.values()
    assert (pair.identical_runs, pair.identical) == (3, False)
    assert "3 of 4" in note(judged(before, [*before, make_record(98.0, seed=3)]), "Identical runs")


def test_one_identity_with_other_numbers_is_named() -> None:
    compared = judged(make_cell(GOOD), make_cell(BAD))
    assert compared.pairing.pairs[HOPPER].changed_runs == 3
    assert "one identity, other numbers" in note(compared, "Changed runs")


def test_software_may_differ_and_is_listed() -> None:
    after = make_cell(GOOD, method_version=2, config={"batch_size": 512, "tau": 0.06}, schema=2)
    found = {each.field: each for each in folders(make_cell(GOOD), after).differences}
    assert set(found) == {"method_version", "config.batch_size", "schema"}
    assert (found["config.batch_size"].reference, found["config.batch_size"].subject) == ("256", "512")
    assert found["method_version"].cells == ("dilo on hopper-random-expert",)
    text = note(judged(make_cell(GOOD), after), "Software differ")
    assert "config.batch_size: 256 → 512 (every cell)" in text


PROTOCOL = make_record(0.0).identity["protocol"]


@pytest.mark.parametrize(
    ("changes", "field", "flags"),
    [
        ({"simulator": {"gymnasium": "1.4.0", "mujoco": "9"}}, "simulator.mujoco", ["simulator.mujoco"]),
        ({"simulator": {"gymnasium": "9", "mujoco": "9"}}, "simulator.gymnasium", ["simulator"]),
        ({"source": "minari"}, "source", ["source"]),
        ({"protocol": {**PROTOCOL, "steps": 7}}, "protocol.steps", ["protocol.steps"]),
        ({"precision": "bf16"}, "precision", ["precision"]),
        ({"data": {"offline": "c3", "expert": "b2"}}, "data.offline", ["data.offline"]),
        ({"fingerprints": {"offline": "f" * 64}}, "data_fingerprints.offline", ["data_fingerprints.offline"]),
        ({"recipe": {**make_record(0.0).identity["recipe"], "expert_trajectories": 5}}, "recipe.expert", ["recipe"]),
        ({"something_new": 1}, "something_new", ["something_new"]),
    ],
)
def test_other_conditions_are_refused_by_name_and_may_be_allowed(
    changes: dict[str, Any], field: str, flags: list[str]
) -> None:
    before, after = make_cell(GOOD), make_cell(BAD, **changes)
    with pytest.raises(UserError, match=field) as refused:
        folders(before, after)
    for flag in flags:
        assert f"--allow {flag}" in str(refused.value)
    compared = judged(before, after, allowed=flags)
    assert compared.regressed
    assert field in note(compared, "Conditions differ")


def test_allowing_one_condition_allows_no_other() -> None:
    after = make_cell(BAD, source="minari", simulator={"gymnasium": "9", "mujoco": "3.3.7"})
    with pytest.raises(UserError, match="simulator") as refused:
        folders(make_cell(GOOD), after, ["source"])
    assert "--allow source" not in str(refused.value)
    with pytest.raises(UserError, match="simulator"):
        folders(make_cell(GOOD), after, ["source", "simulator.gym"])
    assert folders(make_cell(GOOD), after, ["source", "simulator.gymnasium"]).pairs


def test_an_allowed_field_that_no_record_has() -> None:
    with pytest.raises(UserError, match="Did you mean 'simulator'"):
        folders(make_cell(GOOD), make_cell(BAD), ["simulatr"])


def test_machines_may_differ_and_are_listed() -> None:
    before = [with_provenance(record, packages={"torch": "1"}, device={"type": "cpu"}) for record in make_cell(GOOD)]
    after = [with_provenance(record, packages={"torch": "2"}, device={}) for record in make_cell(GOOD)]
    found = {(each.field, each.reference, each.subject) for each in folders(before, after).differences}
    assert found == {("packages.torch", "1", "2"), ("device.type", "cpu", "none")}


def test_a_vanished_cell_is_a_warning_and_no_regression() -> None:
    before = [*make_cell(GOOD), *make_cell(GOOD, "bc"), *make_cell(GOOD, row="ant")]
    compared = judged(before, [*make_cell(GOOD), *make_cell(GOOD, row="walker2d")])
    assert set(compared.pairing.only_reference) == {("hopper-random-expert", "bc"), ("ant-random-expert", "dilo")}
    assert compared.pairing.only_subject == (("walker2d-random-expert", "dilo"),)
    assert not compared.regressed
    (warning,) = warnings_of(compared)
    assert "bc on hopper-random-expert" in warning.what


def test_other_presets_and_options_are_other_cells() -> None:
    before = [*make_cell(GOOD), *make_cell(GOOD, preset="paper"), *make_cell(GOOD, "bc", set={"tau": 1})]
    after = [*make_cell(GOOD), *make_cell(GOOD, "bc", set={"tau": 2})]
    pairing = folders(before, after)
    assert list(pairing.pairs) == [("hopper-random-expert", "dilo:released")]
    assert {label for _, label in (*pairing.only_reference, *pairing.only_subject)} == {
        "dilo:paper",
        "bc(tau=1)",
        "bc(tau=2)",
    }


def test_no_common_cell() -> None:
    with pytest.raises(UserError, match=r"before.* no cell in common.*dilo on ant"):
        folders(make_cell(GOOD), make_cell(GOOD, row="ant"))


def test_a_folder_with_two_versions_of_a_cell() -> None:
    with pytest.raises(UserError, match=r"before holds dilo on hopper-random-expert in two versions"):
        folders([*make_cell(GOOD), *make_cell(GOOD, method_version=2)], make_cell(GOOD))


def test_a_folder_that_mixes_protocols_is_named() -> None:
    with pytest.raises(UserError, match=r"after: .*--protocol"):
        folders(
            make_cell(GOOD), [*make_cell(GOOD), *make_cell(GOOD, row="ant", protocol={**PROTOCOL, "name": "smoke"})]
        )


# --- what is said ----------------------------------------------------------------------------------------------------


def test_single_seeds_are_untested_and_the_gate_says_that_it_sees_nothing() -> None:
    compared = judged(make_cell([100.0]), make_cell([5.0], method_version=2))
    assert not compared.regressed
    text = draw(compared)
    assert "untested (1)" in text
    (warning,) = warnings_of(compared)
    assert "no cell has two seeds" in warning.what


def test_a_design_that_cannot_reach_significance_is_said() -> None:
    compared = judged(make_cell(GOOD), make_cell(BAD, method_version=2), Rule(test="permutation", correction="holm"))
    assert compared.having("undecided") == [HOPPER]
    (warning,) = warnings_of(compared)
    assert "with 3 against 3 seeds" in warning.what and "p = 0.1" in warning.what
    assert "cannot find anything" in note(compared, "Design")


def test_without_spread() -> None:
    compared = judged(make_cell([5.0, 5.0]), make_cell([4.0, 4.0], method_version=2))
    assert compared.having("worse") == [HOPPER]
    assert "-1.0 [-1.0, -1.0]" in draw(compared)


@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_a_level_at_which_nothing_is_open(alpha: float) -> None:
    with pytest.raises(UserError, match="--alpha"):
        judged(make_cell(GOOD), make_cell(BAD), Rule(alpha=alpha))


def test_start_states_that_do_not_pair() -> None:
    longer = [
        record.model_copy(
            update={
                "evaluations": [
                    each.model_copy(update={"returns": [1.0] * 3, "lengths": [1] * 3}) for each in record.evaluations
                ]
            }
        )
        for record in make_cell(BAD, method_version=2)
    ]
    with pytest.raises(UserError, match="--test"):
        judged(make_cell(GOOD), longer, Rule(test="paired-t"))


def test_uncorrected_says_what_to_expect() -> None:
    rows = [f"task{index}" for index in range(4)]
    before = [record for row in rows for record in make_cell([1.0, 5.0], row=row)]
    after = [record for row in rows for record in make_cell([2.0, 5.0], row=row, method_version=2)]
    assert "0.2 are expected" in note(judged(before, after, Rule()), "Verdicts")
    assert "Holm over the 4 cells" in note(judged(before, after), "Verdicts")


def test_worse_stands_first_and_diverged_seeds_are_marked() -> None:
    rows = {"ant": BAD, "hopper": [100.0, 101.0, 98.0], "walker2d": [200.0, 201.0, 202.0]}
    before = [record for row in rows for record in make_cell(GOOD, row=row)]
    after = [record for row, scores in rows.items() for record in make_cell(scores, row=row, method_version=2)]
    after.append(make_record(1.0, row="hopper", seed=3, method_version=2, diverged_at=9))
    text = draw(judged(before, after))
    places = [text.index(word) for word in ("worse (1)", "dilo on ant", "undecided (1)", "✗1", "better (1)")]
    assert places == sorted(places)
    assert "3, 4" in text


@pytest.mark.parametrize("width", [40, 60, 80, 100, 200])
def test_every_number_is_there_at_every_width(width: int) -> None:
    compared = methods(two_methods())
    text = draw(compared, width)
    for part in ("hopper-random-expert", "100.0 ± 1.0", "50.0 ± 1.0", "+50.0"):
        assert part in text
    assert all(len(line) <= width for line in text.splitlines())


def test_json_holds_everything() -> None:
    before = [*make_cell(GOOD), *make_cell(GOOD, "bc")]
    compared = judged(before, make_cell(BAD, method_version=2))
    value = json.loads(json_comparison(compared))
    assert (value["regressed"], value["counts"]["worse"], value["rule"]["correction"]) == (True, 1, "holm")
    (cell,) = value["cells"]
    assert (cell["task"], cell["column"], cell["verdict"]) == (*HOPPER, "worse")
    assert cell["difference"] == pytest.approx(-50.0)
    assert cell["interval"]["low"] < -50.0 < cell["interval"]["high"]
    assert cell["subject"]["scores"] == pytest.approx(BAD)
    assert value["only_in_reference"] == [{"task": "hopper-random-expert", "column": "bc", "every_seed_crashed": False}]
    assert value["aggregate"]["probability_of_improvement"]["value"] == 0.0
    assert [each["field"] for each in value["differences"]] == ["method_version"]
