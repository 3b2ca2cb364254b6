from __future__ import annotations

from dataclasses import replace

from helpers_engine import smoke_cell
from helpers_records import record_of

from lfobench.cells.cell import Run
from lfobench.records.folder import differences, explain


def test_reused() -> None:
    run = Run(smoke_cell("dilo"), 0)
    found = explain(run, [record_of(Run(run.cell, 1)), record_of(run)], {})
    assert found.reused
    assert found.differences == ()
    assert "reused" in found.headline
    assert found.identity == run.identity_hash


def test_reused_although_the_cache_holds_other_data() -> None:
    run = Run(smoke_cell("dilo"), 0)
    record = record_of(run).model_copy(update={"provenance": {"data_fingerprints": {"offline": "a1", "expert": "b2"}}})
    same = explain(run, [record], {"offline": "a1"})
    assert same.reused
    assert same.differences == ()
    other = explain(run, [record], {"offline": "a1", "expert": "c3"})
    assert other.reused
    assert other.headline != same.headline
    assert other.differences == ('data_fingerprints.expert: "b2" -> "c3"',)


def test_no_record_of_this_method_on_this_task() -> None:
    found = explain(Run(smoke_cell("dilo"), 0), [record_of(Run(smoke_cell("bc"), 0))], {})
    assert not found.reused
    assert "no record" in found.headline


def test_field_by_field() -> None:
    wanted = Run(smoke_cell("dilo", assignments=("dilo.tau=3",)), 0)
    found = explain(wanted, [record_of(Run(smoke_cell("dilo"), 0))], {})
    assert not found.reused
    assert set(found.differences) == {"config.tau: 0.06 -> 3.0", "set.tau: absent -> 3.0"}


def test_the_nearest_record_is_compared() -> None:
    cell = smoke_cell("dilo")
    far = Run(replace(smoke_cell("dilo", assignments=("dilo.tau=3",)), simulator={"mujoco": "0"}), 0)
    near = Run(smoke_cell("dilo", assignments=("dilo.tau=3",)), 0)
    found = explain(Run(cell, 0), [record_of(far), record_of(near)], {})
    assert near.identity_hash[:12] in found.headline
    assert all(line.startswith(("config.tau", "set.tau")) for line in found.differences)


def test_another_seed_is_the_only_difference() -> None:
    cell = smoke_cell("dilo")
    found = explain(Run(cell, 5), [record_of(Run(cell, 0))], {})
    assert found.differences == ("seed: 0 -> 5",)


def test_every_leaf_that_differs_is_named() -> None:
    record = {"a": {"b": 1, "c": [1, 2], "gone": None}, "same": 1}
    wanted = {"a": {"b": 2, "c": [1, 3], "new": True}, "same": 1}
    assert list(differences(record, wanted)) == [
        "a.b: 1 -> 2",
        "a.c: [1,2] -> [1,3]",
        "a.gone: null -> absent",
        "a.new: absent -> true",
    ]
    assert list(differences(record, record)) == []


def test_for_scripts() -> None:
    answer = explain(Run(smoke_cell("dilo"), 0), [], {}).as_json()
    assert set(answer) == {"run", "identity", "reused", "differences", "aside"}
