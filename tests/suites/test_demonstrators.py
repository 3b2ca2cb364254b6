"""Demonstrators of the locomotion data: levels, fingerprints, and the cards of their weights."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import numpy as np
import pytest

from lfobench.errors import UserError
from suites.demonstrators import WEIGHTS, load
from suites.demonstrators.policy import UniformPolicy
from suites.locomotion import ENVIRONMENTS
from tools.distillation import LIBRARIES, shortfall
from tools.locomotion_measure import measure

BODIES = {environment.name: environment for environment in ENVIRONMENTS}
LEVELS = ("random", "medium", "expert")
LEARNED = [(name, level) for name in BODIES for level in LEVELS[1:]]
COLUMNS = {"hopper": 11, "halfcheetah": 17, "walker2d": 17, "ant": 27}


def read_card(name: str, level: str) -> dict[str, Any]:
    return json.loads((WEIGHTS / f"{name}-{level}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("level", LEVELS)
def test_every_level_acts_inside_the_bounds(name, level):
    policy = load(name, level)
    observations = np.random.default_rng(0).standard_normal((50, COLUMNS[name])).astype(np.float32)
    actions = np.stack([policy.act(row, np.random.default_rng(1)) for row in observations])
    assert actions.dtype == np.float32
    assert actions.shape == (50, *BODIES[name].make().action_space.shape)
    assert np.abs(actions).max() <= 1.0
    again = np.stack([load(name, level).act(row, np.random.default_rng(1)) for row in observations])
    np.testing.assert_array_equal(actions, again)
    other = policy.act(observations[0], np.random.default_rng(2))
    assert not np.array_equal(actions[0], other), "levels are sampled, like D4RL's"


def test_an_unknown_environment_is_named():
    with pytest.raises(UserError, match="Did you mean 'hopper'"):
        load("hoper", "expert")


def test_fingerprints_tell_policies_apart():
    prints = {(name, level): load(name, level).fingerprint for name in BODIES for level in LEVELS}
    assert prints["halfcheetah", "random"] == prints["walker2d", "random"], "the same rule, six columns"
    assert len(set(prints.values())) == len(prints) - 1
    for (name, level), fingerprint in prints.items():
        assert load(name, level).fingerprint == fingerprint
    for name, level in LEARNED:
        content = (WEIGHTS / f"{name}-{level}.safetensors").read_bytes()
        assert prints[name, level] == hashlib.sha256(content).hexdigest() == read_card(name, level)["sha256"]


def test_uniform_actions_fill_the_range():
    policy, generator = UniformPolicy(3), np.random.default_rng(0)
    actions = np.stack([policy.act(np.zeros(11, np.float32), generator) for _ in range(4000)])
    np.testing.assert_allclose(actions.mean(0), 0.0, atol=0.05)
    np.testing.assert_allclose(actions.std(0), 1 / np.sqrt(3), atol=0.02)


@pytest.mark.parametrize(("name", "level"), LEARNED)
def test_cards_meet_their_bars(name, level):
    card = read_card(name, level)
    scores = {kind: measured["score_mean"] for kind, measured in card["levels"].items()}
    if level == "expert":
        assert min(scores["sampled"], scores["deterministic"]) >= (110 if name == "ant" else 90)
    else:
        assert abs(scores["sampled"] - card["teacher"]["levels"]["sampled"]["score_mean"]) <= 10
    assert shortfall(card) == ""
    for measured in (*card["levels"].values(), *card["teacher"]["levels"].values()):
        assert measured["episodes"] == 100
        expected = BODIES[name].normalized_score(measured["return_mean"])
        assert measured["score_mean"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("name", "level"), LEARNED)
def test_cards_say_where_the_weights_come_from(name, level):
    card = read_card(name, level)
    assert card["licence"] == card["teacher"]["licence"] == "MIT"
    assert card["environment"] == dataclasses.asdict(BODIES[name])
    assert set(card["versions"]) == {"python", *LIBRARIES}
    assert len(card["teacher"]["sha256"]) == 64
    readme = (WEIGHTS / "README.md").read_text(encoding="utf-8")
    assert card["teacher"]["source"] in readme
    assert card["teacher"]["path"] in readme
    assert (WEIGHTS / f"{name}-{level}.safetensors").stat().st_size < 300_000


@pytest.mark.parametrize("name", ["hopper", "halfcheetah"])
def test_an_expert_still_reaches_its_card(name):
    policy = load(name, "expert")
    score = measure(BODIES[name], policy.act, episodes=2).score_mean
    assert score > 0.7 * read_card(name, "expert")["levels"]["sampled"]["score_mean"]
