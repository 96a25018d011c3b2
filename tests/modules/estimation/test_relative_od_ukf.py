"""RelativeOdUkf against Basilisk, the Kalman filter, Kepler's equation, and statistics; bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fsw import OutPort, s
from fsw.math.compiled import plain
from fsw.math.kepler import elements_to_rv, mean_to_true, rv_to_elements, true_to_mean
from fsw.math.two_body import noise_of_interval, two_body_motion
from messages.base import F64
from messages.filters import OpNavFilterMsg
from messages.opnav import OpNavMsg
from modules.estimation.relative_od_ukf import RelativeOdUkf, status
from modules.estimation.relative_od_ukf.basilisk import basilisk_motion, gravity_km
from modules.opnav.basilisk import body_of
from tests.modules.estimation.filter_truth import (
    DENSITY,
    DIRECTIONS,
    FRAMES,
    MU,
    RANGES,
    SPREAD,
    STEP,
    Criterion,
    histories,
    normalised,
    outside_band,
    position_message,
    relative_error,
    square,
    triangle,
    vectors,
)
from tests.modules.opnav.disk_truth import sources

R0, V0 = np.array([6.4e6, -6e5, -4e5]), np.array([-260.0, -2360.0, -1530.0])
P0 = np.diag([1e8] * 3 + [100.0] * 3)
NO_NOISE = np.zeros((6, 6))
Wired = tuple[RelativeOdUkf, OutPort[OpNavMsg]]


def wired(**params: Any) -> Wired:
    start: dict[str, Any] = {"body_id": 499, "r_CP_N": R0, "v_CP_N": V0, "P": P0, "process_noise": NO_NOISE}
    ukf = RelativeOdUkf("ukf", RelativeOdUkf.Params(**{**start, **params}))
    return ukf, sources(ukf)["in_position"]


def as_basilisk(cfg: dict[str, Any]) -> Wired:
    x = np.array(cfg["stateInit"], np.float64)
    return wired(
        basilisk=True,
        body_id=body_of(cfg["planetIdInit"]),
        r_CP_N=x[:3],
        v_CP_N=x[3:],
        P=square(cfg["covarInit"], 6),
        process_noise=square(cfg["qNoise"], 6),
        alpha=cfg["alpha"],
        beta=cfg["beta"],
        kappa=float(cfg["kappa"]),
        noise_scale=float(cfg["noiseSF"]),
    )


def position(r: F64, P: F64, exposure_ns: int, **more: Any) -> OpNavMsg:
    nav: dict[str, Any] = {"r_BN_N": r, "covar_N": P, "planetID": 2, "valid": 1}
    return position_message(nav, exposure_ns=exposure_ns, **more)


def step(ukf: RelativeOdUkf, t_ns: int) -> OpNavFilterMsg:
    ukf.step(t_ns)
    message = ukf.out_filter.latest()
    assert message is not None
    return message


def test_basilisk_methods(criterion: Criterion) -> None:
    for case in vectors("relative_od_ukf")["state_prop"]:
        state = np.array(case["state"], np.float64)
        mu = gravity_km(body_of(case["planetId"]))
        plain(basilisk_motion)(state, float(case["dt"]), mu)
        criterion("ODUKF-1", float(np.max(np.abs(state / case["out"] - 1.0))))
        plain(two_body_motion)(state, -float(case["dt"]), mu)
        np.testing.assert_allclose(state, case["state"], rtol=1e-9, atol=0)


def test_basilisk_propagation(criterion: Criterion) -> None:
    case = vectors("relative_od_ukf")["propagation"]
    ukf, _ = as_basilisk(case["cfg"])
    for k in range(361):
        ukf.step(s(10 * k))
        if k % 36 == 0:
            criterion("ODUKF-2", relative_error(ukf.state.x, case["state"][k // 36]))
            criterion("ODUKF-2", relative_error(triangle(ukf.state.S), case["sBar"][k // 36]))


@pytest.mark.parametrize("number", range(4))
def test_basilisk_updates(criterion: Criterion, number: int) -> None:
    """Full covariances, planets that change, bad and late measurements, noiseSF."""
    case = vectors("relative_od_ukf")["histories"][number]
    ukf, port = as_basilisk(case["cfg"])
    for k, now in enumerate(case["steps"]):
        if "nav" in now:
            port.write(position_message(now["nav"]), now["timeWritten"])
        message = step(ukf, now["callTime"])
        if k % 5 == 0:
            out = case["out"][k // 5]
            criterion("ODUKF-3", relative_error(triangle(ukf.state.S), out["sBar"]))
            criterion("ODUKF-3", relative_error(ukf.state.x, out["state"]))
            criterion("ODUKF-3", relative_error(message.P.ravel(), out["msg_covar"]))
            assert ukf.state.time == out["timeTag"]
            np.testing.assert_allclose(message.x, out["msg_state"], rtol=1e-8, atol=0)
            np.testing.assert_allclose(message.residual, out["postFitRes"], rtol=0, atol=1e-3)


def energy(x: F64) -> float:
    return float(0.5 * x[3:6] @ x[3:6] - MU / np.linalg.norm(x[:3]))


@pytest.mark.parametrize("basilisk", [False, True])
def test_pure_propagation(criterion: Criterion, basilisk: bool) -> None:
    """An hour of the filter's own state against Kepler's equation; the spread is small, so the mean is an orbit."""
    mu = 42828.314e9 if basilisk else MU
    ukf, _ = wired(basilisk=basilisk, P=1e-6 * np.eye(6), process_noise=1e-30 * np.eye(6))
    for k in range(360):
        step(ukf, s(10 * k))
    message = step(ukf, s(3600))
    elements = plain(rv_to_elements)(tuple(R0), tuple(V0), mu)
    a, e, f = elements[0], elements[1], elements[5]
    later = plain(mean_to_true)(plain(true_to_mean)(f, e) + np.sqrt(mu / a**3) * 3600.0, e)
    r, v = plain(elements_to_rv)((*elements[:5], later), mu)
    criterion("ODUKF-4", float(np.linalg.norm(message.x[:3] - r) / np.linalg.norm(r)))
    criterion("ODUKF-4", float(np.linalg.norm(message.x[3:] - v) / np.linalg.norm(v)))
    change = 0.5 * message.x[3:] @ message.x[3:] - mu / np.linalg.norm(message.x[:3])
    start = 0.5 * V0 @ V0 - mu / np.linalg.norm(R0)
    criterion("ODUKF-5", float(change / start - 1.0))


def test_process_noise_does_not_depend_on_steps(criterion: Criterion) -> None:
    """One interval, many calls, or steps of another length give one covariance; a call without time adds nothing."""
    Q = np.diag([1e-4] * 3 + [1e-6] * 3)
    whole, parts = np.zeros((6, 6)), np.zeros((6, 6))
    noise_of_interval(Q, 100.0, whole)
    carry = np.eye(6)
    carry[:3, 3:] = 25.0 * np.eye(3)
    for _ in range(4):
        piece = np.zeros((6, 6))
        noise_of_interval(Q, 25.0, piece)
        parts = carry @ parts @ carry.T + piece
    criterion("ODUKF-6", relative_error(parts, whole))
    far = {"mu": 1e-9, "r_CP_N": 1e-4 * R0, "v_CP_N": np.zeros(3), "process_noise": Q, "P": 1e-6 * np.eye(6)}
    once, often = wired(**far, max_step=100.0)[0], wired(**far)[0]
    step(once, s(100))
    for k in range(101):
        step(often, s(k))
    np.testing.assert_allclose(step(often, s(100)).P, step(once, s(100)).P, rtol=1e-6, atol=1e-12)


def run(far: float, direction: F64, runs: int, seed: int, basilisk: bool = False) -> tuple[list[float], float]:
    """NEES of position and velocity at the end of each run, and the position's RMS [m].

    Measurements are as a converter's: 35 to 350 times less sure along the line of sight than across it.
    """
    rng = np.random.default_rng(seed)
    guess, truth = histories(far, direction, runs, rng)
    Q = DENSITY[:6, :6].copy()
    if basilisk:  # the same noise for each of its calls of 60 s; it adds it twice
        noise_of_interval(0.5 * DENSITY[:6, :6], STEP, Q)
        Q *= 1e-6
    nees, squares = list[float](), list[float]()
    for i in range(runs):
        ukf, port = wired(
            basilisk=basilisk,
            r_CP_N=guess[i, :3],
            v_CP_N=guess[i, 3:6],
            P=np.diag(SPREAD[:6] ** 2),
            process_noise=Q,
            alpha=0.02 if basilisk else 1.0,
        )
        for k in range(FRAMES):
            r, t = truth[k, i, :3], s((k + 1) * STEP)
            u = r / np.linalg.norm(r)
            P = far**2 * (2.5e-7 * np.eye(3) + 2.5e-3 * (3.4e6 / far) ** -2 * 1e-2 * np.outer(u, u))
            port.write(position(r + np.linalg.cholesky(P) @ rng.normal(size=3), P, t), t)
            step(ukf, t)
        message = ukf.out_filter.latest()
        assert message is not None
        error = message.x - truth[-1, i, :6]
        nees.append(normalised(error, message.P))
        squares.append(float(error[:3] @ error[:3]))
    return nees, float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize("far", RANGES)
def test_consistency(criterion: Criterion, far: float) -> None:
    """Few runs, one direction; the test of 100 runs is slow."""
    nees, _ = run(far, DIRECTIONS[0], 20, 1)
    criterion("ODUKF-7", outside_band(nees, 6))


@pytest.mark.slow
@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("far", RANGES)
def test_consistency_of_100_runs(criterion: Criterion, far: float, direction: F64) -> None:
    nees, rms = run(far, direction, 100, 2)
    criterion("ODUKF-8", outside_band(nees, 6))
    as_is, rms_as_is = run(far, direction, 100, 2, basilisk=True)
    criterion("ODUKF-9", float(np.mean(as_is)))
    criterion("ODUKF-10", rms / rms_as_is)


def good(t: float = 10.0, **more: Any) -> OpNavMsg:
    return position(np.array([6.397e6, -6.236e5, -4.152e5]), 1e4 * np.eye(3), s(t), **more)


BAD: dict[str, tuple[int, dict[str, Any]]] = {
    "invalid": (status.INVALID, {"valid": False}),
    "other body": (status.OTHER_BODY, {"body_id": 399}),
    "unknown body": (status.OTHER_BODY, {"body_id": 0}),
    "NaN": (status.BAD_NUMBERS, {"r_CP_N": np.array([np.nan, 0.0, 0.0])}),
    "NaN covariance": (status.BAD_NUMBERS, {"P_rr_N": np.full((3, 3), np.nan)}),
    "zero covariance": (status.BAD_NUMBERS, {"P_rr_N": np.zeros((3, 3))}),
    "indefinite covariance": (status.BAD_NUMBERS, {"P_rr_N": np.diag([1.0, -1.0, 1.0])}),
    "future": (status.FROM_FUTURE, {"exposure_ns": s(11)}),
    "before the start": (status.TOO_LATE, {"exposure_ns": -1}),
    "far off": (status.GATED, {"r_CP_N": np.array([9e6, 0.0, 0.0])}),
    "overflow": (status.FAILED_UPDATE, {"r_CP_N": np.array([1e300, 0.0, 0.0])}),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_measurements_leave_the_prediction(kind: str) -> None:
    expected, changed = BAD[kind]
    (ukf, port), (free, _) = wired(), wired()
    message = good()
    fields = {f: getattr(message, f) for f in message.__struct_fields__}
    port.write(OpNavMsg(**{**fields, **changed}), s(10))
    refused = step(ukf, s(10))
    assert (refused.status, refused.refused, refused.used) == (expected, 1, 0)
    np.testing.assert_array_equal(refused.x, step(free, s(10)).x)
    np.testing.assert_array_equal(refused.P, step(free, s(10)).P)
    port.write(good(20.0), s(20))
    assert step(ukf, s(20)).status in (status.UPDATED, status.GATED)


def test_a_measurement_is_used_once() -> None:
    ukf, port = wired()
    assert step(ukf, 0).status == status.NO_MEASUREMENT
    port.write(good(), s(10))
    first = step(ukf, s(10))
    assert (first.status, first.used) == (status.UPDATED, 1)
    again = step(ukf, s(10))
    assert (again.status, again.used) == (status.NO_MEASUREMENT, 1)
    np.testing.assert_array_equal(again.P, first.P)
    port.write(good(), s(10))  # the same image, sent again
    assert step(ukf, s(10)).status == status.TOO_LATE
    np.testing.assert_array_equal(step(ukf, s(10)).x, first.x)


def test_late_measurement_is_used_at_its_exposure() -> None:
    """An image that takes 7 s to process gives what it gives without delay."""
    Q = np.diag([1e-2] * 3 + [1e-6] * 3)
    (late, slow), (prompt, quick) = wired(process_noise=Q, gate=0.0), wired(process_noise=Q, gate=0.0)
    for k in range(1, 31):
        if k % 10 == 0:
            quick.write(good(k), s(k))
        if k % 10 == 7 and k > 10:
            slow.write(good(k - 7), s(k))
        step(late, s(k))
        step(prompt, s(k))
    slow.write(good(30), s(37))
    message = step(late, s(37))
    assert message.used == step(prompt, s(37)).used == 3
    reference = step(prompt, s(37))
    np.testing.assert_allclose(message.x, reference.x, rtol=1e-9, atol=0)
    np.testing.assert_allclose(message.P, reference.P, rtol=0, atol=1e-6 * float(np.max(reference.P)))


def test_innovation_and_residual() -> None:
    """Before and after the update, with the covariance of the innovation."""
    ukf, port = wired()
    port.write(good(), s(10))
    predicted = step(wired()[0], s(10))
    message = step(ukf, s(10))
    np.testing.assert_allclose(message.innovation, good().r_CP_N - predicted.x[:3], rtol=0, atol=1e-4)
    np.testing.assert_allclose(message.P_innovation, predicted.P[:3, :3] + 1e4 * np.eye(3), rtol=0, atol=1e-3)
    assert abs(message.nis - normalised(message.innovation, message.P_innovation)) < 1e-9 * message.nis
    np.testing.assert_allclose(message.residual, good().r_CP_N - message.x[:3], rtol=0, atol=1e-6)
    assert np.linalg.norm(message.residual) < 0.01 * np.linalg.norm(message.innovation)


def test_a_state_in_the_middle_of_the_body_fails_and_is_kept() -> None:
    ukf, port = wired()
    assert step(ukf, s(10)).status == status.NO_MEASUREMENT
    before = ukf.state.x.copy()
    ukf.state.x[:] = 0.0
    failed = step(ukf, s(20))
    assert (failed.status, failed.estimate_ns) == (status.FAILED_PREDICTION, s(10))
    ukf.state.x[:] = before
    port.write(good(20.0), s(20))
    assert step(ukf, s(20)).estimate_ns == s(20)


WRONG: dict[str, tuple[str, dict[str, Any]]] = {
    "indefinite": ("positive definite", {"P": np.diag([1e8, -1.0, 1.0, 1.0, 1.0, 1.0])}),
    "singular": ("positive definite", {"P": np.ones((6, 6))}),
    "not symmetric": ("not symmetric", {"P": P0 + np.eye(6, k=1)}),
    "negative noise": ("positive semidefinite", {"process_noise": -np.eye(6)}),
    "alpha": ("alpha", {"alpha": 0.0}),
    "kappa": ("kappa", {"kappa": -6.0}),
    "noise scale": ("noise_scale", {"noise_scale": 0.0}),
    "step": ("max_step", {"max_step": -1.0}),
    "planet": ("body_id", {"body_id": 2}),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_parameters_are_refused(kind: str) -> None:
    text, changed = WRONG[kind]
    with pytest.raises(ValueError, match=text):
        wired(**changed)
    wired(body_id=2, mu=1e10)
