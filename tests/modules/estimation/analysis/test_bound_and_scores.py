"""The bound against Kalman filter, whole trajectories, closed forms and the Riccati equation; scores by simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag as _block_diag
from scipy.linalg import solve_discrete_are as _solve_discrete_are

from messages.base import F64
from modules.estimation.analysis import (
    Bound,
    bound_history,
    divergences,
    efficiency,
    failure_bound,
    time_to_converge,
)

block_diag: Any = _block_diag
solve_discrete_are: Any = _solve_discrete_are


def system(rng: np.random.Generator, n: int, m: int, rank: int) -> tuple[F64, F64, F64, F64]:
    """Phi, Q of a rank, H, R."""
    root, noise = rng.normal(size=(n, rank)), rng.normal(size=(m, m))
    return (
        np.eye(n) + 0.3 * rng.normal(size=(n, n)),
        root @ root.T,
        rng.normal(size=(m, n)),
        noise @ noise.T + np.eye(m),
    )


def kalman(P: F64, steps: list[Any]) -> list[F64]:
    out = list[F64]()
    for Phi, Q, seen in steps:
        P = Phi @ P @ Phi.T + Q
        for H, R in seen:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            left = np.eye(len(P)) - K @ H
            P = left @ P @ left.T + K @ R @ K.T
        out.append(P)
    return out


def apart(P: F64, wanted: F64) -> float:
    d = np.sqrt(np.diag(wanted))
    return float(np.max(np.abs(P - wanted) / np.outer(d, d)))


@pytest.mark.parametrize(("n", "m", "rank"), [(4, 2, 4), (6, 3, 2), (5, 1, 0), (12, 2, 3)])
@pytest.mark.parametrize("bad", [False, True])
def test_linear_systems_give_the_kalman_filter(n: int, m: int, rank: int, bad: bool) -> None:
    """Also with singular and no process noise, and with states of 1e7 beside such of 1e-9."""
    rng = np.random.default_rng(n)
    steps = [
        (Phi, Q, [(H, R), (H[:1] @ Phi, R[:1, :1])]) for Phi, Q, H, R in [system(rng, n, m, rank) for _ in range(25)]
    ]
    root = rng.normal(size=(n, n))
    P0 = root @ root.T + np.eye(n)
    wanted = kalman(P0, steps)
    d = np.logspace(7, -9, n) if bad else np.ones(n)
    scaled = [(np.outer(d, 1 / d) * F, np.outer(d, d) * Q, [(H / d, R) for H, R in seen]) for F, Q, seen in steps]
    history = bound_history(Bound(np.outer(d, d) * P0), scaled, {"all": range(n), "first": [0]})
    for P, W in zip(history.P, wanted, strict=True):
        assert apart(P / np.outer(d, d), W) < 1e-10
    np.testing.assert_allclose(history.sigma["first"], d[0] * np.sqrt([W[0, 0] for W in wanted]), rtol=1e-9)


def test_steady_state_of_a_slowly_varying_frequency() -> None:
    """Phase and frequency of one tone, the kind of example of the 1998 paper: the Riccati equation gives the limit."""
    Phi, Q, H, R = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.0, 1e-6]), np.array([[1.0, 0.0]]), np.array([[0.05]])
    before = solve_discrete_are(Phi.T, H.T, Q, R)
    limit = np.linalg.inv(np.linalg.inv(before) + H.T @ H / R)
    bound = Bound(np.eye(2))
    for _ in range(2000):
        bound.predict(Phi, Q)
        bound.measure(H, R)
    assert apart(bound.covariance(), limit) < 1e-9


def test_information_of_the_whole_trajectory() -> None:
    """The definition: the last block of the inverse of the information matrix of all epochs together."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3))
    P0, epochs = root @ root.T + np.eye(3), 7
    one, general = Bound(P0), Bound(P0)
    J = np.zeros((3 * (epochs + 1), 3 * (epochs + 1)))
    J[:3, :3] = np.linalg.inv(P0)
    for k in range(epochs):
        Phi, Q, H, R = system(rng, 3, 2, 3)
        p = float(rng.uniform(0.2, 1.0))
        W = np.asarray(np.linalg.inv(Q), np.float64)
        D11, D12, D22 = Phi.T @ W @ Phi, -Phi.T @ W, W
        at, after = slice(3 * k, 3 * k + 3), slice(3 * k + 3, 3 * k + 6)
        J[at, at] += D11
        J[at, after] += D12
        J[after, at] += D12.T
        J[after, after] += D22 + p * H.T @ np.linalg.inv(R) @ H
        one.predict(Phi, Q)
        general.predict_blocks(D11, D12, D22)
        for bound in (one, general):
            bound.measure(H, R, p)
    wanted = np.asarray(np.linalg.inv(J), np.float64)[-3:, -3:]
    assert apart(one.covariance(), wanted) < 1e-9
    assert apart(general.covariance(), wanted) < 1e-9


