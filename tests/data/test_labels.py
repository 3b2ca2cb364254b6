"""Labels: what `prepare` sees, which row each label reaches, and when they are computed anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from helpers_engine import cell_of, finish, make_job, records_of
from torch import Tensor

from lfobench.contract.episodes import Episodes
from lfobench.contract.method import Batch, DataNeeds, Field, Method, MethodConfig, Metrics, Shapes, Trajectories
from lfobench.contract.suite import Recipe
from lfobench.data.firewall import FirewallError, view
from lfobench.data.labels import labels_of
from lfobench.data.mixing import mix
from lfobench.errors import UserError
from lfobench.randomness import Randomness, StepRandomness

CPU = torch.device("cpu")
HORIZON = 5


def episodes(first: float, lengths: Sequence[int], terminated: Sequence[bool]) -> Episodes:
    """Observation t of the data is ``[first + t, 0]``, action t ``[first + t]``."""
    steps, count = sum(lengths), len(lengths)
    observations = np.zeros((steps + count, 2), np.float32)
    observations[:, 0] = first + np.arange(steps + count)
    return Episodes(
        observations,
        (first + np.arange(steps, dtype=np.float32))[:, None],
        np.full(steps, 7.0, np.float32),
        np.array(lengths, np.int64),
        np.array(terminated),
    )


OFFLINE = episodes(0.0, (5, 3, 5, 4), (False, True, False, True))
EXPERT = episodes(1000.0, (5, 5, 5), (False, False, False))


class Labelling(Method):
    """Labels of the data that it was handed."""

    name = "labelling"
    Config = MethodConfig
    fields: ClassVar[tuple[Field, ...]] = ("observation", "action", "label")
    seen: ClassVar[list[tuple[Trajectories, Trajectories]]] = []

    @classmethod
    def needs(cls, config: Any) -> DataNeeds:
        return DataNeeds(offline=cls.fields, expert=("observation",))

    @classmethod
    def prepare(
        cls,
        config: Any,
        offline: Trajectories,
        expert: Trajectories,
        seeds: Sequence[int],
        progress: Callable[[float], None],
    ) -> Tensor:
        cls.seen.append((offline, expert))
        progress(0.5)
        starts = [observations[:-1, 0] for observations in offline.split()]
        return torch.cat(starts)

    def __init__(self, config: Any, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.mean = torch.zeros(len(seeds), device=device)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        assert torch.equal(offline["label"], offline["observation"][..., 0])
        self.mean += offline["label"].mean(1)
        return {"label": offline["label"].mean(1)}

    def act(self, observation: Tensor) -> Tensor:
        return torch.zeros(*observation.shape[:2], 1)


class PerSeedLabels(Labelling):
    """Labels that differ between seeds."""

    name = "per-seed-labels"

    @classmethod
    def prepare(cls, config: Any, offline: Any, expert: Any, seeds: Sequence[int], progress: Any) -> Tensor:
        return super().prepare(config, offline, expert, seeds, progress) + 1e4 * torch.tensor(seeds)[:, None]


def labels(
    method: type[Labelling], cache: Path, seeds: Sequence[int] = (0,), needs: DataNeeds | None = None, **code: str
) -> tuple[Tensor, Any]:
    needs = needs or method.needs(None)
    mixture = mix(OFFLINE, EXPERT, Recipe("poor", 17, "expert", 2, 5), needs, HORIZON)
    method.seen.clear()
    found = labels_of(method, MethodConfig(), needs, mixture, seeds, CPU, code, cache, lambda done: None)
    assert found is not None
    return found, mixture


@pytest.mark.parametrize(
    ("boundary", "termination"), [("released", "teleport"), ("exact", "zero"), ("released", "absorbing")]
)
def test_every_row_has_the_label_of_its_own_step(boundary: Any, termination: Any, tmp_path: Path) -> None:
    needs = DataNeeds(Labelling.fields, ("observation",), boundary, termination)
    found, mixture = labels(Labelling, tmp_path, needs=needs)
    table = view(Labelling, needs, mixture, CPU, found).offline
    batch = table.batch(torch.arange(table.sampled)[None])
    assert torch.equal(batch["label"], batch["observation"][..., 0])


def test_whole_episodes_are_handed_over_and_a_part_of_one_is_cut(tmp_path: Path) -> None:
    """The D4RL loader's count takes nine expert rows: those of two trajectories, and one of the third."""
    labels(Labelling, tmp_path)
    ((offline, _),) = Labelling.seen
    mixed_in = sorted(len(each) - 1 for each in offline.split() if each[0, 0] >= 1000)
    assert mixed_in == [1, 5, 5]
    assert int(offline.lengths.sum()) == len(offline.actions if offline.actions is not None else ())
    assert len(offline.observations) == int((offline.lengths + 1).sum())
    poor = [each for each in offline.split() if each[0, 0] < 1000]
    assert sorted(len(each) - 1 for each in poor) == [3, 4, 5, 5], "rows that boundaries drop are there"
    ended = {float(each[0, 0]): bool(end) for each, end in zip(offline.split(), offline.terminated, strict=True)}
    assert [ended[start] for start in (0.0, 6.0, 10.0, 16.0)] == [False, True, False, True]


