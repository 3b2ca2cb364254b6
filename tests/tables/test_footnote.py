from __future__ import annotations

from collections.abc import Callable

from lfobench.record import Record, Warning
from lfobench.score import Statistic, parse_statistic
from lfobench.tables.building import build_table
from lfobench.tables.table import Table


def notes(records: list[Record], **options: object) -> dict[str, str]:
    return {note.label: note.text for note in build_table(records, **options).notes}  # type: ignore[arg-type]


def test_names_everything_a_reader_needs(example: list[Record]) -> None:
    text = notes(example)
    assert text["Source"].startswith("generated, not read from published files.")
    assert "1,000,000 transitions" in text["Source"]
    assert "200 expert trajectories" in text["Source"]
    assert text["Protocol"].startswith("paper: 300,000 or 500,000 gradient steps, batch size 256;")
    assert "every 5,000 steps an evaluation of 10 episodes" in text["Protocol"]
    assert "gymnasium 1.4.0, mujoco 3.3.7" in text["Simulator"]
    assert "Hopper-v5" in text["Simulator"]
    assert text["Seeds"] == "n = 3 per cell (seeds 0, 1, 2)."
    assert "mean of the last 5 evaluations" in text["Score"]
    assert "random and expert are fixed references (hopper 0 and 1,000; " in text["Score"]
    assert "methods without expert actions" in text["Highlighted"]
    assert "Welch's two-sided t-test" in text["Highlighted"]
    assert "p < 0.05" in text["Highlighted"]
    assert "Correction for multiple comparisons: none" in text["Highlighted"]
    assert text["Presets"] == "released."


def test_says_that_steps_were_assigned(make_cell: Callable[..., list[Record]]) -> None:
    protocol = {"name": "quick", "steps": 24_000, "evaluation_every": 1000, "evaluation_episodes": 10}
    records = make_cell([1.0, 2.0], protocol={**protocol, "steps_assigned": True})
    assert notes(records)["Protocol"].startswith("quick: 24,000 gradient steps (set with --steps), batch size 256;")


def test_names_the_precision_where_it_is_not_float32(make_cell: Callable[..., list[Record]]) -> None:
    records = make_cell([1.0, 2.0])
    assert "Precision" not in notes(records)
    on_a_gpu = {**records[0].provenance, "device": {"precision": "tf32"}}
    mixed = [records[0].model_copy(update={"provenance": on_a_gpu}), records[1]]
    assert notes(mixed)["Precision"] == "matrix products in float32 and tf32."


def test_states_what_a_method_wants_every_reader_to_know(make_cell: Callable[..., list[Record]]) -> None:
    records = make_cell([1.0, 2.0], stated=["tau"]) + make_cell([1.0, 2.0], "oril")
    assert notes(records)["Configured"] == "dilo: tau = 0.06."


def test_names_diverged_runs(example: list[Record]) -> None:
    assert "smodice on hopper-random-expert, seed 0 (step 12,000)" in notes(example)["Diverged"]


def test_names_missing_cells(example: list[Record]) -> None:
    assert "oril on halfcheetah-random-few-expert" in notes(example)["Missing"]


def test_says_nothing_of_what_did_not_happen(make_cell: Callable[..., list[Record]]) -> None:
    text = notes(make_cell([1.0, 2.0]) + make_cell([1.0, 2.0], "oril"))
    assert not {"Diverged", "Missing", "Set by hand", "Set by protocol quick", "Warning"} & set(text)


def test_unequal_n_is_said_and_named(make_cell: Callable[..., list[Record]]) -> None:
    text = notes(make_cell([1.0, 2.0, 3.0]) + make_cell([1.0, 2.0], "oril"))["Seeds"]
    assert text == "n = 2 to 3 per cell, unequal. Fewer than 3: oril on hopper-random-expert (2)."


def test_unequal_seeds_are_said(make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0, "dilo", 0), make_record(1.0, "dilo", 1)]
    records += [make_record(1.0, "oril", 0), make_record(1.0, "oril", 7)]
    assert "different seeds per cell" in notes(records)["Seeds"]


def test_one_seed_is_said_to_be_untestable(make_record: Callable[..., Record]) -> None:
    text = notes([make_record(9.0, "dilo"), make_record(1.0, "oril")])
    assert "cannot be tested" in text["Seeds"]
    assert "Not tested for want of a second seed, both highlighted: every row" in text["Highlighted"]


