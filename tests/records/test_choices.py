"""Choices from hand-made trials, on disk and back; trials are nobody's results."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers_engine import never, smoke_cell
from helpers_records import record_of

import lfobench
from lfobench.cells.cell import Assigned, Run
from lfobench.cells.plan import Request, make_plan
from lfobench.cells.tuning import Search, search_of
from lfobench.errors import UserError
from lfobench.record import Evaluation, Record
from lfobench.records.folder import RecordFolder, read_failures, write_failure
from lfobench.records.tuning import Choice, Trial, TuningFolder, best, choose, with_choices

TUNED = str(Path(__file__).parents[1] / "tuned_suite.py")
RANDOM, MEDIUM = "pole-random-expert", "pole-medium-expert"
LOW, HIGH = 5.0, 60.0
"""Returns that score 0 and 100 on the pole."""


def search(task: str = RANDOM, **request: Any) -> Search:
    found = search_of(smoke_cell("bc", task, TUNED, **request))
    assert found is not None
    return found


def trial(
    run: Run, last: float, *, diverged: bool = False, steps: int = 40, episodes: tuple[float, ...] | None = None
) -> Record:
    """Two evaluations; the last one's mean return as given."""
    returns = [last, last] if episodes is None else list(episodes)
    evaluations = [
        Evaluation(step=20, returns=[HIGH, HIGH], lengths=[1, 1]),
        Evaluation(step=40, returns=returns, lengths=[1, 1]),
    ]
    provenance = {"gradient_steps": steps, "packages": {"torch": "2"}}
    status = {"status": "diverged", "diverged_at": 40} if diverged else {}
    return record_of(run, evaluations=evaluations, provenance=provenance, **status)


def trials(found: Search, lasts: Sequence[Sequence[float]], diverged: Sequence[tuple[int, int]] = ()) -> Choice:
    """The choice among trials of those last returns, per combination and seed."""
    records = [
        [
            trial(Run(cell, seed), last, diverged=(index, seed) in diverged)
            for seed, last in enumerate(of_cell, start=1000)
        ]
        for index, (cell, of_cell) in enumerate(zip(found.trials(2), lasts, strict=True))
    ]
    return choose(found, 2, records)


# --- choosing --------------------------------------------------------------------------------------------------------


def test_the_best_mean_score_of_the_last_evaluation() -> None:
    """Scores: 100 (20 - 5) / 55 and 100 (40 - 5) / 55; the earlier evaluation, of 100 both times, counts nothing."""
    choice = trials(search(), [[20.0], [40.0]])
    assert choice.tuning.chosen == {"learning_rate": 1.0}
    assert [each.score for each in choice.trials] == pytest.approx([1500 / 55, 3500 / 55])
    assert choice.best == choice.trials[1]
    assert [each.values for each in choice.trials] == [{"learning_rate": 0.01}, {"learning_rate": 1.0}]


def test_episodes_and_seeds_are_averaged() -> None:
    found = search()
    one, other = found.trials(2)
    records = [
        [trial(Run(one, 1), 0.0, episodes=(5.0, 60.0)), trial(Run(one, 2), 5.0)],
        [trial(Run(other, 1), 32.0), trial(Run(other, 2), 32.0)],
    ]
    choice = choose(found, 2, records)
    assert choice.trials[0].scores == pytest.approx([50.0, 0.0])
    assert choice.trials[0].score == pytest.approx(25.0)
    assert choice.tuning.chosen == {"learning_rate": 1.0}
    assert choice.seeds == [1, 2]


def test_of_equal_ones_the_first_in_declared_order() -> None:
    assert trials(search(), [[30.0], [30.0]]).tuning.chosen == {"learning_rate": 0.01}
    assert trials(search(MEDIUM), [[9.0], [9.0], [30.0], [9.0], [30.0], [8.0]]).tuning.chosen == {
        "learning_rate": 0.01,
        "hidden": [4],
    }


def test_of_equal_ones_the_untuned_values_before_the_first() -> None:
    level = [Trial(values={"a": value, "b": 0}, scores=[5.0], diverged=[]) for value in (1, 5, 10)]
    assert best(level, {"a": 5, "b": 1}) is level[1]
    assert best(level, {"a": 7}) is level[0]
    better = Trial(values={"a": 1, "b": 0}, scores=[6.0], diverged=[])
    assert best([*level, better], {"a": 5, "b": 0}) is better
    rounded = Trial(values={"a": 5, "b": 0}, scores=[5.0 + 1e-9], diverged=[])
    assert best([level[0], rounded], {"a": 7}) is level[0], "rounding is no merit"


def test_a_diverged_trial_counts_0_and_loses_a_tie() -> None:
    choice = trials(search(), [[60.0], [6.0]], diverged=[(0, 1000)])
    assert choice.trials[0].scores == [0.0]
    assert choice.trials[0].diverged == [1000]
    assert choice.tuning.chosen == {"learning_rate": 1.0}
    tie = trials(search(), [[60.0], [LOW]], diverged=[(0, 1000)])
    assert [each.score for each in tie.trials] == [0.0, 0.0]
    assert tie.tuning.chosen == {"learning_rate": 1.0}


