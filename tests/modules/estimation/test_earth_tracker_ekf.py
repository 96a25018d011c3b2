"""EarthTrackerEkf: motion and models against scipy and differences, forms of the update, statistics."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.scenarios.earth_runs import (
    NARROW,
    P0,
    WIDE,
    Outcome,
    fly,
    gps_message,
    gyro_message,
    landmarks_message,
    params_of,
    tracker_message,
)
from benchmarks.scenarios.earth_truth import (
    INERTIA,
    J2,
    MU,
    RADIUS,
    SPIN,
    Camera,
    Motion,
    earth,
    exact,
    flown,
    gravity,
    nadir_pointing,
    orbit_frame,
    rotation,
    state_of,
    turn_between,
)
from fsw import s
from fsw.math.compiled import plain
from fsw.math.epoch import epoch
from fsw.math.geomagnetic import coefficients_at
from fsw.math.magnetic import RADIUS as MAGNETIC_RADIUS
from fsw.math.magnetic import harmonic_field
from fsw.math.vectors import inverse, mat3, vec3
from messages.base import F64, fields_of
from messages.sensors import CSSArraySensorMsg, StarVectorsMsg, TAMSensorMsg
from modules.estimation.analysis import efficiency
from modules.estimation.earth_tracker_ekf import dynamics, error, initial_state, status
from modules.estimation.earth_tracker_ekf.fuse import batch, federated, white_update
from modules.estimation.earth_tracker_ekf.linearise import linearised
from modules.estimation.pose_models.landmarks import landmark_from_camera
from sim.environment.magnetic_field import igrf14
from tests.modules.estimation.filter_truth import outside_band

Criterion = Callable[[str, float], None]
TORQUE = np.array([2e-6, -1e-6, 1.5e-6])
STEPS = np.repeat([5.0, 5e-3, 2e-6, 2e-7], 3)
MOVED, CORRECTED = plain(dynamics.moved), plain(error.corrected)
POSE, FRAME = plain(error.pose_of), plain(error.frame_of)


def body(gradient: bool = False, step: float = 5.0, torque: F64 | None = None) -> dynamics.Body:
    T = (0.0, 0.0, 0.0) if torque is None else plain(vec3)(torque)
    I3 = plain(mat3)(INERTIA)
    one = plain(mat3)(np.eye(3))
    return (MU, RADIUS, J2, one), I3, plain(inverse)(I3), T, gradient, step


def turning(seed: int = 1) -> Motion:
    """A motion with some rate relative to the orbit frame."""
    m, rng = nadir_pointing(0.4), np.random.default_rng(seed)
    return Motion(m.r, m.v * 1.01, rotation(0.5 * rng.normal(size=3)) @ m.dcm_BN, m.omega + 3e-3 * rng.normal(size=3))


def pose_of(x: F64) -> Motion:
    return Motion(*(np.array(part) for part in POSE(x, FRAME(x, body()[0]))))


def test_models_and_one_step(criterion: Criterion) -> None:
    """One step against 16 shorter ones in extended precision; a landmark in camera components likewise."""
    m = turning()
    x = state_of(m)
    start = pose_of(x)  # the motion of these 13 numbers, to the bit
    MOVED(x, 0.1, body(torque=TORQUE), np.empty((12, 12)))
    now, long = pose_of(x), np.longdouble
    fine: list[Any] = [np.asarray(a, long) for a in (start.r, start.v, start.dcm_BN, start.omega)]
    h = long(0.1) / 16
    back, I3 = np.linalg.inv(INERTIA), INERTIA

    def rates(r: Any, v: Any, C: Any, w: Any) -> tuple[Any, ...]:
        spin = np.array([[0 * w[0], -w[2], w[1]], [w[2], 0 * w[0], -w[0]], [-w[1], w[0], 0 * w[0]]])
        return v, gravity(r), -spin @ C, back @ (TORQUE - np.cross(w, I3 @ w))

    y: Any = tuple(fine)
    for _ in range(16):
        a = rates(*y)
        b = rates(*(p + h / 2 * q for p, q in zip(y, a, strict=True)))
        c = rates(*(p + h / 2 * q for p, q in zip(y, b, strict=True)))
        d = rates(*(p + h * q for p, q in zip(y, c, strict=True)))
        y = tuple(p + h / 6 * (i + 2 * j + 2 * k + n) for p, i, j, k, n in zip(y, a, b, c, d, strict=True))
    for found, wanted in zip((now.r, now.v, now.dcm_BN, now.omega), y, strict=True):
        criterion("EKF-1", float(np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))))
    r_LE_E = m.r * 0.93 + 2e4
    pose, one = POSE(state_of(m), FRAME(state_of(m), body()[0])), plain(mat3)(np.eye(3))
    _, p = plain(landmark_from_camera)(pose, one, (0.5, 0.2, -0.1), one, plain(vec3)(r_LE_E))
    wanted = np.asarray(pose[2], long) @ (r_LE_E.astype(long) - np.asarray(pose[0], long)) - [0.5, 0.2, -0.1]
    criterion("EKF-2", float(np.max(np.abs(np.array(p) - wanted)) / np.linalg.norm(m.r)))


def test_pure_propagation(criterion: Criterion) -> None:
    """An hour without measurements against DOP853; energies and momentum."""
    m = turning(2)
    x = state_of(m)
    moved = dynamics.moved
    assert moved(x, 3600.0, body(), np.empty((12, 12))) == 0
    now, then = pose_of(x), exact(m, np.array([3600.0]))[0]
    criterion("EKF-3", float(np.linalg.norm(now.r - then.r) / np.linalg.norm(then.r)))
    criterion("EKF-3", float(np.linalg.norm(now.v - then.v) / np.linalg.norm(then.v)))

    def energy(a: Motion) -> float:
        far = float(np.linalg.norm(a.r))
        return float(a.v @ a.v) / 2 - MU / far * (1 - J2 * (RADIUS / far) ** 2 * (1.5 * (a.r[2] / far) ** 2 - 0.5))

    criterion("EKF-4", abs(energy(now) / energy(m) - 1.0))
    criterion("EKF-4", abs(float(now.omega @ INERTIA @ now.omega) / float(m.omega @ INERTIA @ m.omega) - 1.0))
    momentum = [a.dcm_BN.T @ INERTIA @ a.omega for a in (now, m)]
    criterion("EKF-4", float(np.linalg.norm(momentum[0] - momentum[1]) / np.linalg.norm(momentum[1])))
    criterion("EKF-5", float(np.linalg.norm(turn_between(then.dcm_BN, now.dcm_BN))))


def by_differences(look: Callable[[F64], F64], x: F64) -> F64:
    """Derivative of a function of the 13 numbers by the error, midpoint differences."""
    columns: list[F64] = []
    for j in range(12):
        values: list[F64] = []
        for sign in (1.0, -1.0):
            step, at = np.zeros(12), np.empty(13)
            step[j] = sign * STEPS[j]
            CORRECTED(x, step, at)
            values.append(look(at))
        columns.append((values[0] - values[1]) / (2.0 * STEPS[j]))
    return np.array(columns).T


def test_transition(criterion: Criterion) -> None:
    """Of the error over ten seconds, forward and back, against differences of scipy's motion."""
    m, unit_of = turning(3), np.repeat([1e3, 1.0, 1e-2, 1e-4], 3)
    for gradient, dt in ((False, 10.0), (False, -7.0), (True, 10.0)):
        x = state_of(m)
        end, Phi = x.copy(), np.empty((12, 12))
        MOVED(end, dt, body(gradient), Phi)
        target = pose_of(end)

        def final(at: F64, dt: float = dt, gradient: bool = gradient, goal: Motion = target) -> F64:
            if gradient:  # scipy's motion has no such torque
                later, _ = at.copy(), MOVED(at, dt, body(True), np.empty((12, 12)))
                later = at
            else:
                start = pose_of(at)
                later = state_of(flown_one(start, dt))
            w, a, b, c = later[6:10]
            dcm = np.asarray(Rotation.from_quat([a, b, c, w]).as_matrix()).T
            base = goal.dcm_BN @ orbit_frame(goal.r, goal.v).T
            return np.concatenate([later[:6], turn_between(dcm, base), later[10:]])

        slope = by_differences(final, x)
        found, wanted = (a * unit_of / unit_of[:, None] for a in (Phi, slope))
        criterion("EKF-6", float(np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))))


