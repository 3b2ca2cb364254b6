"""Batches are a function of (seed, stage, step) alone."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import torch
from helpers_engine import batches_at

from lfobench.contract.method import Batch, Shapes, Stage
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine import batches as sampling
from lfobench.engine.batches import StageSampler, check_tables
from lfobench.randomness import Randomness

ROWS, EXTRA, EXPERT, INITIAL = 50, 5, 23, 7


def numbered_view() -> View:
    """Every row holds its own number."""

    def table(rows: int, sampled: int, field: str) -> Table:
        columns = {field: (torch.arange(rows, dtype=torch.float32)[:, None], torch.arange(rows))}
        return Table(columns, sampled, rows)  # type: ignore[arg-type]

    one = np.ones(1, np.float32)
    return View(
        offline=table(ROWS + EXTRA, ROWS, "observation"),
        initial=table(INITIAL, INITIAL, "initial_observation"),
        expert=table(EXPERT, EXPERT, "observation"),
        shapes=Shapes(1, 1),
        transform=ObservationTransform(0 * one, one, False),
    )


LAST = Stage("last", None, offline_batch=6, expert_batch=4)
EARLY = Stage("early", 100, offline_batch=6, expert_batch=4, expert_epochs=True)


def draw(stage: Stage, seeds: list[int], steps: list[int]) -> list[tuple[Batch, Batch]]:
    sampler = StageSampler(numbered_view(), stage, Randomness(seeds))
    return [batches_at(sampler, step) for step in steps]


def same(one: tuple[Batch, Batch], two: tuple[Batch, Batch], seed: int = 0, other: int = 0) -> bool:
    return all(
        left.keys() == right.keys() and all(torch.equal(left[field][seed], right[field][other]) for field in left)
        for left, right in zip(one, two, strict=True)
    )


@pytest.mark.parametrize("stage", [LAST, EARLY], ids=lambda stage: stage.name)
def test_batches_do_not_depend_on_where_drawing_began(stage: Stage) -> None:
    """What a resume needs: from the start, from the middle, backwards."""
    steps = [0, 1, 63, 64, 65, 130]
    straight = dict(zip(range(131), draw(stage, [3], list(range(131))), strict=True))
    for step in steps:
        assert same(draw(stage, [3], [step])[0], straight[step])
    for step, batch in zip(reversed(steps), draw(stage, [3], steps[::-1]), strict=True):
        assert same(batch, straight[step])


@pytest.mark.parametrize("chunk", [1, 5, 1000])
@pytest.mark.parametrize("stage", [LAST, EARLY], ids=lambda stage: stage.name)
def test_batches_do_not_depend_on_how_many_are_drawn_at_once(
    stage: Stage, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = list(range(70))
    reference = draw(stage, [3], steps)
    monkeypatch.setattr(sampling, "CHUNK", chunk)
    for one, two in zip(reference, draw(stage, [3], steps), strict=True):
        assert same(one, two)


@pytest.mark.parametrize("stage", [LAST, EARLY], ids=lambda stage: stage.name)
def test_a_seed_alone_draws_what_it_draws_beside_others(stage: Stage) -> None:
    together = draw(stage, [0, 1, 2, 3], [0, 5, 99])
    for alone, beside in zip(draw(stage, [3], [0, 5, 99]), together, strict=True):
        assert same(alone, beside, 0, 3)


def test_seeds_steps_stages_and_parts_differ() -> None:
    (offline, expert), (later, _) = draw(LAST, [0, 1], [0, 1])
    (other, _), *_ = draw(Stage("other", None, 6, 4), [0, 1], [0])
    rows = [offline["observation"][0], offline["observation"][1], later["observation"][0], other["observation"][0]]
    assert len({tuple(row[:, 0].tolist()) for row in rows}) == 4
    assert offline["observation"][0, :4, 0].tolist() != expert["observation"][0, :, 0].tolist()


def test_rows_are_drawn_evenly_and_only_those_for_training() -> None:
    drawn = [batch["observation"][0, :, 0] for batch, _ in draw(LAST, [0], list(range(2000)))]
    counts = Counter(torch.cat(drawn).int().tolist())
    assert set(counts) == set(range(ROWS)), "appended rows are not drawn in the last stage"
    expected = 2000 * 6 / ROWS
    chi_square = sum((count - expected) ** 2 / expected for count in counts.values())
    assert chi_square < 100, "99.99 % point of 49 degrees of freedom is 95"


def test_an_earlier_stage_sees_the_appended_rows() -> None:
    drawn = torch.cat([batch["observation"].flatten() for batch, _ in draw(EARLY, [0], list(range(300)))])
    assert set(drawn.int().tolist()) == set(range(ROWS + EXTRA))


def test_expert_passes_show_every_row_once() -> None:
    per_pass = -(-EXPERT // 4)
    batches = draw(EARLY, [0, 1], list(range(2 * per_pass)))
    orders = []
    for start in (0, per_pass):
        shown = torch.cat([expert["observation"] for _, expert in batches[start : start + per_pass]], dim=1)[..., 0]
        assert shown.shape == (2, EXPERT)
        for seed in range(2):
            assert sorted(shown[seed].int().tolist()) == list(range(EXPERT))
            orders.append(tuple(shown[seed].int().tolist()))
    assert len(set(orders)) == 4, "shuffled anew for every seed and pass"
    assert batches[per_pass - 1][1]["observation"].shape[1] == EXPERT % 4, "the last batch of a pass is short"


def test_nothing_is_drawn_that_a_stage_does_not_ask_for() -> None:
    assert draw(Stage("none", None, 0, 0), [0], [0]) == [({}, {})]
    ((offline, expert),) = draw(Stage("offline", None, 3, 0), [0], [0])
    assert set(offline) == {"observation", "initial_observation"}
    assert expert == {}


def test_tables_without_rows_are_named() -> None:
    empty = Table({}, 0, 0)
    full = numbered_view().offline
    assert "offline" in (check_tables(LAST, empty, full) or "")
    assert "expert" in (check_tables(LAST, full, empty) or "")
    assert check_tables(LAST, full, full) is None
    assert check_tables(Stage("offline", None, 3, 0), full, empty) is None
