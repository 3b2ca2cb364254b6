"""A job from data to records: seeds, divergence, interruption, other processes, a disk that refuses."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers_engine import (
    HOPPER_TASK,
    SMOKE,
    Drifting,
    Silent,
    StopAfter,
    cell_of,
    finish,
    make_job,
    records_of,
    smoke_cell,
)

from lfobench.cells.cell import Cell
from lfobench.contract.method import DataNeeds, Stage
from lfobench.engine import checkpoint
from lfobench.engine import job as engine_job
from lfobench.engine.job import Busy, Job, Recorded, run_job
from lfobench.engine.training import Advance
from lfobench.errors import UserError
from lfobench.records.folder import RecordFolder
from lfobench.registry import method_names

Measured = dict[str, Any]


def measured(job: Job) -> list[Measured]:
    return [record.measured() for record in records_of(job)]


def hopper_cell(name: str) -> Cell:
    return smoke_cell(name, HOPPER_TASK, "locomotion")


# --- seeds -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", method_names())
def test_seed_three_alone_is_seed_three_among_seven(name: str, tmp_path: Path, shared_cache: Path) -> None:
    """Decision 1's guarantee, through the whole engine, on the real simulator."""
    together = make_job(hopper_cell(name), range(7), tmp_path / "together", shared_cache)
    alone = make_job(hopper_cell(name), [3], tmp_path / "alone", shared_cache)
    finish(together)
    finish(alone)
    records = measured(together)
    assert measured(alone) == [records[3]]
    returns = [record["evaluations"][-1]["returns"] for record in records]
    assert len({tuple(row) for row in returns}) > 1, "seeds differ"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dilo", "smodice"])
def test_order_and_company_of_seeds_do_not_matter(name: str, tmp_path: Path, shared_cache: Path) -> None:
    one = make_job(smoke_cell(name), [5, 0, 9], tmp_path / "one", shared_cache)
    two = make_job(smoke_cell(name), [9, 5], tmp_path / "two", shared_cache)
    finish(one)
    finish(two)
    assert measured(two) == [measured(one)[2], measured(one)[0]]


# --- records ---------------------------------------------------------------------------------------------------------


def test_a_record_holds_every_episode_of_every_evaluation(tmp_path: Path, shared_cache: Path) -> None:
    cell = cell_of(Drifting, replace(SMOKE, steps=25, evaluation_every=10, evaluation_episodes=3))
    job = make_job(cell, [0, 1], tmp_path, shared_cache)
    events = finish(job)
    for record in records_of(job):
        assert [evaluation.step for evaluation in record.evaluations] == [10, 20, 25], "the last step is evaluated"
        assert all(len(evaluation.returns) == len(evaluation.lengths) == 3 for evaluation in record.evaluations)
        assert [(row.stage, row.step) for row in record.metrics] == [
            ("warm-up", 7),
            ("drift", 10),
            ("drift", 20),
            ("drift", 25),
        ]
        assert record.status == "finished"
        assert record.provenance["data_fingerprints"].keys() == {"offline", "expert"}
        assert record.provenance["packages"]["mujoco"]
    recorded = [event for event in events if isinstance(event, Recorded)]
    assert [event.path for event in recorded] == [RecordFolder(tmp_path).path(run) for run in job.runs]
    advances = [event for event in events if isinstance(event, Advance)]
    assert [event.done for event in advances] == sorted(event.done for event in advances)
    assert advances[-1].done == advances[-1].total == 32
    assert advances[-1].score is not None


def test_metrics_are_means_since_the_last_row(tmp_path: Path, shared_cache: Path) -> None:
    """Split evaluations average to the joint one: (10 m1 + 10 m2 + 5 m3) / 25 = m."""

    def rows(every: int, out: str) -> list[float]:
        cell = cell_of(Drifting, replace(SMOKE, steps=25, evaluation_every=every))
        job = make_job(cell, [4], tmp_path / out, shared_cache)
        finish(job)
        found = [row.values["drift"] for row in records_of(job)[0].metrics if row.stage == "drift"]
        assert None not in found
        return [value for value in found if value is not None]

    first, second, third = rows(10, "split")
    (whole,) = rows(25, "whole")
    assert math.isclose((10 * first + 10 * second + 5 * third) / 25, whole, rel_tol=1e-5)


def test_a_method_may_report_no_metric(tmp_path: Path, shared_cache: Path) -> None:
    job = make_job(cell_of(Silent), [0], tmp_path, shared_cache)
    finish(job)
    (record,) = records_of(job)
    assert len(record.evaluations) == 4