def flown_one(m: Motion, dt: float) -> Motion:
    many = flown(Motion(m.r[None], m.v[None], m.dcm_BN[None], m.omega[None]), dt, 40)
    return many.at(0)


def row_of(message: Any, t_ns: int = s(10)) -> SimpleNamespace:
    """A message as a kernel sees it."""
    return SimpleNamespace(seq=1, t_ns=t_ns, **{f.name: getattr(message, f.name) for f in fields_of(type(message))})


def scene() -> tuple[Motion, tuple[Any, ...], dict[str, Any]]:
    """A motion with measurements without noise, at 10 s, by numpy; parameters with mountings and offsets."""
    m, rng, t = nadir_pointing(0.3), np.random.default_rng(4), 10.0
    m = Motion(m.r, m.v, m.dcm_BN, m.omega + 1e-3)
    mount, camera = [rotation(rng.normal(size=3)) for _ in range(4)], Camera(WIDE)
    arm, offset, bias = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.2]), np.array([1e-7, -2e-7, 3e-7])
    ground, E = camera.landmarks(m, 3, t, rng), earth(t)
    p = (ground @ E - m.r) @ m.dcm_BN.T - offset
    pixel = camera.focal * p[:, :2] / p[:, 2:] + (camera.size - 1) / 2
    sun = np.array([1.0e11, 0.8e11, 0.6e11])
    to_sun = (sun - m.r) / np.linalg.norm(sun - m.r)
    light = (149597870700.0 / np.linalg.norm(sun - m.r)) ** 2
    stars = rng.normal(size=(4, 3))
    stars /= np.linalg.norm(stars, axis=1, keepdims=True)
    seen = stars + (m.v + np.array([3e4, 0.0, 0.0])) / 299792458.0
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True) @ m.dcm_BN.T @ mount[3].T
    g, h = coefficients_at(igrf14(), epoch("2026-01-01T00:00:00Z"))
    v_A = m.v + m.dcm_BN.T @ np.cross(m.omega, arm)
    r_A = m.r + m.dcm_BN.T @ arm
    fix = gps_message(Motion(r_A, v_A, m.dcm_BN, m.omega), np.zeros(6), t)
    field = E.T @ np.array(plain(harmonic_field)(tuple(E @ m.r), MAGNETIC_RADIUS, 13, g, h))
    catalogue = np.zeros((5120, 3))
    catalogue[:4] = stars
    tracker = tracker_message(Motion(m.r, m.v, mount[2] @ m.dcm_BN, m.omega), np.zeros(3), s(10))
    none = np.full((16, 3), np.nan)
    none[:4] = seen
    feeds = (
        row_of(landmarks_message(ground, pixel, 0.5, s(10))),
        row_of(fix),
        row_of(gyro_message(Motion(m.r, m.v, m.dcm_BN, mount[0] @ m.omega + 1e-5), np.zeros(3))),
        row_of(CSSArraySensorMsg(signal=np.maximum(0.0, light * np.kron(m.dcm_BN @ to_sun, [1.0, -1.0])))),
        row_of(TAMSensorMsg(B_S=mount[1] @ m.dcm_BN @ field + bias)),
        row_of(tracker),
        row_of(StarVectorsMsg(exposure_ns=s(10), valid=True, count=4, sigma=5e-5, star=np.arange(16), s_S=none)),
        row_of(camera.message),
        SimpleNamespace(seq=1, t_ns=0, r_PN_N=sun, v_PN_N=np.array([-3e4, 0.0, 0.0]), radius=7e8),
        SimpleNamespace(seq=1, t_ns=0, dcm_EN=earth(0.0), omega_EN_N=np.array([0.0, 0.0, SPIN])),
    )
    return (
        m,
        feeds,
        {
            "r_CB_B": offset,
            "r_AB_B": arm,
            "dcm_PB": mount[0],
            "gyro_bias_P": np.full(3, 1e-5),
            "dcm_MB": mount[1],
            "magnetic_bias_M": bias,
            "field_degree": 13,
            "field_g": g,
            "field_h": h,
            "dcm_SB": mount[2],
            "dcm_VB": mount[3],
            "star_count": 4,
            "star_N": catalogue,
            "aberration": True,
            "gate": 0.0,
            "css_limit": 0.05,
        },
    )


