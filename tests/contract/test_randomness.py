from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare, kstest

from lfobench.randomness import Randomness, philox

WORD = 2**32

words = st.integers(0, WORD - 1)
seeds = st.lists(words, min_size=1, max_size=5)
steps = st.integers(0, 2**40)
counts = st.integers(1, 40)
purposes = st.sampled_from(["policy: offline rows", "policy: expert rows", "smoothing", ""])

# Random123, tests/kat_vectors: philox 4x32, 10 rounds; counter, key, result.
KNOWN_ANSWERS = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]


def philox_in_integers(counter: tuple[int, ...], key: tuple[int, ...]) -> tuple[int, ...]:
    """Philox-4x32-10 of Salmon et al. 2011 in Python's unbounded integers."""
    x0, x1, x2, x3 = counter
    k0, k1 = key
    for number in range(10):
        if number:
            k0, k1 = (k0 + 0x9E3779B9) % WORD, (k1 + 0xBB67AE85) % WORD
        high0, low0 = divmod(0xD2511F53 * x0, WORD)
        high1, low1 = divmod(0xCD9E8D57 * x2, WORD)
        x0, x1, x2, x3 = high1 ^ x1 ^ k0, low1, high0 ^ x3 ^ k1, low0
    return x0, x1, x2, x3


def philox_in_tensors(counter: tuple[int, ...], key: tuple[int, ...]) -> tuple[int, ...]:
    c0, c1, c2, c3, k0, k1 = (torch.tensor(word, dtype=torch.int64) for word in (*counter, *key))
    return tuple(int(word) for word in philox((c0, c1, c2, c3), (k0, k1)))


# --- the generator ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("implementation", [philox_in_tensors, philox_in_integers])
@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_known_answers(implementation: object, counter: str, key: str, answer: str) -> None:
    given_counter, given_key, expected = (
        tuple(int(word, 16) for word in text.split()) for text in (counter, key, answer)
    )
    assert implementation(given_counter, given_key) == expected  # type: ignore[operator]


@given(st.tuples(words, words, words, words), st.tuples(words, words))
def test_agrees_with_unbounded_integers(counter: tuple[int, ...], key: tuple[int, ...]) -> None:
    assert philox_in_tensors(counter, key) == philox_in_integers(counter, key)


# --- what a draw depends on -------------------------------------------------------------------------------------


@given(seeds, purposes, steps, counts)
def test_words_are_32_bit_and_repeat(seeds: list[int], purpose: str, step: int, count: int) -> None:
    drawn = Randomness(seeds).words(purpose, step, count)
    assert drawn.shape == (len(seeds), count)
    assert 0 <= int(drawn.min()) <= int(drawn.max()) < WORD
    assert torch.equal(drawn, Randomness(seeds).words(purpose, step, count))


@given(seeds, purposes, steps, counts, counts)
def test_a_longer_draw_starts_with_the_shorter(
    seeds: list[int], purpose: str, step: int, first: int, second: int
) -> None:
    short, long = sorted((first, second))
    randomness = Randomness(seeds)
    assert torch.equal(randomness.words(purpose, step, long)[:, :short], randomness.words(purpose, step, short))


@pytest.mark.slow
@given(seeds, purposes, steps, counts)
def test_a_seed_draws_the_same_alone_and_beside_others(seeds: list[int], purpose: str, step: int, count: int) -> None:
    together = Randomness(seeds)
    for place, seed in enumerate(seeds):
        alone = Randomness([seed])
        assert torch.equal(together.words(purpose, step, count)[place], alone.words(purpose, step, count)[0])
        assert torch.equal(together.normal(purpose, step, count)[place], alone.normal(purpose, step, count)[0])
        assert torch.equal(together.uniform(purpose, step, count)[place], alone.uniform(purpose, step, count)[0])
        assert torch.equal(
            together.integers(purpose, step, count, 997)[place], alone.integers(purpose, step, count, 997)[0]
        )


@given(seeds, purposes, st.lists(steps, min_size=1, max_size=6), counts)
def test_many_steps_at_once_draw_what_each_draws_alone(
    seeds: list[int], purpose: str, steps: list[int], count: int
) -> None:
    randomness = Randomness(seeds)
    at_once = torch.tensor(steps)
    words, integers = (
        randomness.words(purpose, at_once, count),
        randomness.integers(purpose, at_once, count, 1009),
    )
    uniform, normal = randomness.uniform(purpose, at_once, count), randomness.normal(purpose, at_once, count)
    for place, step in enumerate(steps):
        assert torch.equal(words[place], randomness.words(purpose, step, count))
        assert torch.equal(integers[place], randomness.integers(purpose, step, count, 1009))
        assert torch.equal(uniform[place], randomness.uniform(purpose, step, count))
        assert torch.equal(normal[place], randomness.normal(purpose, step, count))