def test_nothing_but_records_and_policies_is_left(tmp_path: Path, shared_cache: Path) -> None:
    job = make_job(cell_of(Drifting), [0, 1], tmp_path, shared_cache)
    finish(job)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    folder = RecordFolder(tmp_path)
    records = [folder.path(run) for run in job.runs]
    policies = [folder.policy(record) for run in job.runs if (record := folder.find(run))]
    assert sorted(files) == sorted([*records, *policies])


def test_data_that_cannot_feed_a_stage_is_named(tmp_path: Path, shared_cache: Path) -> None:
    """One row kept of the demonstration leaves no triple: the authors' buffer never samples its last."""

    class Hungry(Drifting):
        @classmethod
        def needs(cls, config: Any) -> DataNeeds:
            return DataNeeds(offline=("observation",), expert=("observation", "second_next_observation"))

        def stages(self, sizes: Any) -> tuple[Stage, ...]:
            return (Stage("drift", None, 8, 4),)

    cell = cell_of(Hungry)
    recipe = replace(cell.task.recipe, demonstration_rows=1)
    job = make_job(replace(cell, task=replace(cell.task, recipe=recipe)), [0], tmp_path, shared_cache)
    with pytest.raises(UserError, match="needs expert rows and the data holds none"):
        finish(job)


# --- divergence ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["state", "metrics"])
@pytest.mark.parametrize(("poisoned_at", "noticed_at", "kept"), [(0, 10, 0), (9, 10, 0), (10, 20, 1), (33, 40, 3)])
def test_one_seed_diverges_and_the_others_go_on(
    where: str, poisoned_at: int, noticed_at: int, kept: int, tmp_path: Path, shared_cache: Path
) -> None:
    cell = cell_of(Drifting, poisoned_seed=1, poisoned_step=poisoned_at, where=where)
    job = make_job(cell, [0, 1, 2], tmp_path / "poisoned", shared_cache)
    finish(job)
    first, sick, last = records_of(job)
    assert sick.status == "diverged"
    assert sick.diverged_at == noticed_at
    assert len(sick.evaluations) == kept, "no return of a diverged policy enters a record"
    assert str(noticed_at) in sick.warnings[0].what
    assert sick.score() == 0.0
    healthy = make_job(
        cell_of(Drifting, poisoned_seed=99, poisoned_step=poisoned_at, where=where), [0, 1, 2], tmp_path, shared_cache
    )
    finish(healthy)
    reference = records_of(healthy)
    for record, expected in ((first, reference[0]), (last, reference[2])):
        assert record.status == "finished"
        assert record.evaluations == expected.evaluations
        assert record.metrics == expected.metrics


def test_a_policy_that_answers_nan_is_diverged_although_its_state_is_finite(tmp_path: Path, shared_cache: Path) -> None:
    """Weights of 1e38 are finite; what they answer is not, and no return of a replaced action may count."""
    job = make_job(cell_of(Drifting, poisoned_seed=1, poisoned_step=33, where="action"), [0, 1], tmp_path, shared_cache)
    finish(job)
    healthy, sick = records_of(job)
    assert (sick.status, sick.diverged_at, len(sick.evaluations)) == ("diverged", 40, 3)
    assert (healthy.status, len(healthy.evaluations)) == ("finished", 4)


def test_all_seeds_diverge(tmp_path: Path, shared_cache: Path) -> None:
    job = make_job(cell_of(Drifting, poisoned_seed=0, poisoned_step=0), [0], tmp_path, shared_cache)
    events = finish(job)
    assert [event.diverged for event in events if isinstance(event, Recorded)] == [True]
    assert all(event.score is None for event in events if isinstance(event, Advance))


# --- interruption ----------------------------------------------------------------------------------------------------


def finish_in_sittings(job: Job, stops: list[int]) -> int:
    """Stop after the given numbers of steps, over and over, until the records are there."""
    sittings = 0
    while not all(RecordFolder(job.out).find(run) for run in job.runs):
        finish(job, StopAfter(stops[sittings % len(stops)]))
        sittings += 1
        assert sittings < 400
    return sittings