@pytest.mark.parametrize("lag", [0, 3])
def test_derivatives_of_sensors(criterion: Criterion, lag: int) -> None:
    """Each sensor's white rows by the filter's error, of an estimate at the same time or later, by differences."""
    m, feeds, more = scene()
    now = flown_one(m, float(lag)) if lag else m
    x, look = state_of(now), plain(linearised)
    for unit in (False, True):
        params: Any = params_of(x, unit_vectors=unit, accel_density=0.0, torque_density=0.0, **more)
        for which in range(7) if not unit else (status.LANDMARKS,):
            keep = np.ones(1024, np.int64)

            def rows(at: F64, sensor: int = which, params: Any = params, keep: Any = keep) -> tuple[F64, F64]:
                H, left = np.empty((12, 12)), np.empty(12)
                code, n = look(sensor, s(10), s(10 + lag), at, P0, body(), params, feeds, True, keep, H, left)
                assert code == status.UPDATED
                return H[:n], left[:n]

            H, left = rows(x)
            assert np.max(np.abs(left)) < 2e-3, which  # of a standard deviation
            slope = -by_differences(lambda at, rows=rows: rows(at)[1], x)
            scale = np.abs(H) @ np.sqrt(np.diag(P0))
            away = np.abs(H - slope) @ np.sqrt(np.diag(P0)) / scale
            far = which in (status.SUN_SENSORS, status.STARS)  # parallax and changing aberration are left out
            criterion("EKF-17" if far else "EKF-7", float(np.max(away)))


