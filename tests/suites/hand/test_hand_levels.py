"""Demonstrators of the hand's generated data: their cards and their policies."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import numpy as np
import pytest

from lfobench.contract.episodes import FloatArray
from lfobench.contract.suite import Demonstrator
from lfobench.errors import UserError
from suites.adroit import ENVIRONMENTS
from suites.hand.levels import LEVELS, MANNERS, WEIGHTS, Halves, ScriptedPolicy, demonstrator, policy
from tools.adroit_measure import act_out
from tools.distillation import shortfall

SHAPES = {"pen": (45, 24), "door": (39, 28), "hammer": (46, 26)}
DOOR = next(environment for environment in ENVIRONMENTS if environment.name == "door")
FILES = [(name, kind) for name in SHAPES for kind in ("expert", "clone")]
each = pytest.mark.parametrize(("name", "level"), [(name, level) for name in SHAPES for level in LEVELS])


def read_card(name: str, kind: str) -> dict[str, Any]:
    card: dict[str, Any] = json.loads((WEIGHTS / f"{name}-{kind}.json").read_text(encoding="utf-8"))
    return card


def episode_of(columns: int, steps: int, seed: int) -> list[FloatArray]:
    """Observations of an episode; the hand is at rest in the first."""
    rows = np.random.default_rng(seed).standard_normal((steps, columns)).astype(np.float32) * np.float32(0.3)
    rows[0, :24] = 0
    return list(rows)


@each
def test_every_level_acts_inside_the_bounds_and_repeats_itself(name: str, level: str) -> None:
    columns, actions = SHAPES[name]
    rows = episode_of(columns, 40, seed=0) + episode_of(columns, 40, seed=1)
    runs = []
    for seed in (5, 5, 6):
        maker, generator = demonstrator(name, level), np.random.default_rng(seed)
        runs.append(np.stack([maker.act(row, generator) for row in rows]))
    assert runs[0].shape == (80, actions)
    assert runs[0].dtype == np.float32
    assert np.abs(runs[0]).max() <= 1.0
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_fingerprints_tell_levels_apart() -> None:
    prints = [demonstrator(name, level).fingerprint for name in SHAPES for level in LEVELS]
    assert len(set(prints)) == len(prints)
    assert prints == [demonstrator(name, level).fingerprint for name in SHAPES for level in LEVELS]
    manner = MANNERS["door"]
    expert = policy("door", "expert")
    hastier = dataclasses.replace(manner, lag=manner.lag / 2)
    assert ScriptedPolicy(expert, manner).fingerprint != ScriptedPolicy(expert, hastier).fingerprint


@pytest.mark.parametrize(("wanted", "said"), [(("pin", "expert"), "'pen'"), (("pen", "human"), "scripted")])
def test_an_unknown_name_is_refused(wanted: tuple[str, str], said: str) -> None:
    with pytest.raises(UserError, match=said):
        demonstrator(*wanted)


def test_a_scripted_episode_does_not_remember_the_one_before() -> None:
    columns, _ = SHAPES["door"]
    used, rows = demonstrator("door", "scripted"), episode_of(columns, 60, seed=0)
    for row in rows:
        used.act(row, np.random.default_rng(0))
    fresh = demonstrator("door", "scripted")
    for row in episode_of(columns, 60, seed=1):
        np.testing.assert_array_equal(used.act(row, np.random.default_rng(1)), fresh.act(row, np.random.default_rng(1)))


def test_a_scripted_hand_follows_its_expert_late() -> None:
    """Without tremor, pauses and detours, a step of the expert's command is approached as lag says."""
    expert = policy("door", "expert")
    columns, _ = SHAPES["door"]
    manner = dataclasses.replace(MANNERS["door"], tremor=0.0, pause_every=1e12, detour_every=1e12, lag=10.0)
    first, then = episode_of(columns, 2, seed=3)
    scripted, generator = ScriptedPolicy(expert, manner), np.random.default_rng(0)
    begun = scripted.act(first, generator)
    np.testing.assert_array_equal(begun, expert.mean_action(first))
    moved = [scripted.act(then, generator) for _ in range(10)]
    expected = begun + (1 - np.exp(-1.0)) * (expert.mean_action(then) - begun)
    np.testing.assert_allclose(moved[-1], expected, atol=1e-6)


class Constant:
    """Acts always alike."""

    def __init__(self, value: float) -> None:
        self.value = value
        self.fingerprint = str(value)

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        return np.full(3, self.value, np.float32)


def test_two_policies_share_the_steps_and_never_an_episode() -> None:
    pair: tuple[Demonstrator, Demonstrator] = Constant(0.25), Constant(0.75)
    halves, generator = Halves(*pair), np.random.default_rng(0)
    lengths = generator.integers(5, 100, 60)
    acted = [
        [float(halves.act(row, generator)[0]) for row in episode_of(30, length, seed)]
        for seed, length in enumerate(lengths)
    ]
    assert acted[0][0] == 0.25, "the first one begins"
    assert all(len(set(episode)) == 1 for episode in acted)
    steps = [sum(episode.count(value) for episode in acted) for value in (0.25, 0.75)]
    assert abs(steps[0] - steps[1]) <= 100
    assert halves.fingerprint != Halves(*reversed(pair)).fingerprint


@pytest.mark.parametrize(("name", "kind"), FILES)
def test_cards_say_what_the_weights_are(name: str, kind: str) -> None:
    card, content = read_card(name, kind), (WEIGHTS / f"{name}-{kind}.safetensors").read_bytes()
    environment = next(environment for environment in ENVIRONMENTS if environment.name == name)
    assert card["sha256"] == hashlib.sha256(content).hexdigest() == policy(name, kind).fingerprint
    assert card["environment"] == dataclasses.asdict(environment)
    assert {"mujoco", "gymnasium", "gymnasium-robotics"} <= set(card["versions"])
    for measured in card["levels"].values():
        assert measured["episodes"] == 100
        expected = environment.normalized_score(measured["return_mean"])
        assert measured["score_mean"] == pytest.approx(expected, abs=1e-6)
    readme = (WEIGHTS / "README.md").read_text(encoding="utf-8")
    if kind == "expert":
        assert shortfall(card) == ""
        assert card["teacher"]["licence"] == "Apache-2.0"
        assert card["teacher"]["source"] in readme
        assert card["teacher"]["path"] in readme
    else:
        assert card["demonstrations"]["part"]["demonstrator"] == demonstrator(name, "scripted").fingerprint
        assert card["levels"]["sampled"]["score_mean"] < read_card(name, "expert")["levels"]["sampled"]["score_mean"]


@pytest.mark.slow
def test_the_levels_are_in_order() -> None:
    """Few episodes of door, whose levels lie far apart."""
    expert, scripted = (act_out(DOOR, demonstrator("door", level).act, range(6)) for level in ("expert", "scripted"))
    assert expert.success == expert.lasting_success == 1.0
    assert scripted.returns.mean() < 0.6 * expert.returns.mean()
