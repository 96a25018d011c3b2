"""The extended core against the textbook's formulas by numpy, and against the information form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fsw.math.extended import GATED, compress, covariance_time, kalman_update
from fsw.math.square_root import NOT_FINITE, NOT_POSITIVE, OK
from messages.base import F64

ALL = np.ones(6, bool)


def covariance(rng: np.random.Generator, n: int) -> F64:
    """A random one, with scales over six decades."""
    a = rng.normal(size=(n, 2 * n)) * 10.0 ** rng.uniform(-3.0, 3.0, (n, 1))
    return a @ a.T


def test_time_update_is_that_of_the_textbook() -> None:
    """Phi P Phi' + Q, and exactly symmetric."""
    rng = np.random.default_rng(1)
    Phi, Q, P = rng.normal(size=(6, 6)), covariance(rng, 6), covariance(rng, 6)
    expected = Phi @ P @ Phi.T + Q
    assert covariance_time(Phi, Q, P) == OK
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(P - expected) / scale) < 1e-14
    assert np.array_equal(P, P.T)


@pytest.mark.parametrize("m", [1, 2, 5])
def test_update_is_the_information_form(m: int) -> None:
    """P+^-1 = P^-1 + H' R^-1 H, dx = P+ H' R^-1 y."""
    rng = np.random.default_rng(m)
    a = rng.normal(size=(6, 9))
    P, H, R, y = a @ a.T, rng.normal(size=(m, 6)), covariance(rng, m), rng.normal(size=m)
    after = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.solve(R, H))
    S = H @ P @ H.T + R
    dx = np.empty(6)
    code, nis = kalman_update(P, H, R, y, math.inf, ALL, dx)
    assert code == OK
    assert nis == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-9)
    np.testing.assert_allclose(P, after, atol=1e-10 * np.max(np.abs(after)))
    expected = after @ H.T @ np.linalg.solve(R, y)
    np.testing.assert_allclose(dx, expected, atol=1e-9 * np.max(np.abs(expected)))


def test_considered_states_stay_and_count() -> None:
    """Schmidt's filter: the blocks of his paper, for a bias that the measurement contains."""
    rng = np.random.default_rng(4)
    a = rng.normal(size=(6, 9))
    P, H, R, y = a @ a.T, rng.normal(size=(2, 6)), np.diag([0.3, 0.5]), rng.normal(size=2)
    before, estimated = P.copy(), np.array([True] * 4 + [False] * 2)
    Hx, Hc = H[:, :4], H[:, 4:]
    Pxx, Pxc, Pcc = before[:4, :4], before[:4, 4:], before[4:, 4:]
    S = Hx @ Pxx @ Hx.T + Hx @ Pxc @ Hc.T + Hc @ Pxc.T @ Hx.T + Hc @ Pcc @ Hc.T + R
    K = (Pxx @ Hx.T + Pxc @ Hc.T) @ np.linalg.inv(S)
    dx = np.empty(6)
    assert kalman_update(P, H, R, y, math.inf, estimated, dx)[0] == OK
    np.testing.assert_allclose(dx, [*(K @ y), 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(P[4:, 4:], before[4:, 4:], rtol=1e-13)
    np.testing.assert_allclose(P[:4, 4:], Pxc - K @ (Hx @ Pxc + Hc @ Pcc), atol=1e-12)
    np.testing.assert_allclose(P[:4, :4], Pxx - K @ S @ K.T, atol=1e-11)


def test_refusals_leave_the_estimate() -> None:
    """Gated, NaN, and an indefinite covariance."""
    P, R, H, dx = np.eye(6), np.eye(1), np.ones((1, 6)), np.full(6, 9.0)
    cases = [(np.array([30.0]), R, GATED), (np.array([math.nan]), R, NOT_FINITE), (np.ones(1), -9 * R, NOT_POSITIVE)]
    for residual, noise, expected in cases:
        assert kalman_update(P, H, noise, residual, 16.0, ALL, dx)[0] == expected
        assert np.array_equal(P, np.eye(6))
        assert np.all(dx == 9.0)
    assert covariance_time(np.full((6, 6), math.inf), np.eye(6), P) == NOT_FINITE
    assert np.array_equal(P, np.eye(6))


def test_compression_keeps_the_information() -> None:
    """An update by 200 rows and by the triangle of them are the same; also where a direction is not seen."""
    rng = np.random.default_rng(7)
    rows = rng.normal(size=(200, 7))
    rows[:, 3] = 0.0
    a = rng.normal(size=(6, 9))
    P = a @ a.T
    many, few, dx, dx_few = P.copy(), P.copy(), np.empty(6), np.empty(6)
    assert kalman_update(many, rows[:, :6], np.eye(200), rows[:, 6], math.inf, ALL, dx)[0] == OK
    H, residual = np.empty((6, 6)), np.empty(6)
    assert compress(rows, np.empty((7, 7)), H, residual) == OK
    assert kalman_update(few, H, np.eye(6), residual, math.inf, ALL, dx_few)[0] == OK
    np.testing.assert_allclose(few, many, atol=1e-11)
    np.testing.assert_allclose(dx_few, dx, atol=1e-12)