def test_forms_on_a_linear_problem(criterion: Criterion) -> None:
    """Sequential in two orders, batch and federated against the textbook's filter; some see little."""
    rng = np.random.default_rng(5)
    for shares in (np.ones(7), rng.dirichlet(np.ones(7))):
        A, units = rng.normal(size=(12, 12)), np.repeat([1e3, 1.0, 1e-2, 1e-4], 3)
        P = (A @ A.T + np.eye(12)) * np.outer(units, units)
        m = np.array([6, 6, 3, 0, 3, 3, 2])
        H, z = rng.normal(size=(7, 12, 12)) / units, 3.0 * rng.normal(size=(7, 12))
        H[0, :, 6:] = 0.0
        rows, left = (np.concatenate([a[k, : m[k]] for k in range(7)]) for a in (H, z))
        gain = P @ rows.T @ np.linalg.inv(rows @ P @ rows.T + np.eye(len(rows)))
        x_true, P_true = gain @ left, P - gain @ rows @ P
        found: list[tuple[F64, F64]] = []
        for order in (range(7), (6, 2, 0, 4, 1, 5, 3)):
            now, total, dx = P.copy(), np.zeros(12), np.empty(12)
            for k in order:
                if m[k]:
                    code, _ = plain(white_update)(now, H[k], z[k] - H[k] @ total, int(m[k]), math.inf, dx)
                    assert code == 0
                    total = total + dx
            found.append((total, now))
        for form in ("batch", "federated"):
            now, dx, what, nis = P.copy(), np.empty(12), np.zeros(7, np.int64), np.full(7, np.nan)
            if form == "batch":
                code = plain(batch)(now, H, z, m, 0.0, what, nis, dx)
            else:
                code = plain(federated)(now, H, z, m, 0.0, shares, what, nis, dx)
            assert code == 0
            found.append((dx, now))
        for dx, now in found:
            criterion("EKF-8", float(np.max(np.abs(dx - x_true) / units)))
            criterion("EKF-8", float(np.max(np.abs(now - P_true) / np.outer(units, units))))