def test_the_budget_is_counted() -> None:
    found = search()
    records = [
        [trial(Run(cell, seed), 9.0, steps=steps) for seed, steps in ((1, 107), (2, 174))] for cell in found.trials(2)
    ]
    tuning = choose(found, 2, records).tuning
    assert (tuning.runs, tuning.steps) == (4, 2 * (107 + 174))
    assert tuning.grid == {"learning_rate": [0.01, 1.0]}
    assert (
        tuning.criterion == "mean score of the last evaluation over 2 validation starts and 2 seeds"
    )  # a record's text


def test_trials_of_an_earlier_search_are_paid_for_too(tmp_path: Path) -> None:
    found, folder = search(), TuningFolder(tmp_path)
    first = [[trial(Run(cell, 1), 9.0, steps=10)] for cell in found.trials(2)]
    more_starts = [[trial(Run(cell, 1), 9.0, steps=100)] for cell in found.trials(5)]
    another_field = Run(replace(found.cell, tuned={"hidden": [4]}, starts="validation"), 1)
    another_task = Run(search(MEDIUM).trials(2)[0], 1)
    for record in [record for members in [*first, *more_starts] for record in members]:
        cells = {Run(cell, 1).identity_hash: Run(cell, 1) for cell in [*found.trials(2), *found.trials(5)]}
        folder.trials.write(cells[record.identity_hash], record)
    for run in (another_field, another_task):
        folder.trials.write(run, trial(run, 9.0, steps=1000))
    tuning = choose(found, 5, more_starts, folder.all_trials(found)).tuning
    assert (tuning.runs, tuning.steps) == (5, 2 * 100 + 2 * 10 + 1000)


# --- on disk ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> TuningFolder:
    return TuningFolder(tmp_path / "runs")


def test_a_choice_comes_back_as_it_was(folder: TuningFolder) -> None:
    found = search(MEDIUM)
    choice = trials(found, [[9.0], [8.0], [7.0], [6.0], [30.0], [8.0]])
    path = folder.write(found, choice)
    assert path == folder.root / "tuning" / MEDIUM / f"bc-released-{found.hash[:12]}.json"
    assert folder.find(found) == choice
    assert list(path.parent.iterdir()) == [path]
    assert folder.find(search()) is None
    later = trials(found, [[9.0], [30.0], [7.0], [6.0], [5.0], [8.0]])
    assert folder.write(found, later) == path
    assert folder.find(found) == later


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"null", b"{}", b'{"seal": 1}', bytes(range(256)), b"[" * 100_000],
    ids=["empty", "half", "list", "null", "nothing", "foreign", "binary", "deep"],
)
def test_a_damaged_choice_is_named(folder: TuningFolder, content: bytes) -> None:
    found = search()
    path = folder.write(found, trials(found, [[20.0], [40.0]]))
    path.write_bytes(content)
    assert folder.find(found) is None
    assert str(path) in folder.problem(found)
    assert "damaged" in folder.problem(found)


def test_an_edited_choice_is_no_choice(folder: TuningFolder) -> None:
    found = search()
    path = folder.write(found, trials(found, [[20.0], [40.0]]))
    content = json.loads(path.read_text(encoding="utf-8"))
    content["tuning"]["chosen"] = {"learning_rate": 0.01}
    path.write_text(json.dumps(content), encoding="utf-8")
    assert folder.find(found) is None
    assert "edited" in folder.problem(found)


def test_a_choice_under_a_name_that_is_not_its_own_does_not_count(folder: TuningFolder) -> None:
    other = search(assigned=Assigned(30))
    written = folder.write(other, trials(other, [[20.0], [40.0]]))
    written.rename(folder.path(search()))
    assert folder.find(search()) is None


def test_the_nearest_choice_and_its_differences_are_named(folder: TuningFolder) -> None:
    far = search(assigned=Assigned(30), preset="paper")
    near = search(assigned=Assigned(30))
    for found in (far, near):
        folder.write(found, trials(found, [[20.0], [40.0]]))
    problem = folder.problem(search())
    assert str(folder.path(near)) in problem
    assert "protocol.steps: 30 -> 40" in problem
    assert "bc on pole-medium-expert" in folder.problem(search(MEDIUM))


# --- a plan with choices ---------------------------------------------------------------------------------------------


def request(methods: str = "bc,dilo", **fields: Any) -> Request:
    return Request(methods, TUNED, protocol="smoke", **fields)


