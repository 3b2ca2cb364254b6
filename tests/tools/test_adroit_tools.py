"""Tools of the hand: clones, counts of successes, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer

from suites.demonstrators.policy import GaussianTanhPolicy
from tools.adroit_distil import CloneSettings, clone, main
from tools.adroit_measure import Played


def test_a_clone_learns_what_was_done() -> None:
    generator = np.random.default_rng(0)
    observations = generator.standard_normal((600, 4)).astype(np.float32)
    actions = np.stack([0.5 * observations[:, 0], np.zeros(600, np.float32)], axis=1).clip(-1, 1)
    settings = CloneSettings(steps=250, hidden=(16, 16))
    content = clone(observations, actions, settings)
    assert content == clone(observations, actions, settings)
    learnt = GaussianTanhPolicy(content)
    row = np.array([0.8, 0.0, 0.0, 0.0], np.float32)
    np.testing.assert_allclose(learnt.mean_action(row), [0.4, 0.0], atol=0.1)
    spread = np.std([learnt.act(row, generator) for _ in range(500)], axis=0)
    assert (spread < 0.2).all()


@pytest.mark.parametrize(("name", "steps"), [("pen", 20), ("door", 25), ("hammer", 25)])
def test_a_success_that_does_not_last_counts_here_alone(name: str, steps: int) -> None:
    played = Played(name, np.zeros(4), np.array([0, 1, steps, steps + 1]))
    assert (played.success, played.lasting_success) == (0.75, 0.25)
    assert played.first(2).success == 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("pin", "expert"), "Did you mean 'pen'"),
        (("pen", "expert"), "Give --teacher FILE"),
        (("pen", "expert", Path("none.npz")), "Cannot use teacher 'none.npz'"),
    ],
)
def test_the_script_explains_a_mistake(arguments, message, capsys, tmp_path) -> None:
    with pytest.raises(typer.Exit) as stop:
        main(*arguments, output=tmp_path)
    assert stop.value.exit_code == 2
    assert message in " ".join(capsys.readouterr().out.split())
    assert not list(tmp_path.iterdir())
