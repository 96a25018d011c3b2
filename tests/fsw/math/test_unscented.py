"""The unscented core against the Kalman filter and integrals; mistakes that are planted are caught."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp as _solve_ivp

from fsw.math.compiled import compiled, plain
from fsw.math.square_root import NOT_FINITE, OK, covariance_of
from fsw.math.two_body import gravity_parameter, noise_of_interval, two_body_motion
from fsw.math.unscented import (
    GATED,
    draw,
    factor_about,
    gain_columns,
    mean_of,
    measurement_update,
    residual,
    take_away,
    time_update,
    unscented_weights,
)
from messages.base import F64

solve_ivp: Any = _solve_ivp
N = 4
F = np.eye(N) + np.diag([0.1, 0.1], 2) + 0.02 * np.diag([1.0, -1.0, 1.0], 1)
Q = 1e-2 * np.array([[2.0, 0.3, 0.1, 0.0], [0.3, 1.0, 0.0, 0.2], [0.1, 0.0, 3.0, 0.4], [0.0, 0.2, 0.4, 1.0]])
H = np.array([[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.2, 0.0]])
R = np.array([[0.5, 0.4], [0.4, 1.0]])
P0 = np.diag([4.0, 9.0, 1.0, 1.0]) + 0.3


@compiled
def linear_motion(point: F64, dt: float, matrix: F64) -> int:
    """Multiply by the first rows of a matrix, whose last row is work; dt says nothing."""
    n = point.shape[0]
    for i in range(n):
        matrix[n, i] = 0.0
        for j in range(n):
            matrix[n, i] += matrix[i, j] * point[j]
    for i in range(n):
        point[i] = matrix[n, i]
    return OK


@compiled
def linear_measurement(point: F64, seen: F64, matrix: F64) -> int:
    """Multiply by a matrix; a NaN in it is a place from where nothing can be seen."""
    for k in range(seen.shape[0]):
        seen[k] = 0.0
        for j in range(point.shape[0]):
            seen[k] += matrix[k, j] * point[j]
    return 77 if np.isnan(matrix[0, 0]) else OK


@compiled
def steps(
    alpha: float,
    kappa: float,
    motion: F64,
    process: F64,
    matrix: F64,
    noise: F64,
    observed: F64,
    gate: float,
    x: F64,
    S: F64,
) -> tuple[int, float]:
    """A time update and a measurement update for each row of ``observed``; stops at the first that is not `OK`."""
    weights = unscented_weights(x.shape[0], alpha, 2.0, kappa)
    m = observed.shape[1]
    innovation, factor = np.empty(m), np.empty((m, m))
    code, nis = OK, 0.0
    for k in range(observed.shape[0]):
        code = time_update(linear_motion, 1.0, motion, weights, process, x, S)
        if code == OK:
            code, nis = measurement_update(
                linear_measurement, matrix, weights, noise, observed[k], gate, x, S, innovation, factor
            )
        if code != OK:
            break
    return code, nis


def work_row(matrix: F64) -> F64:
    return np.vstack([matrix, np.zeros(matrix.shape[1])])


def kalman(x: F64, P: F64, observed: F64, matrix: F64 = H, noise: F64 = R) -> tuple[F64, F64]:
    """The Kalman filter, by the book."""
    for z in observed:
        x, P = F @ x, F @ P @ F.T + Q
        K = P @ matrix.T @ np.linalg.inv(matrix @ P @ matrix.T + noise)
        x = x + K @ (z - matrix @ x)
        left = np.eye(N) - K @ matrix
        P = left @ P @ left.T + K @ noise @ K.T
    return x, P


def lower(matrix: F64) -> F64:
    return np.asarray(np.linalg.cholesky(matrix), np.float64)


def upper(matrix: F64) -> F64:
    return np.ascontiguousarray(lower(matrix).T)


def unscented(
    observed: F64,
    alpha: float = 1.0,
    kappa: float = 0.0,
    matrix: F64 = H,
    noise: F64 | None = None,
    process: F64 | None = None,
    S: F64 | None = None,
) -> tuple[F64, F64]:
    x, S = np.zeros(N), lower(P0) if S is None else S.copy()
    noise, process = upper(R) if noise is None else noise, upper(Q) if process is None else process
    code, _ = steps(alpha, kappa, work_row(F), process, matrix, noise, observed, np.inf, x, S)
    assert code == OK
    return x, S @ S.T


def measurements(count: int, rows: int = 2) -> F64:
    return np.random.default_rng(5).normal(size=(count, rows))


def difference(found: tuple[F64, F64], expected: tuple[F64, F64]) -> float:
    """Largest difference of state and covariance in units of the covariance."""
    sigma = np.sqrt(np.diag(expected[1]))
    off = (
        np.max(np.abs(found[0] - expected[0]) / sigma),
        np.max(np.abs(found[1] - expected[1]) / np.outer(sigma, sigma)),
    )
    return float(max(off))


@pytest.mark.parametrize(("alpha", "kappa", "tolerance"), [(1.0, 0.0, 1e-12), (0.5, -1.0, 1e-12), (0.02, 0.0, 1e-9)])
def test_linear_problems_give_the_kalman_filter(alpha: float, kappa: float, tolerance: float) -> None:
    z = measurements(60)
    assert difference(unscented(z, alpha, kappa), kalman(np.zeros(N), P0, z)) < tolerance


def test_partly_observed_problems_give_the_kalman_filter() -> None:
    """One number that never sees the last state directly, and none that sees it at all."""
    for row in ([[1.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0, 0.0]]):
        matrix, noise, z = np.array(row), np.array([[0.3]]), measurements(60, 1)
        expected = kalman(np.zeros(N), P0, z, matrix, noise)
        assert difference(unscented(z, matrix=matrix, noise=upper(noise)), expected) < 1e-12


def test_covariance_stays_positive_for_10000_steps() -> None:
    """A good sensor and little noise; the covariance is that of the Kalman filter's end."""
    z = measurements(10000)
    x, P = unscented(z)
    assert np.min(np.linalg.eigvalsh(P)) > 0.0
    assert difference((x, P), kalman(np.zeros(N), P0, z)) < 1e-12
    S = 1e3 * np.eye(N)
    code, _ = steps(1.0, 0.0, work_row(F), 1e-5 * np.eye(N), H, 1e-4 * np.eye(2), 0.0 * z, np.inf, np.zeros(N), S)
    assert code == OK
    assert np.min(np.diag(S)) > 0.0


