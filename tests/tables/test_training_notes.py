"""What the footnote says of recorded trajectories, of budgets by task, and of tuning."""

from __future__ import annotations

from typing import Any

import pytest
from helpers_records import endings, make_cell, make_counted, make_record

from lfobench.errors import UserError
from lfobench.record import Counts, Record, Tuning
from lfobench.tables.building import build_table

MADE = "generated, not read from published files. "
RECIPE: dict[str, Any] = {
    "offline": "suboptimal",
    "offline_trajectories": 50,
    "expert": "expert",
    "expert_trajectories": 15,
    "expert_transitions": None,
    "expert_actions": True,
    "equal_transitions": True,
}


def notes(records: list[Record]) -> dict[str, str]:
    return {note.label: note.text for note in build_table(records).notes}


def recorded(group: str = "few-trajectories", row: str = "safe-manipulation", **changes: Any) -> Record:
    return make_counted(endings(1, 2), group=group, row=row, recipe=RECIPE | changes)


def test_recorded_trajectories() -> None:
    assert notes([recorded()])["Source"] == (
        MADE + "Offline data: 50 suboptimal trajectories, cut to as many transitions as the expert part. "
        "Expert data, observations only: 15 expert trajectories. No row crosses an end."
    )
    assert notes([recorded(standardize=True)])["Source"].endswith(
        " No row crosses an end. Observations are standardised by the offline data's moments for every method."
    )


def test_transitions_in_random_order_and_a_hand_without_actions() -> None:
    found = recorded(expert="hand", expert_transitions=300, expert_actions=False, equal_transitions=False)
    assert notes([found])["Source"] == (
        MADE + "Offline data: 50 suboptimal trajectories. Expert data, observations only: "
        "300 transitions of 15 hand trajectories, in random order, recorded without actions. No row crosses an end."
    )


def test_groups_that_differ_are_told_apart() -> None:
    records = [
        recorded("few-trajectories"),
        recorded("fixed-start"),
        recorded("20-expert", "puck-striking", expert_trajectories=20),
    ]
    assert notes(records)["Source"].endswith(
        "observations only: 15 expert trajectories (few-trajectories, fixed-start); 20 expert trajectories "
        "(20-expert). No row crosses an end."
    )


def test_both_kinds_of_data_in_one_table() -> None:
    text = notes([recorded(), *make_cell([1.0, 2.0])])["Source"]
    assert "200 expert trajectories. Expert data: 1,000 rows, observations only. Offline data: 50 suboptimal" in text


def test_budgets_differ_by_task_and_the_final_evaluation_is_named() -> None:
    records = [
        make_counted(endings(1, 10), endings(50, 100)),
        make_counted(endings(1, 11), endings(50, 100), row="puck-striking", group="20-expert"),
    ]
    text = notes(records)["Protocol"]
    assert "every 1,000 steps an evaluation of 10 or 11 episodes" in text and "final evaluation of 100 episodes" in text
    assert "final" not in notes([recorded()])["Protocol"]


def test_one_task_is_evaluated_in_one_way() -> None:
    with pytest.raises(UserError, match=r"protocol\.further_episodes = 4 and bco with None"):
        build_table([make_counted(endings(1, 2), endings(1, 4)), make_counted(endings(1, 2), method="bco")])


def test_settings_may_come_from_the_task() -> None:
    record = make_counted(endings(1, 2), overrides={"discriminator_passes": 5})
    assert notes([record])["Set by protocol quick or task"] == "dilo: discriminator_passes = 5."


def test_the_module_that_registers_an_environment_is_not_part_of_its_name() -> None:
    record = make_counted(endings(1, 2))
    environment = record.identity["environment"] | {"id": "somewhere.registration:lfobench/SafeManipulation-v0"}
    text = notes([make_counted(endings(1, 2), environment=environment)])["Simulator"]
    assert text.endswith("; lfobench/SafeManipulation-v0.")


def test_the_arguments_of_an_environment_are_named_with_it() -> None:
    record = make_record(50.0)
    kitchen = record.identity["environment"] | {"id": "Kitchen-v1", "arguments": {"variant": "mixed", "goal": True}}
    text = notes([record, make_record(50.0, row="kitchen", environment=kitchen)])["Simulator"]
    assert text.endswith("; Hopper-v5, Kitchen-v1 (variant = mixed, goal = True).")


def test_files_are_named_and_what_is_generated_beside_them() -> None:
    record = make_record(50.0, source="files")
    files = {"offline": {"name": "mine", "sha256": "5" * 64}}
    named = record.model_copy(update={"provenance": record.provenance | {"data_files": files}})
    assert notes([named])["Source"].startswith("files (offline mine, expert generated). Offline data:")


