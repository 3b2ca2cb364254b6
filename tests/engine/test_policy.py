"""Trained policies on disk: every method acts again as it did, and files that are not a run's policy are refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers_engine import cell_of, finish, make_job, records_of, smoke_cell
from safetensors import safe_open

from lfobench.contract.method import Shapes
from lfobench.engine.policy import SCALE, SHIFT, load_policy
from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.records.folder import RecordFolder
from lfobench.registry import method_names

CPU = torch.device("cpu")
SHAPES = Shapes(4, 1)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory, shared_cache: Path) -> tuple[RecordFolder, list[Record]]:
    out = tmp_path_factory.mktemp("trained")
    job = make_job(smoke_cell("bc"), [0, 1], out, shared_cache)
    finish(job)
    return RecordFolder(out), records_of(job)


def test_a_seed_of_several_acts_alone_as_it_did(trained: tuple[RecordFolder, list[Record]]) -> None:
    folder, records = trained
    observation = np.linspace(-1, 1, 12, dtype=np.float32).reshape(3, 4)
    first, second = (load_policy(folder, record).act(observation) for record in records)
    assert first.shape == (3, 1)
    assert not np.array_equal(first, second)


@pytest.mark.parametrize("name", method_names())
def test_what_is_kept_is_what_acting_takes(name: str, tmp_path: Path, shared_cache: Path) -> None:
    """No critic, no discriminator, no optimiser; and the restored method acts as the trained one."""
    job = make_job(smoke_cell(name), [3], tmp_path, shared_cache)
    finish(job)
    (record,) = records_of(job)
    with safe_open(RecordFolder(tmp_path).policy(record), framework="pt") as file:
        names = set(file.offset_keys())
    assert len(names - {SHIFT, SCALE}) <= 2
    assert not any(each.startswith(("value", "critic", "discriminator", "inverse")) for each in names)
    assert not any("optimizer" in each for each in names)
    assert np.isfinite(load_policy(RecordFolder(tmp_path), record).act(np.zeros((2, 4), np.float32))).all()


def test_only_the_tensors_that_actions_depend_on_are_kept(tmp_path: Path, shared_cache: Path) -> None:
    from helpers_engine import Drifting

    job = make_job(cell_of(Drifting), [0], tmp_path, shared_cache)
    finish(job)
    (record,) = records_of(job)
    with safe_open(RecordFolder(tmp_path).policy(record), framework="pt") as file:
        kept = set(file.offset_keys())
    shapes = {SHIFT, SCALE}
    assert kept - shapes == {"weight", "factor"}


def test_files_that_are_not_the_runs_policy_are_refused(
    trained: tuple[RecordFolder, list[Record]], tmp_path: Path
) -> None:
    source, (record, other) = trained
    folder = RecordFolder(tmp_path)
    path = folder.policy(record)
    with pytest.raises(UserError, match="is not there"):
        load_policy(folder, record)
    path.parent.mkdir(parents=True)
    shutil.copy(source.policy(other), path)
    with pytest.raises(UserError, match="another run's"):
        load_policy(folder, record)
    path.write_bytes(source.policy(record).read_bytes()[:-8])
    with pytest.raises(UserError, match="cannot be used"):
        load_policy(folder, record)
    path.write_bytes(b"<html>")
    with pytest.raises(UserError, match="cannot be used"):
        load_policy(folder, record)
