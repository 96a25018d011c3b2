"""xoshiro256++ against published output; the normal distribution against scipy's, by 4 million draws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from fsw.math.compiled import COMPILE, compiled
from fsw.math.random import next_word, normal, uniform
from messages.base import F64, U64

EDGE = 3.6541528853610088
COUNT = 4_000_000 if COMPILE else 4_000


@compiled
def draw(stream: U64, out: F64) -> None:
    for i in range(out.shape[0]):
        out[i] = normal(stream)


@pytest.fixture(scope="module")
def sample() -> F64:
    out = np.empty(COUNT)
    with np.errstate(over="ignore"):
        draw(np.array([1, 2, 3, 4], np.uint64), out)
    return out


def test_words_against_published_output() -> None:
    """Output of the authors' C code for the state 1, 2, 3, 4, as the reference test of Rust's rand_xoshiro has it."""
    stream = np.array([1, 2, 3, 4], np.uint64)
    expected = [
        41943041,
        58720359,
        3588806011781223,
        3591011842654386,
        9228616714210784205,
        9973669472204895162,
        14011001112246962877,
        12406186145184390807,
        15849039046786891736,
        10450023813501588000,
    ]
    with np.errstate(over="ignore"):
        assert [int(next_word(stream)) for _ in expected] == expected


def test_words_against_unbounded_integers() -> None:
    """The recurrence of Blackman and Vigna (2021) written with Python integers, 1000 steps."""
    stream = np.array([2**64 - 1, 3, 2**63 + 17, 0x0123456789ABCDEF], np.uint64)
    s = [int(x) for x in stream]
    mask = 2**64 - 1
    with np.errstate(over="ignore"):
        for _ in range(1000):
            total = (s[0] + s[3]) & mask
            expected = ((((total << 23) & mask) | (total >> 41)) + s[0]) & mask
            t = (s[1] << 17) & mask
            s[2] ^= s[0]
            s[3] ^= s[1]
            s[1] ^= s[2]
            s[0] ^= s[3]
            s[2] ^= t
            s[3] = ((s[3] << 45) & mask) | (s[3] >> 19)
            assert int(next_word(stream)) == expected


def test_uniform_is_the_top_53_bits() -> None:
    with np.errstate(over="ignore"):
        a, b = np.array([5, 6, 7, 8], np.uint64), np.array([5, 6, 7, 8], np.uint64)
        values = [uniform(a) for _ in range(1000)]
        assert values == [(int(next_word(b)) >> 11) / 2**53 for _ in range(1000)]
    assert 0.0 <= min(values) < 0.01
    assert 0.99 < max(values) < 1.0


def test_moments(sample: F64) -> None:
    """Mean, variance, third and fourth moment within 4 standard errors."""
    n = len(sample)
    for power, expected, variance in [(1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)]:
        assert abs(np.mean(sample**power) - expected) < 4 * math.sqrt(variance / n)


def test_distribution(sample: F64) -> None:
    """Chi-squared over 400 cells of equal chance, and the tails, where the ziggurat uses another rule."""
    counts, _ = np.histogram(stats.norm.cdf(sample), np.linspace(0, 1, 401 if COMPILE else 21))
    assert 1e-4 < stats.chisquare(counts).pvalue < 1 - 1e-4
    for low, high in [(EDGE, math.inf), (-math.inf, -EDGE), (4.2, math.inf), (EDGE - 0.2, EDGE)]:
        expected = (stats.norm.cdf(high) - stats.norm.cdf(low)) * len(sample)
        found = np.count_nonzero((sample > low) & (sample < high))
        assert abs(found - expected) < 4 * math.sqrt(expected) + 1


def test_draws_are_independent(sample: F64) -> None:
    """No correlation at lags 1 to 8, nor between the sizes of neighbours."""
    for x in (sample, sample**2 - 1.0):
        power = np.mean(x * x)
        for lag in range(1, 9):
            assert abs(np.mean(x[lag:] * x[:-lag])) / power < 4.5 / math.sqrt(len(x))