def test_what_a_file_lacks_of_the_recipe_is_said() -> None:
    whole, short = make_record(50.0), make_record(50.0, row="walker2d")
    counts = Counts(offline_transitions=600, expert_trajectories=0, demonstration_rows=1000)
    text = notes([whole, short.model_copy(update={"counts": counts})])["Source"]
    assert text == (
        MADE + "Offline data: 600 of the recipe's 1,000,000 or 1,000,000 transitions and, with their actions, "
        "0 of the recipe's 200 or 200 expert trajectories. Expert data: 1,000 rows, observations only."
    )


def test_demonstrations_are_counted_as_the_recipe_does() -> None:
    recipe = dict(make_record(0.0).identity["recipe"])
    del recipe["demonstration_rows"]
    one, three = (make_record(50.0, row=f"row{n}", recipe=recipe | {"demonstrations": n}) for n in (1, 3))
    assert notes([one])["Source"].endswith("Expert data: 1 trajectory, observations only.")
    assert notes([three])["Source"].endswith("Expert data: 3 trajectories, observations only.")
    assert "Expert data: 1,000 rows or 3 trajectories," in notes([make_record(50.0), three])["Source"]
    counts = Counts(offline_transitions=10**6, expert_trajectories=200, demonstration_rows=80, demonstrations=2)
    lacking = notes([three.model_copy(update={"counts": counts})])["Source"]
    assert "Expert data: 2 of the recipe's 3 trajectories, observations only." in lacking


def test_methods_without_the_expert_s_trajectories_share_the_row_and_are_named() -> None:
    records = [make_record(50.0), make_record(40.0, "smodice", expert_joins=False)]
    text = notes(records)
    assert "200 expert trajectories (none for smodice, as their authors have it). " in text["Source"]
    assert "no expert trajectory. " in notes(records[1:])["Source"]


# --- tuning ----------------------------------------------------------------------------------------------------------


def tuned(value: float, group: str = "few-trajectories", seed: int = 0, method: str = "dilo", runs: int = 4) -> Record:
    tuning = Tuning(
        grid={"conservatism": [0.5, 0.6, 0.7, 0.8]},
        chosen={"conservatism": value},
        criterion="mean score over 20 validation starts",
        runs=runs,
        steps=runs * 3000,
    )
    config = {"batch_size": 256, "conservatism": value}
    return make_counted(
        endings(1, 2), group=group, seed=seed, method=method, tuning=tuning, tuned=tuning.chosen, config=config
    )


def test_tuning_is_stated_with_its_cost() -> None:
    assert notes([tuned(0.6, seed=seed) for seed in range(3)])["Tuned"] == (
        "dilo: conservatism from 0.5, 0.6, 0.7, 0.8 by mean score over 20 validation starts; chosen: "
        "conservatism = 0.6; 4 runs, 12,000 gradient steps. These runs and steps come on top of the table's."
    )
    assert "Tuned" not in notes([recorded()])


def test_choices_that_differ_by_task_are_named_and_every_search_is_counted_once() -> None:
    groups = ("few-trajectories", "fixed-start", "few-uniform")
    records = [tuned(0.8 if group == "few-uniform" else 0.6, group, seed) for group in groups for seed in range(2)]
    text = notes(records)["Tuned"]
    assert "chosen: conservatism = 0.6, but conservatism = 0.8 (safe-manipulation-few-uniform); " in text
    assert "12 runs, 36,000 gradient steps" in text


def test_who_was_not_tuned_is_named() -> None:
    records = [
        tuned(0.6),
        make_counted(endings(1, 2), group="fixed-start"),
        make_counted(endings(1, 2), method="bco"),
    ]
    text = notes(records)["Tuned"]
    assert "Not tuned: " in text and text.endswith("bco.")
    labels = [column.label for column in build_table(records).columns]
    assert labels == ["dilo(tuned)", "dilo", "bco"], "what was tuned is another way of running a method"


def test_a_tuned_method_has_one_column_whatever_was_chosen() -> None:
    records = [tuned(0.6), tuned(0.8, "fixed-start")]
    assert [column.label for column in build_table(records).columns] == ["dilo"]


def test_tuned_and_untuned_runs_of_one_task_stand_side_by_side() -> None:
    records = [tuned(0.6), make_counted(endings(1, 2)), make_counted(endings(1, 2), method="bco")]
    table = build_table(records)
    assert [column.label for column in table.columns] == ["dilo(tuned)", "dilo", "bco"]
    assert len(list(table.rows())) == 1