def outside(o: Outcome) -> float:
    """Distance of mean NEES from the band, at the first image, in the middle and at the end."""
    return max(outside_band(o.nees[k].tolist(), 12, 0.9999) for k in (0, len(o.nees) // 2, -1))


def test_consistency(criterion: Criterion) -> None:
    """Few runs of the three set-ups."""
    criterion("EKF-9", outside(fly(NARROW, math.radians(30.0), "", 16, 60, 11)))
    criterion("EKF-9", outside(fly(WIDE, 0.0, "", 16, 60, 12)))
    criterion("EKF-9", outside(fly(NARROW, 0.0, "tracker", 16, 60, 13)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("focal", "tilt", "use"), [(NARROW, 30, ""), (WIDE, 0, ""), (NARROW, 0, "tracker"), (NARROW, 0, "tracker gps")]
)
def test_100_runs_at_the_bound(criterion: Criterion, focal: float, tilt: float, use: str) -> None:
    """NEES in its band and errors at the bound: 100 runs of the set-ups S3, S4, S5 and S1 of the benchmark."""
    o = fly(focal, math.radians(tilt), use, 100, 300, 21)
    second_half = o.nees[len(o.nees) // 2 :]
    criterion("EKF-10", outside_band(np.mean(second_half, axis=0).tolist(), 12))
    for values, rows in ((o.position, slice(0, 3)), (o.attitude, slice(6, 9))):
        criterion("EKF-11", efficiency(np.swapaxes(values, 0, 1), o.bound[:, rows, rows]).eta)


def test_initial_state() -> None:
    """A place, heading and angles: on the ellipsoid's height, circular, the camera turned as told; a pole refused."""
    E, mount = earth(1000.0), np.asarray(Rotation.from_euler("x", 30, degrees=True).as_matrix())
    angles, rate = np.array([0.1, -0.2, 0.3]), np.array([1e-3, 2e-3, 3e-3])
    r, v, beta, omega = initial_state(0.6, -1.2, 5e5, angles, E, mount, rate, heading=0.4)
    N = 6378137.0 / math.sqrt(1.0 - 6.69437999014e-3 * math.sin(0.6) ** 2)
    place = (N + 5e5) * math.cos(0.6) * np.array([math.cos(-1.2), math.sin(-1.2), 0.0])
    place[2] = (N * (1.0 - 6.69437999014e-3) + 5e5) * math.sin(0.6)
    np.testing.assert_allclose(E @ r, place, rtol=1e-12)
    assert abs(float(r @ v)) < 1e-12 * float(np.linalg.norm(r) * np.linalg.norm(v))
    assert float(v @ v) == pytest.approx(MU / float(np.linalg.norm(r)), rel=1e-9)
    w, a, b, c = beta
    dcm_CO = mount @ np.asarray(Rotation.from_quat([a, b, c, w]).as_matrix()).T
    wanted = np.asarray(Rotation.from_euler("ZYX", angles[::-1]).as_matrix()).T
    np.testing.assert_allclose(dcm_CO, wanted, atol=1e-14)
    np.testing.assert_allclose(mount @ omega, rate, atol=1e-16)
    with pytest.raises(ValueError, match="no east"):
        initial_state(math.pi / 2, 0.0, 5e5, angles, E, mount, rate)
    with pytest.raises(ValueError, match="finite"):
        initial_state(0.5, 0.0, math.nan, angles, E, mount, rate)
