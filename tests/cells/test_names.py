from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lfobench.cells.names import MAX_SEED, chosen_tasks, parse_assignments, parse_seeds, select_tasks, split_names
from lfobench.errors import UserError
from lfobench.registry import load_suite

TASKS = load_suite("locomotion").tasks


@pytest.mark.parametrize(
    ("text", "seeds"),
    [
        ("0", [0]),
        ("0-6", [0, 1, 2, 3, 4, 5, 6]),
        ("3, 1", [3, 1]),
        (" 2 - 4 ,9", [2, 3, 4, 9]),
        ("1,1-2,2", [1, 2]),
        ("5-5", [5]),
        (str(MAX_SEED), [MAX_SEED]),
    ],
)
def test_seeds(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "x", "0-", "-3", "3-1", "1.5", "0,,1", "0-1-2", "1 2", "0x1", "all", "٣"])
def test_what_is_not_a_list_of_seeds(text: str) -> None:
    with pytest.raises(UserError, match=r"is not a list of seeds.*--seeds 0-6"):
        parse_seeds(text)


@pytest.mark.parametrize("text", ["0-99999999", str(MAX_SEED + 1), "9" * 5000, "0-" + "9" * 5000])
def test_seeds_out_of_range(text: str) -> None:
    with pytest.raises(UserError, match=r"is out of range: a seed is at most 4294967295, a range at most 10,000"):
        parse_seeds(text)


@given(st.lists(st.tuples(st.integers(0, 5_000), st.integers(0, 20)), min_size=1, max_size=6))
def test_ranges_mean_all_their_numbers(ranges: list[tuple[int, int]]) -> None:
    text = ",".join(f"{first}-{first + more}" for first, more in ranges)
    wanted = [seed for first, more in ranges for seed in range(first, first + more + 1)]
    assert parse_seeds(text) == list(dict.fromkeys(wanted))


@given(st.text(max_size=12))
def test_any_text_is_seeds_or_a_users_mistake(text: str) -> None:
    try:
        seeds = parse_seeds(text)
    except UserError as mistake:
        assert "\n" not in str(mistake).replace(text, "")
    else:
        assert seeds
        assert all(0 <= seed <= MAX_SEED for seed in seeds)


@given(st.lists(st.sampled_from(["dilo", "bc", "bc-expert"]), max_size=6))
def test_names_keep_their_order_and_appear_once(names: list[str]) -> None:
    assert split_names(" , ".join(names)) == list(dict.fromkeys(names))


@pytest.mark.parametrize(
    ("patterns", "count"),
    [
        (["*"], 16),
        (["hopper-*"], 4),
        (["*-random-*"], 8),
        (["ant-random-expert"], 1),
        (["hopper-*", "hopper-random-expert"], 4),
        (["hopper-random-expert", "ant-*"], 5),
        (["[hw]*-medium-few-expert"], 3),
    ],
)
def test_globs_over_tasks(patterns: list[str], count: int) -> None:
    chosen = select_tasks(TASKS, patterns)
    assert len(chosen) == count
    assert chosen == [task for task in TASKS if task in chosen], "suite order, whatever was typed first"


def test_a_glob_that_matches_nothing() -> None:
    with pytest.raises(UserError, match=r"Unknown task 'hoper-random-expert'.*Did you mean 'hopper-random-expert'"):
        select_tasks(TASKS, ["ant-*", "hoper-random-expert"])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("0.5", 0.5),
        ("none", None),
        ("null", None),
        ("True", True),
        ("false", False),
        ("[64, 64]", [64, 64]),
        ("gaussian", "gaussian"),
        ("a=b", "a=b"),
        ("", ""),
        ("1e-3", 1e-3),
    ],
)
def test_values_of_assignments(text: str, value: object) -> None:
    found = parse_assignments([f"dilo.field={text}"], ["dilo"])
    assert found == {"dilo": {"field": value}}
    assert type(found["dilo"]["field"]) is type(value)


def test_assignments_of_several_methods() -> None:
    found = parse_assignments(["dilo.tau=3", "bc-expert.hidden=[8]", "dilo.tau=4"], ["dilo", "bc-expert"])
    assert found == {"dilo": {"tau": 4}, "bc-expert": {"hidden": [8]}}


@pytest.mark.parametrize("text", ["tau=3", "dilo.tau", "dilo tau=3", ".tau=3", "dilo.=3", "dilo.tau.x=3", "="])
def test_malformed_assignments(text: str) -> None:
    with pytest.raises(UserError, match=r"is not METHOD\.FIELD=VALUE.*--set dilo.tau=3"):
        parse_assignments([text], ["dilo"])


def test_an_assignment_to_a_method_that_does_not_run() -> None:
    with pytest.raises(UserError, match=r"Unknown method in --set 'dillo'.*Did you mean 'dilo'"):
        parse_assignments(["dillo.tau=3"], ["dilo", "bc"])


@given(
    st.from_regex(r"[a-z]{1,5}", fullmatch=True), st.one_of(st.integers(), st.floats(allow_nan=False), st.booleans())
)
def test_numbers_and_flags_survive(field: str, value: float | bool) -> None:
    import json

    assert parse_assignments([f"bc.{field}={json.dumps(value)}"], ["bc"]) == {"bc": {field: value}}


def test_a_task_of_another_suite_is_said_to_be_there() -> None:
    locomotion = load_suite("locomotion")
    with pytest.raises(
        UserError, match=r"Task .pen-human-expert. is not in suite .locomotion.\. It is in: --suite adroit"
    ):
        chosen_tasks(locomotion, "hopper-*,pen-human-expert")
    with pytest.raises(UserError, match="Unknown task 'pen-humn-expert'"):
        chosen_tasks(locomotion, "pen-humn-expert")
    assert chosen_tasks(locomotion, None) == list(locomotion.tasks)
