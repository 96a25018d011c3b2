"""All filter cores on linear problems: they are the Kalman filter, and their covariance lasts 10,000 steps.

Exact covariances come from a Kalman filter in rational or in 50-digit arithmetic, which loses nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest

from fsw.math.compiled import compiled
from fsw.math.extended import covariance_time, kalman_update
from fsw.math.square_root import OK
from fsw.math.unscented import Weights, measurement_update, time_update, unscented_weights
from messages.base import F64
from modules.estimation.analysis import (
    ExtendedFilter,
    Problem,
    UnscentedFilter,
    linear_problem,
    orbit_problem,
    partly_observed_problem,
    scaled_problem,
)
from modules.estimation.analysis.problems import moving, seeing

CORES: dict[str, Callable[[Problem], Any]] = {
    "extended": ExtendedFilter,
    "unscented": UnscentedFilter,
    "unscented, alpha 0.02": lambda p: UnscentedFilter(p, 0.02),
    "unscented, kappa 3 - n": lambda p: UnscentedFilter(p, kappa=3.0 - len(p.x0)),
}


def unobserved_problem() -> Problem:
    """One number of which two states are in no way part: they are never seen."""
    base = partly_observed_problem()
    A, H = np.zeros((4, 4)), np.array([[1.0, 0.0, 0.0, 0.0]])
    A[0, 2], A[1, 3] = 1.0, 1.0
    F = lambda dt: np.eye(4) + dt * A  # noqa: E731 (a formula)
    return dataclasses.replace(
        base,
        name="two states of four not observed",
        motion=lambda x, dt: F(dt) @ x,
        measure=lambda x: H @ x,
        kernels=(moving, (A, 0.0), seeing, (H, False)),
    )


LINEAR = {p.name: p for p in (linear_problem(), partly_observed_problem(), unobserved_problem(), scaled_problem())}


def exact(problem: Problem, steps: list[tuple[float, F64]]) -> tuple[F64, F64]:
    """Estimate and covariance of the Kalman filter by the book, in 50 digits."""
    with mpmath.workdps(50):
        M = lambda a: mpmath.matrix(np.atleast_2d(a).tolist())  # noqa: E731 (a name for a conversion)
        x, P, R, H = M(problem.x0).T, M(problem.P0), M(problem.R), M(problem.H(problem.x0))
        for dt, z in steps:
            F = M(problem.F(problem.x0, dt))
            x, P = F * x, F * P * F.T + M(problem.noise(dt))
            K = P * H.T * mpmath.inverse(H * P * H.T + R)
            x, P = x + K * (M(z).T - H * x), P - K * H * P
        n = len(problem.x0)
        return (
            np.array([float(x[i]) for i in range(n)]),
            np.array([[float(P[i, j]) for j in range(n)] for i in range(n)]),
        )


def driven(problem: Problem, count: int) -> list[tuple[float, F64]]:
    """Intervals of three lengths, and measurements of a truth."""
    rng, out = np.random.default_rng(9), list[tuple[float, F64]]()
    truth = problem.x0 + np.linalg.cholesky(problem.P0) @ rng.normal(size=len(problem.x0))
    for k in range(count):
        dt = problem.dt * (1.0, 0.5, 2.0)[k % 3]
        truth = problem.motion(truth, dt)
        out.append((dt, problem.measure(truth) + np.linalg.cholesky(problem.R) @ rng.normal(size=len(problem.R))))
    return out


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("core", CORES)
def test_cores_are_the_kalman_filter_on_linear_problems(core: str, name: str) -> None:
    """To 1e-10 sigma; on the badly scaled one (1e7 m beside 1e-9 rad, variances that fall by 1e14) to what is stated.

    An alpha of 0.02 has weights of 5000, and so four digits fewer.
    """
    problem = LINEAR[name]
    made, steps = CORES[core](problem), driven(problem, 40)
    for dt, z in steps:
        made.predict(dt)
        made.update(z, problem.R)
    x, P = exact(problem, steps)
    sigma = np.sqrt(np.diag(P))
    off = max(np.max(np.abs(made.x - x) / sigma), np.max(np.abs(made.P - P) / np.outer(sigma, sigma)))
    badly = name == "badly scaled"
    tolerance = {"unscented, alpha 0.02": 1e-7}.get(core, 1e-10) * (1e4 if badly else 1.0)
    assert off < tolerance, f"{off:.2g}"


@compiled
def unscented_steps(count: int, dt: float, A: F64, Q: F64, H: F64, R: F64, weights: Weights, x: F64, S: F64) -> int:
    """Updates with measurements of zero, as only the covariance matters; the number of the one that fails."""
    m = R.shape[0]
    z, innovation, factor = np.zeros(m), np.empty(m), np.empty((m, m))
    for k in range(count):
        code = time_update(moving, dt, (A, 0.0), weights, Q, x, S)
        if code == OK:
            code, _ = measurement_update(seeing, (H, False), weights, R, z, 1e300, x, S, innovation, factor)
        if code != OK or not np.all(np.isfinite(S)):
            return k
    return count


@compiled
def extended_steps(count: int, F: F64, Q: F64, H: F64, R: F64, P: F64) -> int:
    """The same for the extended core; also stops where a variance is not positive or P is not symmetric to the bit."""
    n, m = P.shape[0], R.shape[0]
    zero, dx, all_of_them = np.zeros(m), np.empty(n), np.ones(n, np.bool_)
    for k in range(count):
        code = covariance_time(F, Q, P)
        if code == OK:
            code, _ = kalman_update(P, H, R, zero, 1e300, all_of_them, dx)
        if code != OK:
            return k
        for i in range(n):
            for j in range(n):
                if not P[i, i] > 0.0 or P[i, j] != P[j, i]:
                    return k
    return count


def least_eigenvalue(P: F64) -> float:
    """Of the correlations."""
    d = np.sqrt(np.diag(P))
    return float(np.linalg.eigvalsh(P / np.outer(d, d))[0])


SETTINGS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "little process noise": {"noise": 1e-8},
    "no process noise": {"noise": 0.0},
    "a precise sensor": {"R": 1e-12},
    "a wild prior": {"P0": 1e10},
}


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("name", LINEAR)
def test_covariance_lasts_10000_steps(name: str, setting: str) -> None:
    """Positive definite, and where there is a steady state, the two cores agree about it.

    The limit is beyond these: at 1e-18 of the sensors' variances the downdate of the unscented core fails and says so.
    """
    problem, change = LINEAR[name], SETTINGS[setting]
    n, dt = len(problem.x0), problem.dt
    F, H = problem.F(problem.x0, dt), problem.H(problem.x0)
    Q, R, P0 = (getattr(problem, k) if k != "noise" else problem.noise(dt) for k in ("noise", "R", "P0"))
    Q, R, P0 = Q * change.get("noise", 1.0), R * change.get("R", 1.0), P0 * change.get("P0", 1.0)
    P, S, x = P0.copy(), np.linalg.cholesky(P0), problem.x0.copy()
    assert problem.kernels is not None
    A = problem.kernels[1][0]
    root = UnscentedFilter(problem).noise_factor
    weights = unscented_weights(n, 1.0, 2.0, 0.0)
    assert unscented_steps(10_000, dt, A, root(Q), H, root(R), weights, x, S) == 10_000
    assert extended_steps(10_000, F, Q, H, R, P) == 10_000
    assert np.min(np.abs(np.diag(S))) > 0.0
    # without process noise a mode that decays has no variance in the end: a triangle holds it, P only to rounding
    floor = 0.0 if change.get("noise", 1.0) > 0.0 else -1e-14
    assert least_eigenvalue(P) > floor
    assert least_eigenvalue(S @ S.T) > floor
    if setting == "as it is" and "not observed" not in name:  # two ways of computing agree
        d = np.sqrt(np.diag(P))
        assert np.max(np.abs(P - S @ S.T) / np.outer(d, d)) < 1e-7


def test_orbit_model_and_kernels_agree_with_the_problem() -> None:
    """The compiled functions of the problems are the plain ones."""
    for problem in (linear_problem(), partly_observed_problem(), scaled_problem()):
        assert problem.kernels is not None
        motion, motion_args, measure, measure_args = problem.kernels
        point, seen = problem.x0 + 0.3 * np.sqrt(np.diag(problem.P0)), np.empty(len(problem.R))
        wanted = problem.motion(point, 0.37)
        assert measure(point, seen, measure_args) == OK
        np.testing.assert_allclose(seen, problem.measure(point), rtol=1e-13)
        assert motion(point, 0.37, motion_args) == OK
        np.testing.assert_allclose(point, wanted, rtol=1e-13)
    mu = 4.2828375816e13
    orbit = orbit_problem(mu)
    energy = lambda x: 0.5 * x[3:] @ x[3:] - mu / np.linalg.norm(x[:3])  # noqa: E731 (a formula)
    x = orbit.x0
    for _ in range(10):
        x = orbit.motion(x, 60.0)
    assert abs(energy(x) / energy(orbit.x0) - 1.0) < 1e-10
