"""What a run's evaluations are reduced to: by name, by step, and start by start."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from fractions import Fraction
from random import Random

import pytest
from helpers_records import endings, make_counted, make_record
from hypothesis import given, settings
from hypothesis import strategies as st

from lfobench.errors import UserError
from lfobench.record import Evaluation, Record
from lfobench.score import HEADLINE, SUCCESS_RATE, Statistic, mean, parse_statistic, tie

STEPS = (1000, 2000, 3000, 4000, 5000, 6000)
EVERY = (HEADLINE, Statistic("last"), Statistic("best"), Statistic("at", 3000))

returns = st.lists(st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3), min_size=len(STEPS), max_size=len(STEPS))


def record(of_evaluations: Sequence[Sequence[float]], **options: object) -> Record:
    """Reference returns are 0 and 1000, so a score is a tenth of a return."""
    evaluations = [
        Evaluation(step=step, returns=list(episodes), lengths=[10] * len(episodes))
        for step, episodes in zip(STEPS, of_evaluations, strict=False)
    ]
    return make_record(0.0, **options).model_copy(update={"evaluations": evaluations})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("last5", Statistic("last5")),
        ("last", Statistic("last")),
        ("best", Statistic("best")),
        ("success", SUCCESS_RATE),
        ("at:10000", Statistic("at", 10_000)),
        (" at: 7 ", Statistic("at", 7)),
    ],
)
def test_what_is_parsed_is_written_as_it_was(text: str, expected: Statistic) -> None:
    assert parse_statistic(text) == expected
    assert parse_statistic(str(expected)) == expected


@pytest.mark.parametrize(
    "text", ["", "mean", "last 5", "LAST", "at", "at:", "at:-1", "at:1.5", "at:x", "at:1:2", "last:3"]
)
def test_anything_else_is_refused_with_what_is_known(text: str) -> None:
    with pytest.raises(UserError, match=r"Unknown statistic '.*'\. Known: last5, last, best, at:STEP") as refused:
        parse_statistic(text)
    assert f"'{text}'" in str(refused.value)


def test_each_counts_its_own_evaluations() -> None:
    scores = [99.0, 10.0, 20.0, 30.0, 40.0, 50.0]
    chosen = {str(statistic): statistic.choose(STEPS, scores) for statistic in EVERY}
    assert chosen == {"last5": [1, 2, 3, 4, 5], "last": [5], "best": [0], "at:3000": [2]}
    assert HEADLINE.choose(STEPS[:2], scores[:2]) == [0, 1]
    assert Statistic("at", 7).choose(STEPS, scores) == []


@given(returns)
@settings(max_examples=30)
def test_the_score_is_the_mean_of_what_counts(of_evaluations: list[list[float]]) -> None:
    run = record(of_evaluations)
    scores = [statistics.fmean(episodes) / 10 for episodes in of_evaluations]
    assert run.score() == pytest.approx(statistics.fmean(scores[-5:]), rel=1e-9, abs=1e-9)
    assert run.score(Statistic("last")) == pytest.approx(scores[-1], rel=1e-9, abs=1e-9)
    assert run.score(Statistic("best")) == pytest.approx(max(scores), rel=1e-9, abs=1e-9)
    assert run.score(Statistic("at", 2000)) == pytest.approx(scores[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("statistic", EVERY, ids=str)
@given(of_evaluations=returns)
@settings(max_examples=15)
def test_the_starts_have_the_score_as_their_mean(statistic: Statistic, of_evaluations: list[list[float]]) -> None:
    run = record(of_evaluations)
    starts = run.start_scores(statistic)
    assert len(starts) == 3
    assert statistics.fmean(starts) == pytest.approx(run.score(statistic), rel=1e-9, abs=1e-6)


def test_a_start_is_followed_through_the_evaluations() -> None:
    run = record([[0.0, 1000.0], [100.0, 800.0]])
    assert run.start_scores() == pytest.approx([5.0, 90.0])
    assert run.start_scores(Statistic("at", 2000)) == pytest.approx([10.0, 80.0])


def test_evaluations_of_different_episodes_have_a_score_and_no_starts() -> None:
    run = record([[0.0, 1000.0, 500.0], [100.0]])
    assert run.score() == pytest.approx(30.0)
    assert run.start_scores() == []
    assert run.start_scores(Statistic("last")) == pytest.approx([10.0])


@pytest.mark.parametrize("statistic", EVERY, ids=str)
def test_a_diverged_run_scores_zero_from_every_start(statistic: Statistic) -> None:
    run = record([[500.0, 500.0, 500.0]], diverged_at=1500)
    assert run.score(statistic) == 0.0
    assert run.start_scores(statistic) == [0.0, 0.0, 0.0]
    assert run.counted(statistic) == []
    before_any = record([], diverged_at=10)
    assert before_any.score(statistic) == 0.0
    assert before_any.start_scores(statistic) == [0.0] * 10, "as many as its protocol has episodes"


def test_a_step_without_an_evaluation_names_the_run_and_the_steps_there_are() -> None:
    run = record([[1.0], [2.0]], seed=4)
    with pytest.raises(
        UserError,
        match=r"dilo on hopper-random-expert, seed 4, was not evaluated at step 1500\. It was at 1000, 2000\.",
    ):
        run.score(Statistic("at", 1500))


def test_success_counts_the_last_policys_episodes_from_all_starts() -> None:
    run = make_counted(endings(7, 10), endings(31, 100), evaluations=4)
    assert run.score(SUCCESS_RATE) == pytest.approx(100.0 * 38 / 110)
    starts = run.start_scores(SUCCESS_RATE)
    assert (len(starts), set(starts), sum(starts)) == (110, {0.0, 100.0}, 3800.0)
    assert [score for _, score in run.curve(SUCCESS_RATE)] == [0.0, 0.0, 0.0, 70.0]
    diverged = make_counted(endings(7, 10), endings(31, 100), diverged_at=9)
    assert (diverged.score(SUCCESS_RATE), diverged.start_scores(SUCCESS_RATE)) == (0.0, [0.0] * 110)


def test_success_of_a_record_that_does_not_say_names_it() -> None:
    with pytest.raises(UserError, match="dilo on hopper-random-expert, seed 0, does not say how its episodes ended"):
        make_record(50.0).score(SUCCESS_RATE)


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=9), st.randoms())
def test_a_mean_is_exact_in_any_order_and_never_leaves_its_numbers(values: list[float], random: Random) -> None:
    found = mean(values)
    assert min(values) <= found <= max(values)
    assert mean(random.sample(values, len(values))) == found
    exact = sum(map(Fraction, values)) / len(values)
    assert abs(Fraction(found) - exact) <= Fraction(2.0**-51) * abs(exact) + Fraction(5e-324) * 2 ** len(values)


def test_scores_are_means_of_exact_sums() -> None:
    """The same evaluations and the same episodes in another order."""
    episodes = [[281.0, 293.1, 317.3], [309.2, 316.4, 300.1], [12.7, 31.9, 44.3]]
    shuffled = [[317.3, 281.0, 293.1], [44.3, 12.7, 31.9], [300.1, 309.2, 316.4]]
    assert record(episodes).score() == record(shuffled).score()
    assert record([[0.1, 0.2, 0.3]]).score() == record([[0.3, 0.2, 0.1]]).score()


def test_of_evaluations_that_rounding_alone_tells_apart_the_first_is_the_best() -> None:
    assert Statistic("best").choose(STEPS, [1.0, 30.3, 30.3 + 7e-15, 2.0, 30.3, 0.0]) == [1]
    assert Statistic("best").choose(STEPS, [1.0, 30.3, 30.3 + 1e-3, 2.0, 30.3, 0.0]) == [2]
    assert tie([30.0]) < 1e-3