def test_a_method_alone_is_said_to_have_no_rival(make_cell: Callable[..., list[Record]]) -> None:
    assert "nothing highlighted: every row" in notes(make_cell([1.0, 2.0]))["Highlighted"]


def test_the_statistic_is_named_and_best_is_called_optimistic(make_cell: Callable[..., list[Record]]) -> None:
    assert "last evaluation" in notes(make_cell([1.0]), statistic=parse_statistic("last"))["Score"]
    assert "optimistic" in notes(make_cell([1.0]), statistic=parse_statistic("best"))["Score"]


def test_fewer_than_five_evaluations_are_said(make_cell: Callable[..., list[Record]]) -> None:
    assert "the shortest has 2" in notes(make_cell([1.0, 2.0], evaluations=2))["Score"]
    assert "shortest" not in notes(make_cell([1.0, 2.0], evaluations=2), statistic=parse_statistic("last"))["Score"]


def test_presets_are_named_per_method(make_record: Callable[..., Record]) -> None:
    text = notes([make_record(1.0), make_record(1.0, "oril", preset="paper"), make_record(1.0, "bco")])
    assert text["Presets"] == "released (dilo, bco), paper (oril)."


def test_fields_set_by_the_protocol_are_named_per_method(make_record: Callable[..., Record]) -> None:
    records = [
        make_record(1.0, overrides={"policy_learning_rate": 1e-3, "value_learning_rate": 3e-4}),
        make_record(1.0, "oril", overrides={"learning_rate": 1e-3}),
        make_record(1.0, "bco"),
    ]
    assert notes(records)["Set by protocol quick"] == (
        "dilo: policy_learning_rate = 0.001, value_learning_rate = 0.0003; oril: learning_rate = 0.001."
    )


def test_fields_set_by_hand_are_named_even_for_a_lone_column(make_record: Callable[..., Record]) -> None:
    assert notes([make_record(1.0, set={"tau": 3})])["Set by hand"] == "dilo: tau = 3."


def test_batch_sizes_are_named_per_method(make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0), make_record(1.0, "oril", config={"batch_size": 512})]
    assert "batch size 256 (dilo), batch size 512 (oril)" in notes(records)["Protocol"]


def test_simulators_that_differ_between_rows_are_all_named(make_record: Callable[..., Record]) -> None:
    records = [make_record(1.0), make_record(1.0, row="ant", simulator={"gymnasium": "1.4.0", "mujoco": "3.4.0"})]
    assert "mujoco 3.3.7 or 3.4.0" in notes(records)["Simulator"]


def test_warnings_of_runs_reach_the_reader_once(make_cell: Callable[..., list[Record]]) -> None:
    warning = Warning(what="The last layer is frozen.", remedy="Use --preset repaired.")
    records = make_cell([1.0, 2.0], warnings=[warning]) + make_cell([1.0, 2.0], "oril", warnings=[warning])
    warned = [note.text for note in build_table(records).notes if note.label == "Warning"]
    assert warned == ["The last layer is frozen. Use --preset repaired. (dilo, oril)"]


def test_failed_seeds_are_named_and_what_to_do(marked: Table) -> None:
    text = {note.label: note.text for note in marked.notes}
    assert text["Failed"] == (
        "!k marks k seeds that crashed and have no score; they are not in n: oril on walker2d-random-expert, seeds "
        "0, 1; dilo on ant-random-expert, seeds 3, 4. The command that made the table's records tries them again."
    )
    assert text["Seeds"] == (
        "n = 0 to 3 per cell, unequal. Fewer than 3: oril on walker2d-random-expert (0), dilo on "
        "walker2d-random-expert (1)."
    )


def test_the_demonstration_is_explained_and_never_missing(marked: Table) -> None:
    text = {note.label: note.text for note in marked.notes}
    assert text["Demonstration"] == "the score of the expert trajectory that the methods observe."
    assert "demonstration" not in text["Missing"]


def test_notes_stand_in_one_order(marked: Table) -> None:
    assert [note.label for note in marked.notes] == [
        "Score",
        "Source",
        "Protocol",
        "Simulator",
        "Seeds",
        "Highlighted",
        "†",
        "Presets",
        "Demonstration",
        "Diverged",
        "Failed",
        "Missing",
    ]


def test_a_step_is_named_with_its_thousands(make_cell: Callable[..., list[Record]]) -> None:
    assert notes(make_cell([1.0, 2.0]), statistic=Statistic("at", 3000))["Score"].endswith(
        "Each seed counts as the evaluation at step 3,000."
    )