@pytest.mark.slow
@pytest.mark.parametrize("name", method_names())
def test_stopping_and_resuming_changes_nothing(name: str, tmp_path: Path, shared_cache: Path) -> None:
    """Every stage is cut several times, at evaluations and between them, and right at the start."""
    straight = make_job(smoke_cell(name), [0, 4], tmp_path / "straight", shared_cache)
    broken = make_job(smoke_cell(name), [0, 4], tmp_path / "broken", shared_cache)
    finish(straight)
    assert finish_in_sittings(broken, [0, 3, 1, 7, 10, 2]) > 8
    assert measured(broken) == measured(straight)


@pytest.mark.slow
@pytest.mark.parametrize("stops", [[1], [10], [46]])
def test_stopping_anywhere_changes_nothing(stops: list[int], tmp_path: Path, shared_cache: Path) -> None:
    straight = make_job(cell_of(Drifting), [0, 4], tmp_path / "straight", shared_cache)
    broken = make_job(cell_of(Drifting), [0, 4], tmp_path / "broken", shared_cache)
    finish(straight)
    finish_in_sittings(broken, stops)
    assert measured(broken) == measured(straight)


def test_a_diverged_seed_stays_diverged_over_a_resume(tmp_path: Path, shared_cache: Path) -> None:
    cell = cell_of(Drifting, poisoned_seed=1, poisoned_step=12)
    straight = make_job(cell, [0, 1], tmp_path / "straight", shared_cache)
    broken = make_job(cell, [0, 1], tmp_path / "broken", shared_cache)
    finish(straight)
    finish_in_sittings(broken, [9])
    assert measured(broken) == measured(straight)