@compiled
def without_drawing(motion: F64, process: F64, matrix: F64, noise: F64, z: F64, x: F64, S: F64) -> None:
    """One update whose measurement looks at the points of the time update, which do not know the process noise."""
    n, m = x.shape[0], z.shape[0]
    weights = unscented_weights(n, 1.0, 2.0, 0.0)
    points, seen, mean = np.empty((2 * n + 1, n)), np.empty((2 * n + 1, m)), np.empty(m)
    draw(x, S, weights[0], points)
    for i in range(2 * n + 1):
        linear_motion(points[i], 1.0, motion)
        linear_measurement(points[i], seen[i], matrix)
    mean_of(points, weights, x)
    mean_of(seen, weights, mean)
    factor, U = np.empty((m, m)), np.empty((n, m))
    factor_about(points, x, weights, 1.0, process, S, np.empty((3 * n, n)), np.empty((n, n)))
    factor_about(seen, mean, weights, 1.0, noise, factor, np.empty((2 * n + m, m)), np.empty((m, m)))
    gain_columns(points, x, seen, mean, weights, factor, U)
    take_away(S, U, np.empty(n))
    covariance_of(S.copy(), S)


def points_not_redrawn(z: F64) -> tuple[F64, F64]:
    x, S = np.zeros(N), lower(P0)
    for row in z:
        without_drawing(work_row(F), upper(Q), H, upper(R), row, x, S)
        S = lower(S)
    return x, S @ S.T


MISTAKES: dict[str, Callable[[F64], tuple[F64, F64]]] = {
    "measurement noise transposed": lambda z: unscented(z, noise=lower(R)),
    "process noise transposed": lambda z: unscented(z, process=lower(Q)),
    "variance given for sigma": lambda z: unscented(z, noise=R),
    "sigma given for variance": lambda z: unscented(z, process=upper(np.sqrt(np.diag(np.diag(Q))))),
    "wrong triangle": lambda z: unscented(z[:1], S=upper(P0)),
    "points not redrawn": points_not_redrawn,
}


