"""What a method draws at a step is a function of (seed, purpose, step), however many steps are drawn at once."""

from __future__ import annotations

import pytest
import torch

from lfobench.engine.batches import Draws, RunningStep
from lfobench.randomness import Randomness

RANDOMNESS = Randomness([5, 6])


@pytest.mark.parametrize("chunk", [1, 7, 64])
@pytest.mark.parametrize("step", [0, 17, 64, 2**33])
def test_a_steps_draws_are_those_of_its_randomness(chunk: int, step: int) -> None:
    draws = Draws(RANDOMNESS, chunk)
    draws.move_to(step, draws.refill)
    running = RunningStep(draws, 0)
    expected = RANDOMNESS.normal("update: a", step, 12).view(2, 4, 3)
    assert torch.equal(running.normal("a", 4, 3), expected)
    assert torch.equal(running.uniform("a", 4, 1), RANDOMNESS.uniform("update: a", step, 4).view(2, 4, 1))
    assert torch.equal(running.normal("a", 2, 6), expected.view(2, 2, 6)), "the shape is the caller's"


def test_buffers_are_refilled_in_place_and_steps_pass_without_the_host() -> None:
    """Both are what a recorded step relies on."""
    draws = Draws(RANDOMNESS, 4)
    draws.move_to(0, draws.refill)
    running = RunningStep(draws, 0)
    running.normal("a", 3)
    where = draws.buffer("normal update: a", 3, lambda steps: torch.empty(0)).data_ptr()
    for step in range(10):
        draws.move_to(step, draws.refill)
        assert torch.equal(running.normal("a", 3), RANDOMNESS.normal("update: a", step, 3)), step
        draws.advance()
    assert draws.buffer("normal update: a", 3, lambda steps: torch.empty(0)).data_ptr() == where
    assert draws.kinds == 1