def test_growth_model_with_averages_over_trajectories() -> None:
    """The growth model of Kitagawa, where Phi passes through zero and cannot be inverted."""
    rng, q, r = np.random.default_rng(4), 10.0, 1.0
    x, J, bound = np.zeros(20000), 1.0 / 5.0, Bound(np.array([[5.0]]))
    x += np.sqrt(5.0) * rng.normal(size=x.size)
    for k in range(15):
        slope = 0.5 + 25.0 * (1.0 - x * x) / (1.0 + x * x) ** 2
        D11, D12 = np.mean(slope**2) / q, -np.mean(slope) / q
        x = 0.5 * x + 25.0 * x / (1.0 + x * x) + 8.0 * np.cos(1.2 * k) + np.sqrt(q) * rng.normal(size=x.size)
        seen = np.mean((x / 10.0) ** 2) / r
        J = 1.0 / q + seen - D12**2 / (J + D11)
        bound.predict_blocks(np.array([[D11]]), np.array([[D12]]), np.array([[1.0 / q]]))
        bound.measure(np.array([[np.sqrt(seen * r)]]), np.array([[r]]))
        assert abs(bound.covariance()[0, 0] * J - 1.0) < 1e-12
    with pytest.raises(ValueError, match="cannot be inverted"):
        bound.predict(np.zeros((1, 1)), np.eye(1))


def cross(v: F64) -> F64:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def camera_rows(points: F64, focal: float) -> tuple[F64, F64]:
    """H_r and H_theta of landmarks (k, 3) in camera axes, which are those of body and inertial frame too."""
    H_r, H_t = list[F64](), list[F64]()
    for x, y, z in points:
        D = focal / z * np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z]])
        H_r.append(-D)
        H_t.append(D @ cross(np.array([x, y, z])))
    return np.vstack(H_r), np.vstack(H_t)


def grid(w: float, far: float, side: int) -> F64:
    g = w * (2.0 * (np.arange(side) + 0.5) / side - 1.0)
    x, y = np.meshgrid(g, g)
    return far * np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)


