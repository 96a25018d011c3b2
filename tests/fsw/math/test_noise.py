"""Discretised noise against mpmath and against sums over shorter steps."""

from __future__ import annotations

from typing import Any

import mpmath as _mpmath
import numpy as np
import pytest

from fsw.math.noise import gauss_markov_factors, mean_of_walk, random_walk, walk_spreads
from fsw.streams import stream_words
from messages.base import F64, U64

mp: Any = _mpmath
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")  # words wrap around, uncompiled


def stream() -> U64:
    return stream_words(1, "test", "noise")


@pytest.mark.parametrize("dt", [1e-9, 1e-3, 1.0, 50.0, 1e4])
def test_gauss_markov_factors_against_mpmath(dt: float) -> None:
    """Also where 1 - exp(-2 dt / tau) cancels; rounding dt / tau moves the exponential by that many times as much."""
    with mp.workdps(40):
        x = mp.mpf(dt) / mp.mpf(7)
        exact = [float(mp.exp(-x)), float(mp.sqrt(1 - mp.exp(-2 * x)))]
    np.testing.assert_allclose(gauss_markov_factors(dt, 7.0), exact, rtol=2.3e-16 * (1.0 + dt / 7.0), atol=1e-300)


def test_two_half_steps_are_one_step() -> None:
    """Of a Gauss-Markov process: same correlation, same variance."""
    for dt in (0.01, 1.0, 30.0):
        keep, fresh = gauss_markov_factors(dt, 7.0)
        half_keep, half_fresh = gauss_markov_factors(dt / 2, 7.0)
        assert keep == pytest.approx(half_keep**2, rel=1e-15)
        assert fresh**2 == pytest.approx((half_keep * half_fresh) ** 2 + half_fresh**2, rel=1e-14)


def test_first_value_comes_from_the_stationary_distribution() -> None:
    assert gauss_markov_factors(-1.0, 7.0) == (0.0, 1.0)


def test_random_walk_stands_still_before_the_first_interval() -> None:
    assert random_walk(stream(), 3.0, 0.5, -1.0) == 3.0
    assert random_walk(stream(), 3.0, 0.0, 10.0) == 3.0
    assert random_walk(stream(), 3.0, 0.5, 10.0) != 3.0


def test_mean_of_walk_against_many_short_steps() -> None:
    """Covariance of new bias and mean: of 40,000 draws, and by the sum over 1,000 short steps as a matrix product."""
    white, walk, dt, n = 0.3, 0.2, 5.0, 1000
    words = stream()
    drawn = np.array([mean_of_walk(words, 0.0, *walk_spreads(white, walk, dt)) for _ in range(40_000)])
    h = dt / n
    to_bias: F64 = np.concatenate([np.full(n, walk * np.sqrt(h)), np.zeros(n)])
    # a step at the middle of the k-th interval acts on the rest of the mean
    to_mean: F64 = np.concatenate(
        [walk * np.sqrt(h) * (1.0 - (np.arange(n) + 0.5) / n), np.full(n, white * np.sqrt(h) / dt)]
    )
    effect = np.stack([to_bias, to_mean])
    expected = effect @ effect.T
    found = drawn.T @ drawn / len(drawn)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(found - expected) / scale) < 4.0 * np.sqrt(2.0 / 40_000)