@pytest.mark.parametrize("name", MISTAKES)
def test_planted_mistakes_are_caught(name: str) -> None:
    """The comparison with the Kalman filter, which the right filter passes at 1e-12, finds each by 1 % of sigma."""
    z = measurements(1 if name == "wrong triangle" else 60)
    assert difference(MISTAKES[name](z), kalman(np.zeros(N), P0, z)) > 1e-2
    assert difference(unscented(z), kalman(np.zeros(N), P0, z)) < 1e-12


@pytest.mark.parametrize(
    ("code", "changed"),
    [(GATED, {"gate": 1e-3}), (NOT_FINITE, {"observed": np.full((1, 2), np.nan)}), (77, {"matrix": np.nan * H})],
)
def test_failures_keep_the_prediction(code: int, changed: dict[str, Any]) -> None:
    given: dict[str, Any] = {"gate": np.inf, "observed": np.ones((1, 2)), "matrix": H, **changed}
    x, S = np.ones(N), lower(P0)
    found, nis = steps(
        1.0, 0.0, work_row(F), upper(Q), given["matrix"], upper(R), given["observed"], given["gate"], x, S
    )
    assert found == code
    assert (nis > 1e-3) == (code == GATED)
    np.testing.assert_allclose(x, F @ np.ones(N), rtol=1e-14)
    np.testing.assert_allclose(S @ S.T, F @ P0 @ F.T + Q, rtol=1e-13, atol=1e-14)


def test_failed_time_update_keeps_all() -> None:
    x, S = np.ones(N), lower(P0)
    code, _ = steps(1.0, 0.0, np.nan * work_row(F), upper(Q), H, upper(R), np.ones((1, 2)), np.inf, x, S)
    assert code == NOT_FINITE
    np.testing.assert_array_equal(x, np.ones(N))
    np.testing.assert_array_equal(S, lower(P0))


def test_weights_and_quadratic_functions() -> None:
    """Mean of a quadratic function of a normal variable is exact; so is its covariance for kappa = 3 - n."""
    for n, alpha, kappa in ((6, 1.0, -3.0), (9, 0.02, 0.0), (5, 1.0, 0.0)):
        gamma, mean0, cov0, w = plain(unscented_weights)(n, alpha, 2.0, kappa)
        assert abs(mean0 + 2 * n * w - 1.0) < 1e-12
        assert abs(2.0 * w * gamma**2 - 1.0) < 1e-12
        assert abs(cov0 - mean0 - (3.0 - alpha**2)) < 1e-9
    out = np.zeros(1)
    assert plain(residual)(linear_measurement, H[:1], np.array([3.0]), np.ones(N), out) == OK
    assert out[0] == 3.0 - 1.5


def test_two_body_motion_and_noise() -> None:
    """A step against DOP853 at the order of Runge and Kutta, and noise against the integral."""
    mu, state = 4.28e13, np.array([6.4e6, -6e5, -4e5, -260.0, -2360.0, -1530.0])

    def slope(_: float, y: F64) -> F64:
        return np.concatenate([y[3:], -mu * y[:3] / np.linalg.norm(y[:3]) ** 3])

    errors = list[float]()
    for dt in (40.0, 20.0):
        exact, found = solve_ivp(slope, (0.0, dt), state, "DOP853", rtol=1e-13, atol=1e-9).y[:, -1], state.copy()
        assert plain(two_body_motion)(found, dt, mu) == OK
        errors.append(float(np.linalg.norm(found[:3] - exact[:3])))
    assert 20.0 < errors[0] / errors[1] < 45.0
    assert plain(two_body_motion)(np.zeros(6), 1.0, mu) == NOT_FINITE
    assert np.isnan(plain(gravity_parameter)(12345, 0.0))
    assert plain(gravity_parameter)(499, 0.0) == 4.2828375816e13
    density, out, wanted = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) + 0.5, np.zeros((6, 6)), np.zeros((6, 6))
    plain(noise_of_interval)(density, 7.0, out)
    for node, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        carry = np.eye(6)
        carry[:3, 3:] = 3.5 * (node + 1.0) * np.eye(3)
        wanted += 3.5 * weight * carry @ density @ carry.T
    np.testing.assert_allclose(out, wanted, rtol=1e-13)