def test_seeds_purposes_steps_and_indices_all_change_the_words() -> None:
    randomness = Randomness([0, 1, 2**31, WORD - 1])
    drawn = torch.stack(
        [
            randomness.words(purpose, torch.tensor([0, 1, 2, 2**32, 2**33 + 1]), 50)
            for purpose in ("policy: offline rows", "policy: expert rows", "policy sample")
        ]
    )
    # 3 x 5 x 4 x 50 words out of 2**32: a repetition by chance has probability 1e-3, and this is one fixed draw.
    assert len(torch.unique(drawn)) == drawn.numel()


def test_words_are_the_generator_at_counter_index_and_step_with_key_seed_and_purpose() -> None:
    import zlib

    seed, step, purpose = 12345, 2**34 + 7, "policy: offline rows"
    drawn = Randomness([seed]).words(purpose, step, 12)[0].tolist()
    expected: list[int] = []
    for block in range(3):
        counter = (block, step % WORD, step // WORD, 0)
        expected += philox_in_integers(counter, (seed, zlib.crc32(purpose.encode())))
    assert drawn == expected


# --- distributions ----------------------------------------------------------------------------------------------


@given(seeds, steps, counts, st.integers(1, WORD - 1))
def test_integers_stay_below_their_bound(seeds: list[int], step: int, count: int, bound: int) -> None:
    drawn = Randomness(seeds).integers("rows", step, count, bound)
    assert 0 <= int(drawn.min()) <= int(drawn.max()) < bound
    words = Randomness(seeds).words("rows", step, count)
    assert drawn.flatten().tolist() == [word * bound // WORD for word in words.flatten().tolist()]


@pytest.mark.parametrize("bound", [0, -1, WORD])
def test_bounds_that_words_cannot_reach_are_refused(bound: int) -> None:
    with pytest.raises(ValueError, match="bound"):
        Randomness([0]).integers("rows", 0, 4, bound)


@pytest.mark.parametrize("bound", [2, 10, 999, 1000])
def test_integers_are_uniform(bound: int) -> None:
    drawn = Randomness([0, 1]).integers("rows", torch.arange(200), 1000, bound)
    for place in range(2):
        observed = np.bincount(drawn[:, place].flatten().numpy(), minlength=bound)
        assert chisquare(observed).pvalue > 1e-3


def test_integers_of_neighbouring_steps_and_seeds_are_independent() -> None:
    drawn = Randomness([0, 1]).integers("rows", torch.arange(400), 500, 8)
    here, beside = drawn[:-1, 0].flatten().numpy(), drawn[1:, 0].flatten().numpy()
    other = drawn[:-1, 1].flatten().numpy()
    for first, second in ((here, beside), (here, other), (here[:-1], here[1:])):
        observed = np.bincount(first * 8 + second, minlength=64)
        assert chisquare(observed).pvalue > 1e-3


def test_uniform_is_open_and_uniform() -> None:
    drawn = Randomness([3]).uniform("gradient penalty", torch.arange(200), 1000)
    assert drawn.dtype == torch.float32
    assert 0.0 < float(drawn.min()) < float(drawn.max()) < 1.0
    assert kstest(drawn.flatten().numpy(), "uniform").pvalue > 1e-3


def test_uniform_stays_inside_at_the_extreme_words(monkeypatch: pytest.MonkeyPatch) -> None:
    randomness = Randomness([0])
    monkeypatch.setattr(randomness, "words", lambda *_: torch.tensor([[0, WORD - 1]]))
    low, high = randomness.uniform("any", 0, 2)[0].tolist()
    assert 0.0 < low < 1e-7
    assert 1.0 - 1e-6 < high < 1.0
    assert torch.isfinite(randomness.normal("any", 0, 2)).all()


def test_normal_has_the_moments_and_the_shape_of_a_standard_normal() -> None:
    drawn = Randomness([3]).normal("policy sample", torch.arange(400), 1000).double().flatten().numpy()
    count = len(drawn)
    for power, moment, variance in ((1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)):
        assert abs((drawn**power).mean() - moment) < 4.0 * math.sqrt(variance / count)
    assert kstest(drawn, "norm").pvalue > 1e-3
    pairs = drawn.reshape(-1, 2)
    assert abs(np.corrcoef(pairs[:, 0], pairs[:, 1])[0, 1]) < 4.0 / math.sqrt(len(pairs))
    assert abs(np.corrcoef(pairs[:, 0] ** 2, pairs[:, 1] ** 2)[0, 1]) < 4.0 / math.sqrt(len(pairs))


@given(seeds, st.integers(0, 1000), st.integers(1, 300))
def test_permutation_holds_every_index_once_per_seed(seeds: list[int], step: int, count: int) -> None:
    order = Randomness(seeds).permutation("expert pass", step, count)
    assert torch.equal(order.sort(-1).values, torch.arange(count).expand(len(seeds), count))


def test_permutations_put_every_index_everywhere_equally_often() -> None:
    randomness = Randomness(list(range(50)))
    orders = torch.cat([randomness.permutation("expert pass", step, 6) for step in range(200)])
    for place in range(6):
        assert chisquare(np.bincount(orders[:, place].numpy(), minlength=6)).pvalue > 1e-4