@pytest.mark.parametrize(("field", "gsd"), [(3.5, 15.0), (11.7, 50.0)])
def test_static_pose_has_its_closed_forms(field: float, gsd: float) -> None:
    """One image at nadir over flat ground: tilt, lateral, altitude and twist, correlation 1 - rho^2 = w^4 / 5.

    The closed forms are the leading order in w; terms of order w^2 (1 % at 11.7 degrees) and those of the grid remain.
    """
    far, sigma, w, N = 500e3, 0.5, np.tan(np.radians(field / 2)), 50 * 50
    f = far / gsd
    H_r, H_t = camera_rows(grid(w, far, 50), f)
    bound = Bound(None, scale=np.array([1e3] * 3 + [1e-3] * 3))
    batches = np.split(np.hstack([H_r, H_t]), 50)
    for H in batches:
        bound.measure(H, sigma**2 * np.eye(len(H)))
    P = bound.covariance()
    s = np.sqrt(np.diag(P))
    tilt = np.sqrt(5.0) * sigma / (f * w**2 * np.sqrt(N))
    tolerance = 0.002 + 1.2 * w * w
    for found, wanted in (
        (s[3], tilt),
        (s[4], tilt),
        (s[0], far * tilt * (1.0 + w * w / 3.0)),
        (s[2], np.sqrt(1.5) * far * sigma / (f * w * np.sqrt(N))),
        (s[5], np.sqrt(1.5) * sigma / (f * w * np.sqrt(N))),
        ((1.0 - P[0, 4] ** 2 / (P[0, 0] * P[4, 4])) ** 0.25, (w**4 / 5.0) ** 0.25),
    ):
        assert abs(found / wanted - 1.0) < tolerance
    # with the attitude known, and with the position known; the prior of the rest is wide
    for known, sigma_known, other, factor in (([3, 4, 5], 1e-5, 0, far), ([0, 1, 2], 5.0, 4, 1.0 / far)):
        P0 = np.diag([1e14] * 3 + [1.0] * 3)
        P0[known, known] = sigma_known**2
        alone = Bound(P0)
        for H in batches:
            alone.measure(H, sigma**2 * np.eye(len(H)))
        pixel = (far if other == 0 else 1.0) * sigma / f
        wanted = np.hypot(factor * sigma_known, pixel / np.sqrt(N))
        assert abs(np.sqrt(alone.covariance()[other, other]) / wanted - 1.0) < 0.02


def test_nuisance_states_are_appended_and_not_shown() -> None:
    """Misalignment beside attitude: the marginal equals that of one large problem; without it the bound is too good."""
    rng, P0, B = np.random.default_rng(5), np.diag([4.0, 9.0, 1.0]), np.array([[0.3, 0.1], [0.1, 0.5]])
    bound, large, blind = Bound(P0, nuisance=B), Bound(block_diag(P0, B)), Bound(P0)
    for _ in range(5):
        Phi, Q, H, R = system(rng, 3, 2, 2)
        G, W = rng.normal(size=(2, 2)), 0.01 * np.eye(2)
        bound.predict(Phi, Q, nuisance=(0.9 * np.eye(2), W))
        large.predict(block_diag(Phi, 0.9 * np.eye(2)), block_diag(Q, W))
        blind.predict(Phi, Q)
        bound.measure(H, R, 0.7, nuisance=G)
        large.measure(np.hstack([H, G]), R, 0.7)
        blind.measure(H, R, 0.7)
    assert apart(bound.covariance(True), large.covariance()) < 1e-12
    assert bound.covariance().shape == (3, 3)
    assert np.all(np.diag(bound.covariance()) > np.diag(blind.covariance()))
    assert bound.sigma([0, 1]) == pytest.approx(np.sqrt(np.trace(large.covariance()[:2, :2])))
    np.testing.assert_allclose(bound.information() @ bound.covariance(True), np.eye(5), atol=1e-9)


def test_a_missed_measurement_tells_nothing() -> None:
    bound = Bound(np.eye(2))
    before = bound.covariance()
    bound.measure(np.ones((1, 2)), np.eye(1), detection=0.0)
    np.testing.assert_allclose(bound.covariance(), before, rtol=1e-14)


