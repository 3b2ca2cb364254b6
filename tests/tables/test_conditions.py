from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.tables.building import build_table

PROTOCOL = {
    "name": "quick",
    "steps": 20_000,
    "steps_assigned": False,
    "evaluation_every": 1000,
    "evaluation_episodes": 10,
}


def test_sources_never_mix(make_record: Callable[..., Record]) -> None:
    with pytest.raises(UserError, match=r"d4rl and generated.*--source d4rl or --source generated"):
        build_table([make_record(1.0), make_record(1.0, "oril", source="d4rl")])


def test_protocols_never_mix(make_record: Callable[..., Record]) -> None:
    other = make_record(1.0, row="ant", protocol=PROTOCOL | {"name": "paper"})
    with pytest.raises(UserError, match=r"paper and quick.*--protocol paper or --protocol quick"):
        build_table([make_record(1.0), other])


@pytest.mark.parametrize("field", ["evaluation_every", "evaluation_episodes"])
def test_one_protocol_has_one_way_of_evaluating(field: str, make_record: Callable[..., Record]) -> None:
    other = make_record(1.0, row="ant", protocol=PROTOCOL | {field: 7})
    with pytest.raises(UserError, match=rf"'quick'.*{field} = 7 and 10"):
        build_table([make_record(1.0), other])


def test_tasks_may_differ_in_steps(make_record: Callable[..., Record]) -> None:
    other = make_record(1.0, row="ant", protocol=PROTOCOL | {"steps": 5})
    assert len(list(build_table([make_record(1.0), other]).rows())) == 2


@pytest.mark.parametrize(
    ("named", "identity"),
    [
        (
            r"simulator\.mujoco = 3\.3\.7 and oril with 3\.4\.0",
            {"simulator": {"gymnasium": "1.4.0", "mujoco": "3.4.0"}},
        ),
        (r"data\.expert = b2 and oril with c3", {"data": {"offline": "a1", "expert": "c3"}}),
        (r"protocol\.steps = 20000 and oril with 5\. Choose one with --steps,", {"protocol": PROTOCOL | {"steps": 5}}),
        (r"extra = None and oril with 1", {"extra": 1}),
    ],
)
def test_a_row_compares_like_with_like(
    named: str, identity: dict[str, Any], make_record: Callable[..., Record]
) -> None:
    with pytest.raises(UserError, match=named):
        build_table([make_record(1.0), make_record(1.0, "oril", **identity)])


def test_one_description_that_gave_different_data_is_not_one_task(make_record: Callable[..., Record]) -> None:
    one = make_record(1.0, fingerprints={"offline": "a1", "expert": "b2"})
    other = make_record(1.0, "oril", fingerprints={"offline": "a1", "expert": "c3"})
    with pytest.raises(UserError, match=r"dilo was run with data_fingerprints\.expert = b2 and oril with c3"):
        build_table([one, other])


def test_a_cell_never_averages_two_conditions(make_record: Callable[..., Record]) -> None:
    other = make_record(1.0, seed=1, simulator={"gymnasium": "1.4.0", "mujoco": "3.4.0"})
    with pytest.raises(UserError, match=r"hopper-random-expert.*simulator\.mujoco"):
        build_table([make_record(1.0), other])


def test_a_cell_never_averages_two_identities(make_record: Callable[..., Record]) -> None:
    other = make_record(1.0, seed=1, overrides={"tau": 0.06})
    with pytest.raises(UserError, match=r"dilo on hopper-random-expert.*overrides\.tau = None and with 0\.06"):
        build_table([make_record(1.0), other])


def test_a_seed_is_counted_once(make_record: Callable[..., Record]) -> None:
    with pytest.raises(UserError, match="dilo on hopper-random-expert has two records for seed 3"):
        build_table([make_record(1.0, seed=3), make_record(2.0, seed=3)])


def test_a_row_compares_one_precision(make_record: Callable[..., Record]) -> None:
    """`auto` is one thing to ask for, and not the same as asking for what it means."""
    one = make_record(1.0, precision="auto")
    for other in ("bf16", "float32"):
        with pytest.raises(UserError, match=rf"dilo was run with precision = auto and oril with {other}"):
            build_table([one, make_record(1.0, "oril", precision=other)])
        with pytest.raises(UserError, match=rf"hopper-random-expert.*precision = auto and .*{other}"):
            build_table([one, make_record(1.0, seed=1, precision=other)])
    assert len(list(build_table([one, make_record(1.0, "oril", precision="auto")]).rows())) == 1


def test_files_of_different_data_are_named(make_record: Callable[..., Record]) -> None:
    def of_file(name: str, seed: int, digit: str) -> Record:
        record = make_record(1.0, seed=seed, data={"offline": digit * 64, "expert": "b2"})
        files = {"offline": {"name": name, "sha256": digit * 64}}
        return record.model_copy(update={"provenance": {**record.provenance, "data_files": files}})

    with pytest.raises(UserError, match="offline data of dilo seed 0 and dilo seed 1 come from one and two"):
        build_table([of_file("one", 0, "a"), of_file("two", 1, "b")])
    with pytest.raises(UserError, match="two files named one, of different content"):
        build_table([of_file("one", 0, "a"), of_file("one", 1, "b")])
