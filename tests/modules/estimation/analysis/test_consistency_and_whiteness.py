"""Bands against published figures and simulation, whiteness against hand sums, and that bad input is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2 as _chi2
from scipy.stats import kstest as _kstest

from messages.base import F64
from modules.estimation.analysis import band, nees, nis, whiteness

chi2: Any = _chi2
kstest: Any = _kstest
P = np.array([[4.0, 1.5, 0.0], [1.5, 1.0, 2e-4], [0.0, 2e-4, 1e-6]])
ROOT = np.linalg.cholesky(P)


def drawn(seed: int, runs: int, epochs: int, root: F64 = ROOT) -> F64:
    return np.random.default_rng(seed).normal(size=(runs, epochs, len(root))) @ root.T


@pytest.mark.parametrize(
    ("degrees", "runs", "low", "high"),
    [
        (12, 50, 10.68, 13.40),
        (12, 100, 11.06, 12.98),
        (12, 200, 11.33, 12.69),
        (6, 100, 5.34, 6.70),
        (15, 100, 13.95, 16.09),
        (2, 50, 1.484, 2.591),  # Bar-Shalom et al. (2001), sec. 5.4.2: 50 runs, two components, [1.5, 2.6]
    ],
)
def test_bands_are_those_of_the_tables(degrees: int, runs: int, low: float, high: float) -> None:
    np.testing.assert_allclose(band(degrees, runs), (low, high), atol=0.006)


def test_values_and_counts() -> None:
    errors = drawn(1, 40, 7)
    found = nees(errors, P)
    wanted = np.einsum("rki,ij,rkj->rk", errors, np.linalg.inv(P), errors)
    np.testing.assert_allclose(found.values, wanted, rtol=1e-9)
    np.testing.assert_allclose(found.mean, wanted.mean(axis=0))
    assert (found.low[0], found.high[0]) == band(3, 40) == (found.total_low, found.total_high)
    many = nis(errors, np.broadcast_to(P, (7, 3, 3)))
    assert (many.total_low, many.total_high) == band(3, 280)
    assert many.name == "NIS" and many.total_mean == found.total_mean


def test_bands_hold_what_they_say() -> None:
    """300 experiments of 30 runs: 95 % of the means inside, to four standard deviations of such a count."""
    inside = [nees(drawn(seed, 30, 1), P).consistent for seed in range(300)]
    assert abs(np.mean(inside) - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 300)
    fractions = [nees(drawn(seed, 30, 40), P).inside for seed in range(50)]
    assert abs(np.mean(fractions) - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 2000)


def test_correlated_epochs_do_not_narrow_the_band() -> None:
    """An error that stays as it is: epochs say nothing new. Counting them would call a right filter wrong."""
    found = [nees(np.repeat(drawn(seed, 50, 1), 30, axis=1), P) for seed in range(200)]
    assert np.mean([x.consistent for x in found]) > 0.9
    narrow = band(3, 50 * 30)
    assert np.mean([narrow[0] < x.total_mean < narrow[1] for x in found]) < 0.5
    covered = [x.interval()[0] < 3.0 < x.interval()[1] for x in found]
    assert abs(np.mean(covered) - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 200)


def test_a_wrong_covariance_is_said_with_its_factor() -> None:
    exact = np.array([[[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]]] * 40) * np.sqrt(3.0) @ ROOT.T
    assert nees(exact, P).total_mean == pytest.approx(3.0)
    assert "overconfident: the covariance is too small by a factor of 2 " in str(nees(exact, P / 2.0))
    assert "cautious: the covariance is too large by a factor of 3" in str(nees(exact, P * 3.0))
    assert "consistent" in str(nees(drawn(3, 100, 4), P))


def test_missing_epochs() -> None:
    errors = drawn(4, 20, 5)
    errors[3, 2, 1] = np.nan
    errors[:, 4] = np.nan
    with pytest.raises(ValueError, match=r"NEES: 21 of 100 epochs are not finite, the first is run 0, epoch 4"):
        nees(errors, P)
    found = nees(errors, P, missing="omit")
    assert found.missing == 21
    assert found.counted.tolist() == [20, 20, 19, 20, 0]
    assert (found.low[2], found.high[2]) == band(3, 19)
    assert np.isnan(found.mean[4])
    assert "21 left out" in str(found)
    stated = np.broadcast_to(P, (20, 5, 3, 3)).copy()
    stated[1, 1] = np.nan
    assert nees(np.ones((20, 5, 3)), stated, missing="omit").missing == 1
    with pytest.raises(ValueError, match="100 of 100"):
        nees(np.full((20, 5, 3), np.nan), P, missing="omit")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda p: np.diag([1.0, 2.0, 0.0]), "run 0, epoch 0 has the diagonal"),
        (lambda p: p - 2.0 * np.diag(np.diag(p)), "above zero"),
        (np.tril, "not symmetric, by 0.75"),
        (lambda p: p + 1.9 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]), "eigenvalue of its correlations is -0.7"),
        (lambda p: p[:2, :2], "do not fit"),
    ],
)
def test_bad_covariances_are_refused(change: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        nees(drawn(1, 4, 2), change(P))


def test_the_bad_covariance_is_found() -> None:
    stated = np.broadcast_to(P, (4, 6, 3, 3)).copy()
    stated[2, 5, 0, 0] = -1.0
    with pytest.raises(ValueError, match="run 2, epoch 5"):
        nees(drawn(1, 4, 6), stated)
    with pytest.raises(ValueError, match=r"for one run give v\[None\]"):
        nees(drawn(1, 4, 6)[0], stated)


def test_badly_scaled_covariances() -> None:
    """Metres of 1e7 beside 1e-9 rad."""
    d = np.array([1e7, 1.0, 1e-9])
    scaled = np.outer(d, d) * P
    np.testing.assert_allclose(nees(drawn(5, 9, 3) * d, scaled).values, nees(drawn(5, 9, 3), P).values, rtol=1e-9)


def test_ljung_box_by_hand_and_by_distribution() -> None:
    """One series: n (n + 2) sum r^2 / (n - k). White series: p values are uniform. Two lags of a known sum."""
    x = drawn(6, 1, 50, np.eye(1))
    r = [float(np.sum(x[0, k:] * x[0, : 50 - k]) / np.sum(x * x)) for k in (1, 2, 3)]
    wanted = 50 * 52 * sum(v * v / (50 - k) for k, v in zip((1, 2, 3), r, strict=True))
    found = whiteness(x, np.eye(1), lags=3)
    assert abs(found.statistic - wanted) < 1e-10
    assert abs(found.p_value - chi2.sf(wanted, 3)) < 1e-12
    p = [whiteness(drawn(seed, 20, 30), P, lags=5).p_value for seed in range(300)]
    assert kstest(p, "uniform").pvalue > 1e-3
    inside = [whiteness(drawn(seed, 20, 30), P, lags=5).inside for seed in range(300)]
    assert abs(np.mean(inside) - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 1500)


def test_coloured_innovations_are_seen() -> None:
    """A first-order process: its correlation is 0.4 to the power of the lag."""
    noise, x = drawn(7, 200, 40, np.eye(2)), np.zeros((200, 40, 2))
    x[:, 0] = noise[:, 0]
    for k in range(1, 40):
        x[:, k] = 0.4 * x[:, k - 1] + np.sqrt(1.0 - 0.16) * noise[:, k]
    found = whiteness(x, np.eye(2), lags=3)
    np.testing.assert_allclose(found.correlation, [0.4, 0.16, 0.064], atol=0.02)
    assert not found.white and found.p_value < 1e-12 and "not white" in str(found)
    # the wrong size of a covariance is none of its business
    assert whiteness(noise, 9.0 * np.eye(2)).white


def test_whiteness_with_missing_epochs() -> None:
    x = drawn(8, 30, 40)
    x[2, 10] = np.nan
    with pytest.raises(ValueError, match="1 of 1200 epochs"):
        whiteness(x, P)
    found = whiteness(x, P, lags=2, missing="omit")
    assert found.pairs.tolist() == [30 * 39 - 2, 30 * 38 - 2]
    assert found.white and found.missing == 1
    for lags in (0, 40):
        with pytest.raises(ValueError, match="lags need more"):
            whiteness(x, P, lags=lags, missing="omit")
    with pytest.raises(ValueError, match="do not vary"):
        whiteness(np.zeros((3, 20, 3)), P)