def test_a_checkpoint_made_under_other_inputs_is_not_continued(
    tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another library's bits in the second half would make a record that nothing can repeat."""
    job = make_job(cell_of(Drifting), [0], tmp_path, shared_cache)
    with monkeypatch.context() as patch:
        patch.setattr(engine_job, "package_versions", lambda: {"torch": "0.0"})
        finish(job, StopAfter(30))
    checkpoint = RecordFolder(tmp_path).checkpoint(job.runs[0])
    assert checkpoint.exists()
    steps = [event.done for event in finish(job) if isinstance(event, Advance)]
    assert steps[0] < 30, "it starts afresh"


class Killed(BaseException):
    """The end of the process, as far as the job is concerned."""


def kill_at(update: int, monkeypatch: pytest.MonkeyPatch, method: type[Drifting] = Drifting) -> pytest.MonkeyPatch:
    genuine, left = method.update, [update]

    def dying(self: Drifting, *arguments: Any) -> Any:
        left[0] -= 1
        if left[0] < 0:
            raise Killed
        return genuine(self, *arguments)

    monkeypatch.setattr(method, "update", dying)
    return monkeypatch


@pytest.mark.parametrize("update", [0, 6, 7, 16, 17, 20, 31, 46])
@pytest.mark.parametrize("every_update", [False, True], ids=["at-evaluations", "always"])
def test_dying_without_a_word_changes_nothing(
    update: int, every_update: bool, tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No stop is asked for: what was saved last must do, also where a checkpoint falls on the end of a stage."""
    straight = make_job(cell_of(Drifting), [0, 4], tmp_path / "straight", shared_cache)
    broken = make_job(cell_of(Drifting), [0, 4], tmp_path / "broken", shared_cache)
    finish(straight)
    if every_update:
        monkeypatch.setattr(checkpoint, "SECONDS_BETWEEN", -1.0)
    with monkeypatch.context() as patch:
        kill_at(update, patch)
        with pytest.raises(Killed):
            finish(broken)
    finish(broken)
    assert measured(broken) == measured(straight)


def test_dying_between_the_last_checkpoint_and_the_records(
    tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight = make_job(cell_of(Drifting), [0, 4], tmp_path / "straight", shared_cache)
    broken = make_job(cell_of(Drifting), [0, 4], tmp_path / "broken", shared_cache)
    finish(straight)
    genuine, written = RecordFolder.write, [0]

    def dying(self: RecordFolder, *arguments: Any) -> Any:
        written[0] += 1
        if written[0] == 2:
            raise Killed
        return genuine(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(RecordFolder, "write", dying)
        with pytest.raises(Killed):
            finish(broken)
    finish(broken)
    assert measured(broken) == measured(straight)


def corrupt_nothing(path: Path, other: Path) -> None:
    path.unlink()


def corrupt_cut(path: Path, other: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def corrupt_empty(path: Path, other: Path) -> None:
    path.write_bytes(b"")


def corrupt_pipe(path: Path, other: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def corrupt_text(path: Path, other: Path) -> None:
    path.write_text("not a checkpoint", encoding="utf-8")


def corrupt_swapped(path: Path, other: Path) -> None:
    path.write_bytes(other.read_bytes())


def corrupt_progress(path: Path, other: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"diverged_at", b"diverged_xx"))


@pytest.mark.parametrize(
    "corrupt",
    [corrupt_nothing, corrupt_cut, corrupt_empty, corrupt_pipe, corrupt_text, corrupt_swapped, corrupt_progress],
)
def test_a_useless_checkpoint_starts_afresh(
    corrupt: Callable[[Path, Path], None], tmp_path: Path, shared_cache: Path
) -> None:
    straight = make_job(cell_of(Drifting), [0, 4], tmp_path / "straight", shared_cache)
    broken = make_job(cell_of(Drifting), [0, 4], tmp_path / "broken", shared_cache)
    neighbour = make_job(cell_of(Drifting), [1, 2], tmp_path / "broken", shared_cache)
    finish(straight)
    finish(broken, StopAfter(20))
    finish(neighbour, StopAfter(20))
    paths = [RecordFolder(job.out).checkpoint(job.runs[0]) for job in (broken, neighbour)]
    assert all(path.exists() for path in paths)
    corrupt(paths[0], paths[1])
    finish(broken)
    assert measured(broken) == measured(straight)


def test_altered_weights_in_a_checkpoint_do_not_reach_a_record(tmp_path: Path, shared_cache: Path) -> None:
    """A flipped bit on disk is as bad as a truncated file: the dataset cache checks, the checkpoint should."""
    straight = make_job(cell_of(Drifting), [0, 4], tmp_path / "straight", shared_cache)
    broken = make_job(cell_of(Drifting), [0, 4], tmp_path / "broken", shared_cache)
    finish(straight)
    finish(broken, StopAfter(20))
    path = RecordFolder(broken.out).checkpoint(broken.runs[0])
    content = bytearray(path.read_bytes())
    content[-1] ^= 0x40  # an exponent
    path.write_bytes(content)
    finish(broken)
    assert measured(broken) == measured(straight)


# --- other processes, and the disk -----------------------------------------------------------------------------------


def test_two_processes_on_one_job(tmp_path: Path, shared_cache: Path) -> None:
    job = make_job(cell_of(Drifting), [0], tmp_path, shared_cache)
    first = run_job(job, lambda: False)
    next(first)
    with pytest.raises(Busy):
        finish(job)
    other = make_job(cell_of(Drifting), [1], tmp_path, shared_cache)
    finish(other)
    list(first)
    assert len(RecordFolder(tmp_path).read_all().records) == 2


def test_what_another_process_finished_is_not_done_again(
    tmp_path: Path, shared_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both commands planned the run; the second comes to it when its record is already there."""
    job = make_job(cell_of(Drifting), [0], tmp_path, shared_cache)
    finish(job)
    path = RecordFolder(tmp_path).path(job.runs[0])
    before = path.stat().st_mtime_ns
    kill_at(0, monkeypatch)
    finish(job)
    assert path.stat().st_mtime_ns == before, "records are written once"


def test_an_output_folder_below_a_file(tmp_path: Path, shared_cache: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    job = make_job(cell_of(Drifting), [0], tmp_path / "file" / "out", shared_cache)
    with pytest.raises(UserError, match="Cannot write"):
        finish(job)


def test_a_full_disk_stops_a_job_and_a_free_one_continues_it(
    tmp_path: Path, shared_cache: Path, request: pytest.FixtureRequest
) -> None:
    """The checkpoint does not fit; nothing half-written stays, and the job ends as it would have."""
    cell = smoke_cell("bc", assignments=("bc.hidden=[256,256]",))
    straight = make_job(cell, [0], tmp_path / "straight", shared_cache)
    broken = make_job(cell, [0], tmp_path / "broken", shared_cache)
    finish(straight)
    request.getfixturevalue("full_disk")
    with pytest.raises(UserError, match="Cannot write"):
        finish(broken)
    written = [path for path in broken.out.rglob("*") if path.is_file() and path.suffix != ".lock"]
    assert written == []
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    finish(broken)
    assert measured(broken) == measured(straight)


def test_missing_data_is_a_users_mistake(tmp_path: Path) -> None:
    job = Job(cell_of(Drifting), (0,), tmp_path / "out", tmp_path / "cache", "cpu")
    with pytest.raises(UserError, match=r"shard .* is missing.*lfobench data build"):
        finish(job)