def test_bad_matrices_are_refused() -> None:
    bound = Bound(np.eye(2))
    for action, text in (
        (lambda: Bound(-np.eye(2)), "above zero"),
        (lambda: Bound(np.array([[1.0, 2.0], [2.0, 1.0]])), "not positive definite"),
        (lambda: Bound(None), "give scale"),
        (lambda: bound.predict(np.eye(3), np.eye(2)), r"Phi: expected finite numbers \(2, 2\)"),
        (lambda: bound.predict(np.eye(2), -np.eye(2)), "negative eigenvalue"),
        (lambda: bound.predict(np.eye(2), np.full((2, 2), np.nan)), "NaN"),
        (lambda: bound.measure(np.eye(2), np.zeros((2, 2))), "R: covariance"),
        (lambda: bound.measure(np.eye(2), np.eye(2), 1.2), "expected 0 to 1"),
        (lambda: Bound(None, scale=np.ones(2)).covariance(), "singular"),
        (lambda: bound_history(bound, [], {}), "no steps"),
    ):
        with pytest.raises(ValueError, match=text):
            action()
    np.testing.assert_allclose(bound.covariance(), np.eye(2), rtol=1e-14)


def test_efficiency_and_its_interval() -> None:
    """Errors of the bound's own size, correlated in time: 95 % of the intervals hold 1, whatever the correlation."""
    held, ratios, freedoms = list[bool](), list[float](), list[float]()
    P = np.broadcast_to(np.diag([4.0, 1.0, 0.5]), (20, 3, 3))
    for seed in range(300):
        rng = np.random.default_rng(seed)
        e = np.repeat(rng.normal(size=(100, 1, 3)) @ np.diag([2.0, 1.0, 0.5**0.5]), 20, axis=1)
        found = efficiency(e, P)
        held.append(found.low < 1.0 < found.high)
        ratios.append(found.eta)
        freedoms.append(found.freedom)
    assert abs(np.mean(held) - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 300)
    # Satterthwaite's degrees of freedom of the three, and the scatter that they predict
    nu = 5.5**2 / (4.0**2 + 1.0 + 0.25)
    assert abs(np.mean(freedoms) / nu - 1.0) < 0.1
    assert abs(np.std(ratios) * np.sqrt(2 * 100 * nu) - 1.0) < 0.15


def test_efficiency_in_words() -> None:
    rng = np.random.default_rng(1)
    e, P = rng.normal(size=(200, 10, 2)), np.broadcast_to(np.eye(2), (10, 2, 2))
    assert str(efficiency(e, P)).endswith("at the bound")
    assert str(efficiency(2.0 * e, P)).endswith("above the bound")
    assert "no success" in str(efficiency(0.5 * e, P))
    assert efficiency(e, P).eta == pytest.approx(np.sqrt(np.mean(np.sum(e[:, 5:] ** 2, axis=2)) / 2.0))
    for bad in (e[:1], e[0], np.full_like(e, np.nan)):
        with pytest.raises(ValueError, match="efficiency"):
            efficiency(bad, P)


def test_failures_have_an_upper_bound() -> None:
    """None in N: 1 - 0.05^(1/N), that is 3.0, 1.0 and 0.3 %; two in ten: 0.5069 in tables."""
    for runs, wanted in ((100, 0.0295), (300, 0.00994), (1000, 0.00299)):
        assert abs(failure_bound(0, runs) - (1.0 - 0.05 ** (1.0 / runs))) < 1e-12
        assert abs(failure_bound(0, runs) - wanted) < 1e-4
    assert abs(failure_bound(2, 10) - 0.5069) < 5e-5
    assert failure_bound(5, 5) == 1.0
    with pytest.raises(ValueError, match="failed"):
        failure_bound(3, 2)


def test_divergences_and_convergence() -> None:
    found = divergences(np.array([1.0, 4.9, 5.1, np.nan, 11.0]), np.array([1.0, 1.0, 1.0, 1.0, 9.0]), limit=10.0)
    assert found.which == (2, 3, 4)
    assert str(found).startswith("3/5 diverged")
    errors = np.array([[[9.0, 0.0], [0.0, 3.0], [1.0, 1.0], [1.5, 0.0]]])
    times, sigma = np.array([0.0, 10.0, 20.0, 30.0]), np.ones(4)
    assert time_to_converge(times, errors, sigma) == 20.0
    assert np.isnan(time_to_converge(times, 9.0 * errors, sigma))
    assert time_to_converge(times, 0.1 * errors, sigma) == 0.0
