"""Recordings of the scripted demonstrators: success rates, starts, motions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from lfobench.contract.episodes import Episodes
from lfobench.contract.suite import ScriptedDemonstrator
from lfobench.errors import UserError
from suites.robot import constants, tasks
from suites.robot.demonstrators import demonstrator, demonstrators
from suites.robot.demonstrators.hitting import Hitting
from suites.robot.demonstrators.manipulation import SafeTeleoperation
from suites.robot.demonstrators.mixture import BLOCK, Mixture
from suites.robot.demonstrators.recording import SUCCESS, Take
from suites.robot.simulation import Simulation

Array = NDArray[np.float64]

OBSERVATION = {
    "safe-manipulation": 2,
    "safe-manipulation-cross-embodiment": 2,
    "puck-striking": 4,
    "dynamic-hitting": 14,
}
ALL = [
    (environment, level)
    for environment, levels in demonstrators().items()
    for level, maker in levels.items()
    if not isinstance(maker, Mixture)
]
MIXTURES = [
    (environment, level, maker)
    for environment, levels in demonstrators().items()
    for level, maker in levels.items()
    if isinstance(maker, Mixture)
]
every = pytest.mark.parametrize(("environment", "level"), [pair for pair in ALL if "repeated" not in pair[1]])


@cache
def take(environment: str, level: str) -> Take:
    count = 100 if level.startswith("suboptimal") else 300
    return demonstrator(environment, level).perform(count, np.random.default_rng(7))


def tracks(episodes: Episodes) -> list[Array]:
    """Observed positions of the effector, per episode."""
    return [
        episodes.observations[first : first + length + 1, :2].astype(np.float64)
        for first, length in zip(episodes.first_observation, episodes.lengths, strict=True)
    ]


def speeds(track: Array) -> Array:
    metres: Array = np.linalg.norm(np.diff(track, axis=0), axis=-1)
    return metres * float(constants.CONTROL_RATE)


@pytest.mark.slow
@every
def test_success_is_within_the_bar(environment: str, level: str) -> None:
    rate = float((take(environment, level).outcomes == SUCCESS).mean())
    if level.startswith("suboptimal"):
        assert rate <= 0.2
    else:
        assert (0.8 if environment == "dynamic-hitting" else 0.95) <= rate < 1.0


@every
def test_a_recording_has_the_shape_of_its_environment(environment: str, level: str) -> None:
    episodes = take(environment, level).episodes
    assert episodes.observations.shape[1] == OBSERVATION[environment]
    assert episodes.actions.shape[1] == 2
    assert episodes.observations.dtype == episodes.actions.dtype == episodes.rewards.dtype == np.float32
    assert np.isfinite(episodes.observations).all()
    if level.startswith("hand"):
        assert np.isnan(episodes.actions).all()
    else:
        assert np.abs(episodes.actions).max() <= 1.0


@every
def test_the_mean_return_is_the_success_rate(environment: str, level: str) -> None:
    episodes, outcomes = take(environment, level).episodes, take(environment, level).outcomes
    np.testing.assert_array_equal(episodes.returns(), outcomes == SUCCESS)
    assert not episodes.rewards[~episodes.last_transition].any()
    assert not episodes.terminated.any()


@every
def test_one_seed_gives_one_recording_and_a_longer_one_begins_with_it(environment: str, level: str) -> None:
    maker = demonstrator(environment, level)
    once, again, longer = (maker.record(count, np.random.default_rng(3)) for count in (4, 4, 6))
    other = maker.record(4, np.random.default_rng(4))
    for name in ("observations", "actions", "rewards", "lengths"):
        np.testing.assert_array_equal(getattr(once, name), getattr(again, name))
        np.testing.assert_array_equal(getattr(once, name), getattr(longer.first_episodes(4), name))
    assert once.observations.tobytes() != other.observations.tobytes()


@pytest.mark.parametrize(
    ("environment", "level", "mixture"), [each for each in MIXTURES if each[1].removesuffix("-touch") != "failing"]
)
def test_every_block_of_a_mixture_has_its_share_of_successes(environment: str, level: str, mixture: Mixture) -> None:
    recorded = mixture.perform(2 * BLOCK, np.random.default_rng(3))
    succeeds = recorded.outcomes == SUCCESS
    np.testing.assert_array_equal(succeeds.reshape(2, BLOCK).mean(1), mixture.share)
    np.testing.assert_array_equal(recorded.episodes.returns(), succeeds)
    assert np.isfinite(recorded.episodes.actions).all()
    assert recorded.episodes.observations.shape[1] == OBSERVATION[environment]


def test_a_longer_mixture_begins_with_the_shorter_one_and_its_order_is_random() -> None:
    mixture = demonstrator("puck-striking", "half-successful")
    short, long = (mixture.record(count, np.random.default_rng(3)) for count in (5, 24))
    for name in ("observations", "actions", "rewards", "lengths"):
        np.testing.assert_array_equal(getattr(short, name), getattr(long.first_episodes(5), name))
    blocks = {tuple(block) for block in long.returns().reshape(-1, BLOCK)}
    assert len(blocks) > 2


def test_a_mixture_repeats_no_recording_of_the_experts_themselves() -> None:
    levels = demonstrators()["puck-striking"]
    experts, mixed = (levels[level].record(12, np.random.default_rng(0)) for level in ("expert", "successful"))
    first = {observation.tobytes() for observation in experts.observations[experts.first_observation]}
    assert not first & {observation.tobytes() for observation in mixed.observations[mixed.first_observation]}


def test_success_shares_enter_the_fingerprint() -> None:
    fingerprints = [maker.fingerprint for _, _, maker in MIXTURES]
    assert len(set(fingerprints)) == len(fingerprints) == 25


def test_a_success_is_one_by_the_environments_own_rules() -> None:
    """The recorded actions, sent to a simulation that ends its episodes, do what the recording says."""
    episodes = take("safe-manipulation", "expert").episodes
    count, longest = len(episodes.lengths), int(episodes.lengths.max())
    actions = np.zeros((longest, count, 2))
    for index, (first, length) in enumerate(zip(episodes.first_transition, episodes.lengths, strict=True)):
        actions[:length, index] = episodes.actions[first : first + length]
    simulation = Simulation(tasks.SafeManipulation(), count)
    simulation.reset(range(count), effector=np.array([track[0] for track in tracks(episodes)]))
    returns = np.sum([simulation.step(action).reward for action in actions], axis=0)
    assert np.mean(returns == episodes.returns()) > 0.99


def test_starts_are_as_declared() -> None:
    corner = np.array([constants.CORNER_X, constants.CORNER_Y])
    for environment, level in (
        ("safe-manipulation", "expert-fixed"),
        ("safe-manipulation-cross-embodiment", "hand-fixed"),
    ):
        starts = np.array([track[0] for track in tracks(take(environment, level).episodes)])
        assert np.linalg.norm(starts - corner, axis=-1).max() < 0.07
        assert starts.std(0).min() > 0.005
    for environment, x in (
        ("puck-striking", constants.STRIKING_START_X),
        ("dynamic-hitting", constants.HITTING_START_X),
    ):
        for level in ("expert", "suboptimal"):
            starts = np.array([track[0] for track in tracks(take(environment, level).episodes)])
            np.testing.assert_allclose(starts, np.tile([x, constants.START_Y], (len(starts), 1)), atol=1e-6)


@pytest.mark.parametrize("level", ["expert", "hand"])
def test_random_starts_are_all_over_the_workspace(level: str) -> None:
    environment = "safe-manipulation" if level == "expert" else "safe-manipulation-cross-embodiment"
    starts = np.array([track[0] for track in tracks(take(environment, level).episodes)])
    assert np.ptp(starts, axis=0).min() > 0.5


def test_experts_go_round_the_cups_and_rest_above_the_bowl() -> None:
    for environment, level in (("safe-manipulation", "expert"), ("safe-manipulation-cross-embodiment", "hand")):
        recorded = take(environment, level)
        for track, outcome in zip(tracks(recorded.episodes), recorded.outcomes, strict=True):
            if outcome == SUCCESS:
                # The camera errs by millimetres.
                assert np.linalg.norm(track[:, None] - tasks.CUPS, axis=-1).min() > tasks.CUP_REACH - 0.025
                assert np.linalg.norm(track[-10:] - tasks.BOWL, axis=-1).max() < constants.BOWL_RADIUS + 0.02


def test_a_teleoperator_overshoots_corrects_and_pauses() -> None:
    overshot = paused = 0
    recorded = tracks(take("safe-manipulation", "expert-fixed").episodes)
    for track in recorded:
        end = track[-5:].mean(0)
        overshot += bool(np.max((track - end) @ (end - track[0]) / np.linalg.norm(end - track[0])) > 0.005)
        moving = np.flatnonzero(speeds(track) > 0.15)
        paused += bool((speeds(track)[moving[0] : moving[-1]] < 0.03).any())
    assert overshot > 0.2 * len(recorded)
    assert 0.02 * len(recorded) < paused < 0.5 * len(recorded)


def test_a_hand_has_a_pace_of_its_own_and_no_arms_limits() -> None:
    by_mouse = tracks(take("safe-manipulation", "expert").episodes)
    by_hand = tracks(take("safe-manipulation-cross-embodiment", "hand").episodes)
    assert np.mean([len(track) for track in by_hand]) < 0.85 * np.mean([len(track) for track in by_mouse])
    everywhere = np.concatenate(by_hand)
    assert everywhere[:, 1].max() > constants.WORKSPACE_HIGH_Y + 0.01
    assert np.abs(everywhere[:, 1]).max() < constants.TABLE_WIDTH / 2


def test_a_cup_does_not_stop_the_suboptimal_demonstrator() -> None:
    recorded = take("safe-manipulation", "suboptimal")
    hit = recorded.outcomes == "cup hit"
    assert hit.mean() > 0.3
    assert abs(recorded.episodes.lengths[hit].mean() - 100) < 15
    moved_on = [
        np.linalg.norm(track[-1] - tasks.CUPS, axis=-1).min() > tasks.CUP_REACH
        for track, was in zip(tracks(recorded.episodes), hit, strict=True)
        if was
    ]
    assert np.mean(moved_on) > 0.5


@pytest.mark.parametrize(
    ("environment", "steps"), [("safe-manipulation", 100), ("puck-striking", 75), ("dynamic-hitting", 200)]
)
def test_suboptimal_data_is_as_long_as_the_papers_and_covers_places_and_actions(environment: str, steps: int) -> None:
    episodes = take(environment, "suboptimal").episodes
    assert abs(episodes.lengths.mean() / steps - 1.0) < 0.15
    places = np.concatenate(tracks(episodes))
    reach = places[places[:, 0] > constants.STRIKING_START_X]
    counts, _, _ = np.histogram2d(reach[:, 0], reach[:, 1], bins=4, range=[[0.4, 0.95], [-0.3, 0.3]])
    assert counts.min() > 0.005 * len(reach)
    low, high = np.quantile(episodes.actions, [0.02, 0.98], axis=0)
    assert (low < -0.15).all() and (high > 0.15).all()


def test_a_strike_is_a_single_efficient_motion() -> None:
    recorded = take("puck-striking", "expert")
    for track, outcome in zip(tracks(recorded.episodes), recorded.outcomes, strict=True):
        length, straight = np.linalg.norm(np.diff(track, axis=0), axis=-1).sum(), np.linalg.norm(track[-1] - track[0])
        if outcome == SUCCESS:
            assert length < 1.25 * straight + 0.02


def test_a_single_hit_ends_the_recording_and_repeated_hits_go_on() -> None:
    episodes = Hitting(single=2).record(5, np.random.default_rng(5))
    single = demonstrator("dynamic-hitting", "expert").record(2, np.random.default_rng(5))
    assert episodes.lengths[:2].max() <= constants.HITTING_HORIZON and single.lengths.max() <= constants.HITTING_HORIZON
    assert episodes.lengths[2:].max() > constants.HITTING_HORIZON
    assert episodes.lengths.max() <= 2000


def test_a_fingerprint_covers_class_fields_and_constants(monkeypatch: pytest.MonkeyPatch) -> None:
    known = [demonstrator(environment, level) for environment, level in ALL]
    assert all(isinstance(maker, ScriptedDemonstrator) for maker in known)
    assert len({maker.fingerprint for maker in known}) == len(ALL)
    maker = SafeTeleoperation()
    before = maker.fingerprint
    assert before == SafeTeleoperation().fingerprint
    assert before != replace(maker, care=replace(maker.care, aim=0.013)).fingerprint
    monkeypatch.setattr(constants, "CUP_RADIUS", constants.CUP_RADIUS + 0.001)
    assert before != maker.fingerprint


def test_an_unknown_name_is_an_error_with_that_name() -> None:
    with pytest.raises(UserError, match="puck-strking"):
        demonstrator("puck-strking", "expert")
    with pytest.raises(UserError, match="hand"):
        demonstrator("puck-striking", "hand")


@pytest.mark.slow
@pytest.mark.parametrize("level", ["expert", "suboptimal"])
def test_recordings_are_judged_by_the_tasks_own_score(level: str) -> None:
    """The same play: whoever hits has touched, and some only touch."""
    hit, touch = (
        demonstrator("dynamic-hitting", name).perform(200, np.random.default_rng(3))
        for name in (level, f"{level}-touch")
    )
    np.testing.assert_array_equal(hit.episodes.observations, touch.episodes.observations)
    assert (touch.episodes.returns() >= hit.episodes.returns()).all()
    assert touch.episodes.returns().sum() > hit.episodes.returns().sum()
    assert set(touch.outcomes[hit.outcomes == "touched only"]) == {SUCCESS}
    assert set(touch.outcomes[hit.outcomes == "missed"]) <= {"missed"}