def test_cells_with_a_grid_take_the_chosen_values(folder: TuningFolder) -> None:
    found = {task: search(task) for task in (RANDOM, MEDIUM)}
    choices = {
        RANDOM: trials(found[RANDOM], [[20.0], [40.0]]),
        MEDIUM: trials(found[MEDIUM], [[9.0], [8.0], [7.0], [6.0], [30.0], [8.0]]),
    }
    for task, choice in choices.items():
        folder.write(found[task], choice)
    plan = make_plan(request(), never)
    tuned = with_choices(plan, request(), folder)
    assert [(cell.task.name, cell.method.name, dict(cell.tuned)) for cell in tuned.cells] == [
        (RANDOM, "bc", {"learning_rate": 1.0}),
        (RANDOM, "dilo", {}),
        (MEDIUM, "bc", {"learning_rate": 0.02, "hidden": [16, 16]}),
        (MEDIUM, "dilo", {}),
    ]
    assert [cell.tuning for cell in tuned.cells] == [choices[RANDOM].tuning, None, choices[MEDIUM].tuning, None]
    assert [each for each in tuned.cells if each.method.name == "dilo"] == [
        each for each in plan.cells if each.method.name == "dilo"
    ]


def test_what_is_set_stays_over_the_choice(folder: TuningFolder) -> None:
    found = search(MEDIUM)
    folder.write(found, trials(found, [[9.0], [8.0], [7.0], [6.0], [30.0], [8.0]]))
    assigned = request("bc", tasks=MEDIUM, assignments=("bc.learning_rate=0.25",))
    (cell,) = with_choices(make_plan(assigned, never), assigned, folder).cells
    assert cell.config.learning_rate == 0.25  # type: ignore[attr-defined]
    assert cell.identity["set"] == {"learning_rate": 0.25}
    assert cell.identity["tuned"] == {"hidden": [16, 16]}


def test_where_everything_is_set_nothing_need_be_chosen(folder: TuningFolder) -> None:
    assigned = request("bc", tasks=RANDOM, assignments=("bc.learning_rate=0.25",))
    plan = make_plan(assigned, never)
    assert with_choices(plan, assigned, folder) == plan


def test_missing_choices_name_the_command(folder: TuningFolder) -> None:
    found = search()
    folder.write(found, trials(found, [[20.0], [40.0]]))
    wanted = request("bc,bco,dilo")
    with pytest.raises(UserError) as refused:
        with_choices(make_plan(wanted, never), wanted, folder)
    assert all(fact in refused.value.problem for fact in (f"bco on {RANDOM}", str(folder.root), "2 choices"))
    assert "lfobench tune --methods bco,bc --suite " in refused.value.remedy
    assert "\n" not in str(refused.value)


def test_nothing_to_tune_is_a_mistake(folder: TuningFolder) -> None:
    with pytest.raises(UserError, match=r"grid.*Leave out --tuned.*lfobench tune"):
        with_choices(make_plan(request("dilo"), never), request("dilo"), folder)


# --- trials are no results -------------------------------------------------------------------------------------


def test_results_are_read_without_trials(folder: TuningFolder) -> None:
    found = search()
    results, run = RecordFolder(folder.root), Run(found.cell, 0)
    record = record_of(run)
    results.write(run, record)
    for cell in found.trials(2):
        folder.trials.write(Run(cell, 1000), trial(Run(cell, 1000), 9.0))
        write_failure(folder.trials, Run(cell, 1001), "gone", "")
    folder.write(found, trials(found, [[20.0], [40.0]]))
    for outer in (folder.root, folder.root.parent):
        read = RecordFolder(outer).read_all()
        assert (read.records, read.warnings) == ([record], [])
        assert read_failures(RecordFolder(outer), read.records) == ([], [])
        assert set(lfobench.load(outer)["identity"]) == {run.identity_hash}


def test_a_trial_among_results_is_named_and_skipped(folder: TuningFolder) -> None:
    cell = search().trials(2)[0]
    results = RecordFolder(folder.root)
    path = results.write(Run(cell, 1000), trial(Run(cell, 1000), 9.0))
    read = results.read_all()
    assert read.records == []
    (warning,) = read.warnings
    assert str(path) in warning.what
    assert "lfobench tune" in warning.what
    with pytest.warns(UserWarning, match="lfobench tune"):
        assert lfobench.load(folder.root).empty


def test_a_task_of_the_folders_name_keeps_its_results(tmp_path: Path) -> None:
    cell = smoke_cell("bc", RANDOM, TUNED)
    run = Run(replace(cell, task=replace(cell.task, name="tuning")), 0)
    folder = RecordFolder(tmp_path / "tuning")
    folder.write(run, record_of(run))
    assert [record.task for record in folder.read_all().records] == ["tuning"]


def test_the_trials_of_a_search_are_found_when_all_are_there(folder: TuningFolder) -> None:
    found = search()
    runs = [Run(cell, seed) for cell in found.trials(2) for seed in (7, 8)]
    for run in runs:
        assert folder.trial_records(found, 2, (7, 8)) is None
        folder.trials.write(run, trial(run, 9.0))
    records = folder.trial_records(found, 2, (7, 8))
    assert records is not None
    assert [[record.identity_hash for record in members] for members in records] == [
        [run.identity_hash for run in runs[:2]],
        [run.identity_hash for run in runs[2:]],
    ]
    assert folder.trial_records(found, 3, (7, 8)) is None, "of other starts"