def test_nothing_says_what_the_firewall_hides(tmp_path: Path) -> None:
    labels(Labelling, tmp_path)
    ((offline, expert),) = Labelling.seen
    assert expert.actions is None
    assert set(vars(offline)) == {"observations", "actions", "lengths", "terminated"}
    assert not any((tensor == 7.0).all() for tensor in (offline.observations, offline.actions) if tensor is not None)
    first = [float(each[0, 0]) for each in offline.split()]
    assert first != sorted(first), "the expert's trajectories are not the last ones"
    labels(Labelling, tmp_path / "b", needs=DataNeeds(("observation", "label"), ("observation",)))
    assert Labelling.seen[0][0].actions is None, "not declared"


def test_labels_are_computed_once_for_one_code_and_data(tmp_path: Path) -> None:
    first, _ = labels(Labelling, tmp_path)
    again, _ = labels(Labelling, tmp_path)
    assert Labelling.seen == []
    assert torch.equal(first.nan_to_num(), again.nan_to_num())
    labels(Labelling, tmp_path, **{"mine.py": "another hash"})
    assert len(Labelling.seen) == 1
    (path, *_) = sorted((tmp_path / "labels").iterdir())
    path.write_bytes(path.read_bytes()[:-3])
    labels(Labelling, tmp_path)
    labels(Labelling, tmp_path, **{"mine.py": "another hash"})


def test_labels_of_a_seed_are_its_own(tmp_path: Path) -> None:
    found, mixture = labels(PerSeedLabels, tmp_path, (3, 1))
    needs = PerSeedLabels.needs(None)
    seen = view(PerSeedLabels, needs, mixture, CPU, found)
    rows = Randomness([3, 1]).integers("rows", 0, 20, seen.offline.sampled)
    batch = seen.offline.batch(rows)
    assert torch.equal(batch["label"] - batch["observation"][..., 0], torch.tensor([[3e4], [1e4]]).expand(2, 20))
    alone = seen.of_seeds([1]).offline.batch(rows[1:])
    assert torch.equal(alone["label"][0], batch["label"][1])
    found, _ = labels(PerSeedLabels, tmp_path, (1,))
    assert PerSeedLabels.seen == [], "a seed that was labelled beside another is not labelled again"


@pytest.mark.parametrize("wrong", [torch.zeros(3), torch.zeros(2, 17), "labels", None])
def test_labels_of_another_shape_are_refused(wrong: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Labelling, "prepare", classmethod(lambda cls, *_: wrong))
    with pytest.raises(UserError, match="prepare"):
        labels(Labelling, tmp_path)


def test_labels_that_are_not_finite_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Labelling.prepare
    monkeypatch.setattr(Labelling, "prepare", classmethod(lambda cls, *given: genuine(*given) * torch.nan))
    with pytest.raises(UserError, match="not finite"):
        labels(Labelling, tmp_path)


def test_asking_and_preparing_go_together() -> None:
    class Asking(Method):
        name = "asking"

        @classmethod
        def needs(cls, config: Any) -> DataNeeds:
            return DataNeeds(offline=("label",))

    needs = DataNeeds(offline=("observation", "label"))
    mixture = mix(OFFLINE, EXPERT, Recipe("poor", 17, "expert", 2, 5), needs, HORIZON)
    with pytest.raises(FirewallError, match="prepare"):
        view(Asking, needs, mixture, CPU)
    with pytest.raises(FirewallError, match="labels"):
        view(Labelling, DataNeeds(offline=("observation",), expert=("label",)), mixture, CPU)


def test_a_job_trains_on_labels(tmp_path: Path, shared_cache: Path) -> None:
    """The update itself compares every label with its row."""
    job = make_job(cell_of(PerSeedTrained), [5, 2], tmp_path, shared_cache)
    finish(job)
    assert [record.status for record in records_of(job)] == ["finished", "finished"]


class PerSeedTrained(PerSeedLabels):
    name = "per-seed-trained"

    def __init__(self, config: Any, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.offset = 1e4 * torch.tensor(list(seeds))[:, None]

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        label = offline["label"] - self.offset
        torch.testing.assert_close(label, offline["observation"][..., 0], rtol=0.0, atol=0.01)
        return {"label": label.mean(1)}
