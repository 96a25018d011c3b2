"""PoseMekf: motion, derivatives, late images, silence of the gyro, divergence and re-acquisition, bad input."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.scenarios.pose_truth import (
    ARCSEC,
    J2,
    MU,
    NARROW,
    RE,
    SIGMA0,
    WE,
    WIDE,
    Cached,
    Draw,
    Optics,
    Scene,
    Setup,
    Truth,
    draw,
    gravity,
    ground,
    landmarks,
    make_filter,
    orientation,
    rotvec,
    run,
    turn,
)
from fsw import OutPort
from fsw.math.compiled import plain
from messages.base import F64
from messages.filters import DirectionsMsg, PoseFilterMsg
from messages.opnav import PoseFixMsg
from messages.sensors import GPSSensorMsg, IMUSensorMsg, STAttMsg
from modules.estimation.pose_mekf import PoseMekf, PoseMekfParams, status
from modules.estimation.pose_mekf.layout import SIZE
from modules.estimation.pose_mekf.motion import field_gradient, transition

Criterion = Callable[[str, float], None]
Ports = dict[str, OutPort[Any]]
S = 10**9


@pytest.fixture(scope="module")
def wide() -> Cached:
    return Cached(Scene(Truth(100.0), WIDE, np.arange(10.0, 101.0, 10.0), count=60), 100)


def exact(truth: Truth, scale: float = 0.0) -> Draw:
    """No errors, or initial ones of some sigma."""
    none = np.zeros(3)
    return Draw(scale * SIGMA0, Optics(WIDE), none, 0.0, np.random.default_rng(1))


def test_derivatives_of_the_motion(criterion: Criterion) -> None:
    """Central differences of SciPy's solution; gradient of J2 about a tilted pole is that about z in turned axes."""
    r, v, w, dt = np.array([5e6, 3e6, -3.4e6]), np.array([-4e3, 5e3, -3.5e3]), np.array([2e-3, -1e-3, 5e-4]), 1.0
    unit = (0.0, 0.0, 1.0)
    G: Any = plain(field_gradient)(tuple(r + 0.5 * dt * v), unit, MU, RE, J2)
    Phi = np.empty((SIZE, SIZE))
    plain(transition)(G, tuple(w), dt, Phi)

    def flow(x: F64) -> F64:
        def slope(_: float, y: F64) -> F64:
            return np.concatenate([y[3:6], gravity(y[:3])])

        out: Any = solve_ivp(slope, (0.0, dt), x, "DOP853", rtol=1e-13, atol=1e-12)
        return out.y[:, -1]

    x = np.concatenate([r, v])
    for j, h in enumerate([1e3] * 3 + [10.0] * 3):
        step = np.zeros(6)
        step[j] = h
        column = (flow(x + step) - flow(x - step)) / (2.0 * h)
        size = np.concatenate([np.full(3, 1.0 if j < 3 else dt), np.full(3, 1e-6 * dt if j < 3 else 1.0)])
        criterion("MEKF-1", float(np.max(np.abs(column - Phi[:6, j]) / size)))
    # attitude: true = exp(-[theta x]) estimate, true rate = reading - bias
    for j in range(3):
        bias = np.zeros(3)
        bias[j] = 1e-6
        theta = rotvec(turn((w - bias) * dt) @ turn(w * dt).T)
        criterion("MEKF-1", float(np.max(np.abs(theta / 1e-6 - Phi[6:9, 9 + j]))) / dt)
    np.testing.assert_allclose(Phi[6:9, 6:9], turn(w * dt), atol=1e-15)
    turned = turn(np.array([0.3, -0.2, 0.1]))
    tilted: Any = plain(field_gradient)(tuple(turned.T @ r), tuple(turned[2]), MU, RE, J2)
    straight: Any = plain(field_gradient)(tuple(r), unit, MU, RE, J2)
    np.testing.assert_allclose(turned @ np.array(tilted) @ turned.T, straight, rtol=0, atol=1e-20)


def test_motion(criterion: Criterion, wide: Cached) -> None:
    """Ten minutes without measurements, but the gyro, against SciPy."""
    truth = Truth(600.0)
    mekf, ports = make_filter(truth, exact(truth))
    for t in range(1, 601):
        rate = truth.mean_omega(t - 1.0, float(t))
        ports["in_orientation"].write(orientation(float(t)), t * S)
        ports["in_gyro"].write(IMUSensorMsg(omega_PN_P=rate, accel_P=np.full(3, np.nan)), t * S)
        mekf.step(t * S)
    message, (r, v, dcm_BN) = mekf.out_filter.latest(), truth.at(600.0)
    assert message is not None and message.status == status.NO_MEASUREMENT and not message.rate_held
    criterion("MEKF-2", float(np.linalg.norm(message.r_BN_N - r)))
    criterion("MEKF-2", 1e3 * float(np.linalg.norm(message.v_BN_N - v)))
    q: Any = Rotation.from_quat(message.beta_BN, scalar_first=True)
    criterion("MEKF-3", float(np.linalg.norm(rotvec(dcm_BN @ q.as_matrix()))))
    navigation, attitude = mekf.out_nav.latest(), mekf.out_att.latest()
    assert navigation is not None and attitude is not None
    np.testing.assert_array_equal(navigation.r_BN_N, message.r_BN_N)
    mrp: Any = Rotation.from_mrp(attitude.sigma_BN.copy())
    np.testing.assert_allclose(mrp.as_matrix(), q.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(attitude.omega_BN_B, truth.mean_omega(599.0, 600.0), atol=1e-12)


@pytest.mark.parametrize("delay", [3, 7])
def test_late_images_lose_nothing(criterion: Criterion, delay: int) -> None:
    """Images that come seconds late, among other sensors, give what punctual ones give: at a time when both are in."""
    cached = Cached(Scene(Truth(50.0), WIDE, np.arange(10.0, 41.0, 10.0)), 50)
    for seed in range(2):
        ends: list[PoseFilterMsg] = []
        for setup in (Setup(star=1, gps=2), Setup(star=1, gps=2, delay=delay)):
            # the same noise of the pixels whenever they come
            *_, (_, message, _, mekf) = run_with_own_pixel_noise(cached, setup, seed)
            assert message.images == 4 and mekf.state.images == 4
            ends.append(message)
        scale = np.sqrt(np.diag(ends[0].P)[:3])
        criterion("MEKF-4", float(np.max(np.abs(ends[0].r_BN_N - ends[1].r_BN_N) / scale)))
        criterion("MEKF-4", float(np.max(np.abs(ends[0].beta_BN - ends[1].beta_BN))) / (10.0 * ARCSEC))
        np.testing.assert_allclose(ends[0].P, ends[1].P, rtol=1e-6, atol=1e-14)


def run_with_own_pixel_noise(cached: Cached, setup: Setup, seed: int) -> Any:
    """`run` with noise of the pixels put into the cached pixels, so that it is the same for all delays."""
    rng = np.random.default_rng([seed, 5])
    noisy = Cached.__new__(Cached)
    vars(noisy).update(vars(cached))
    noisy.seen = [p + 0.5 * rng.standard_normal(p.shape) for p in cached.seen]
    fields: dict[str, Any] = {**vars(setup), "draw_pixels": False}
    return run(noisy, Setup(**fields), seed)


def test_rolling_shutter_and_clock(criterion: Criterion) -> None:
    """20 ms from first row to last, and an exposure 1 ms after its stamp, which is found with GPS and star tracker."""
    cached = Cached(Scene(Truth(300.0), WIDE, np.arange(10.0, 301.0, 10.0)), 300)
    setup = Setup(star=1, gps=1, row_time=1e-5, nuisance=("time",), params={"time_mode": 2})
    away: list[float] = []
    for seed in range(4):
        *_, (_, message, error, mekf) = run(cached, setup, seed)
        late = draw(setup, WIDE, seed).late
        found = mekf.out_nuisance.latest()
        assert found is not None and message.images == 30 and found.sigma_time < 0.7e-3
        away.append(abs(late - found.time_s) / found.sigma_time)
        away.append(float(np.linalg.norm(error[:3] / np.sqrt(np.diag(message.P)[:3]))) / 1.7)
    criterion("MEKF-5", max(away))


def test_silence_of_the_gyro(criterion: Criterion) -> None:
    """The rate is held for 100 s and the star tracker follows it; afterwards the bias is found again."""
    cached = Cached(Scene(Truth(300.0), WIDE, np.arange(10.0, 301.0, 10.0)), 300)
    setup = Setup(star=1, silence=(100, 200), params={"rate_noise": 2e-5})
    squares: list[float] = []
    for seed in range(4):
        for t, message, error, _ in run(cached, setup, seed):
            assert message.rate_held == (102 < t < 200)
            if t in (150, 190, 300):
                part = error[:9] if message.rate_held else error
                P = message.P[: len(part), : len(part)]
                s = np.sqrt(np.diag(P))
                squares.append(float(part / s @ np.linalg.solve(P / np.outer(s, s), part / s)) / len(part))
                if t > 200:
                    assert np.all(np.sqrt(np.diag(message.P)[9:12]) < 1e-5)
    criterion("MEKF-6", abs(float(np.mean(squares)) - 1.0))


def misplace(mekf: PoseMekf, r: F64, theta: F64) -> None:
    """Spoil the estimate without telling its covariance."""
    x = mekf.state.x
    x[:3] += r
    q: Any = Rotation.from_quat(x[6:10], scalar_first=True)
    spoilt: Any = q * Rotation.from_rotvec(theta)
    x[6:10] = spoilt.as_quat(scalar_first=True)
    mekf.state.saved = 1
    mekf.state.saved_x[0], mekf.state.saved_ns[0] = x, mekf.state.time_ns
    mekf.state.saved_P[0], mekf.state.saved_done[0] = mekf.state.P, mekf.state.done


def feed(cached: Cached, ports: Ports, k: int, noise: np.random.Generator, sigma: float = 0.5) -> int:
    """Write the landmarks of image k; returns its time."""
    t_ns = round(float(cached.scene.images[k])) * S
    ports["in_orientation"].write(orientation(t_ns * 1e-9), t_ns)
    seen = cached.seen[k] + sigma * noise.standard_normal(cached.seen[k].shape)
    ports["in_landmarks"].write(landmarks(t_ns, cached.scene.places[k], seen, sigma), t_ns)
    return t_ns


def write_gyro(cached: Cached, ports: Ports, t: int) -> None:
    rate = cached.rates[t - 1]
    ports["in_gyro"].write(IMUSensorMsg(omega_PN_P=rate, accel_P=np.full(3, np.nan)), t * S)


def ready(cached: Cached, scale: float = 0.5, **params: Any) -> tuple[PoseMekf, Ports]:
    mekf, ports = make_filter(cached.scene.truth, exact(cached.scene.truth, scale), **params)
    ports["in_camera"].write(Optics(cached.scene.focal).message, 0)
    return mekf, ports


def go(cached: Cached, mekf: PoseMekf, ports: Ports, since: int, until: int) -> list[PoseFilterMsg]:
    """Step with gyro and the images on the way; the messages at images."""
    rng, found = np.random.default_rng(3), list[PoseFilterMsg]()
    images = {round(float(t)): k for k, t in enumerate(cached.scene.images)}
    for t in range(since, until + 1):
        write_gyro(cached, ports, t)
        ports["in_orientation"].write(orientation(float(t)), t * S)
        if t in images:
            feed(cached, ports, images[t], rng)
        mekf.step(t * S)
        if t in images:
            message = mekf.out_filter.latest()
            assert message is not None
            found.append(message)
    return found


def place_error(cached: Cached, message: PoseFilterMsg) -> float:
    """Error of the position in sigma."""
    r = cached.states[message.estimate_ns // S][0]
    e, P = r - message.r_BN_N, message.P[:3, :3]
    return float(np.sqrt(e @ np.linalg.solve(P, e)))


def test_divergence_and_own_search(wide: Cached) -> None:
    """An estimate that is 60 km and 4 degrees off is given up after three images and found again by the fourth."""
    mekf, ports = ready(wide, lost_sigma=np.array([1e5, 50.0, 0.1]))
    assert [m.status for m in go(wide, mekf, ports, 1, 29)] == [status.UPDATED] * 2
    misplace(mekf, np.array([4e4, -3e4, 3e4]), np.array([0.04, 0.05, -0.03]))
    messages = go(wide, mekf, ports, 30, 80)
    assert [m.status for m in messages[:4]] == [status.TOO_FEW, status.TOO_FEW, status.DIVERGED, status.REACQUIRED]
    assert [m.lost for m in messages[:4]] == [False, False, True, False]
    assert [m.contradicting for m in messages[:4]] == [1, 2, 0, 0]
    assert all(m.status == status.UPDATED for m in messages[4:])
    assert all(place_error(wide, m) < 3.5 for m in messages[3:])


def fix(cached: Cached, t_ns: int, sigma: float = 100.0, **more: Any) -> PoseFixMsg:
    r, _, dcm_BN, _ = cached.states[t_ns // S]
    E = orientation(t_ns * 1e-9).dcm_EN
    q: Any = Rotation.from_matrix((dcm_BN @ E.T).T)
    values: dict[str, Any] = {
        "exposure_ns": t_ns,
        "valid": True,
        "status": 0,
        "inliers": 100,
        "candidates": 100,
        "cells": 24,
        "rms_px": 0.5,
        "r_CE_E": E @ r + sigma * np.array([1.0, -0.5, 0.3]),
        "beta_CE": q.as_quat(scalar_first=True, canonical=True),
        "P_pose": np.diag([sigma**2] * 3 + [1e-8] * 3),
    }
    return PoseFixMsg(**{**values, **more})


def test_start_from_a_pose(wide: Cached) -> None:
    """A worthless start waits for a pose; without landmarks of the same image its covariance is taken over."""
    mekf, ports = ready(wide, start_lost=True, mount_mode=2)
    mekf.step(0)
    misplace(mekf, np.array([3e6, 0.0, 0.0]), np.array([1.0, 2.0, -0.5]))
    go(wide, mekf, ports, 1, 4)
    ports["in_fix"].write(fix(wide, 5 * S), 5 * S)
    go(wide, mekf, ports, 5, 5)
    message = mekf.out_filter.latest()
    assert message is not None and message.status_fix == status.REACQUIRED and not message.lost
    assert place_error(wide, message) < 3.0
    P = message.P
    np.testing.assert_allclose(np.diag(P)[:3], 1e4, rtol=1e-6)
    assert P[6, 6] == pytest.approx(1e-8 + (2.9e-4) ** 2, rel=1e-6) and P[6, 12] == pytest.approx(-((2.9e-4) ** 2))
    messages = go(wide, mekf, ports, 6, 60)
    assert all(m.status == status.UPDATED for m in messages) and place_error(wide, messages[-1]) < 3.5


def test_pose_and_landmarks_of_one_image_are_not_used_twice(wide: Cached) -> None:
    """The pose says where to look; the covariance is that of the landmarks and a wide prior."""
    mekf, ports = ready(wide, start_lost=True)
    mekf.step(0)
    misplace(mekf, np.array([3e6, 0.0, 0.0]), np.array([1.0, 2.0, -0.5]))
    go(wide, mekf, ports, 1, 9)
    ports["in_fix"].write(fix(wide, 10 * S, sigma=1.0), 10 * S)
    message = go(wide, mekf, ports, 10, 10)[0]
    assert message.status == status.REACQUIRED and place_error(wide, message) < 3.5
    assert np.sqrt(np.trace(message.P[:3, :3])) > 50.0  # a pose of 1 m was not believed


def bad(what: str, cached: Cached, ports: Ports, t_ns: int) -> None:
    """Write one measurement that cannot be used."""
    places, seen = cached.scene.places[0], cached.seen[0]
    marks = landmarks(t_ns, places, seen, 0.5)
    r, v = np.array([7e6, 0.0, 0.0]), np.zeros(3)
    gps = GPSSensorMsg(fix_ns=t_ns, r_AE_E=r, v_AE_E=v, lat=0.0, lon=0.0, h=0.0)
    star = STAttMsg(exposure_ns=t_ns, valid=True, beta_SN=np.array([1.0, 0.0, 0.0, 0.0]))
    replace = msgspec.structs.replace
    few = landmarks(t_ns, places[:3], seen[:3], 0.5)
    indefinite = np.tile(np.array([[1.0, 2.0], [2.0, 1.0]]), (1024, 1, 1))
    messages: dict[str, tuple[str, Any]] = {
        "few landmarks": ("in_landmarks", few),
        "no landmarks": ("in_landmarks", replace(marks, count=0)),
        "NaN landmarks": ("in_landmarks", replace(marks, pixel_px=np.full((1024, 2), np.nan))),
        "indefinite matches": ("in_landmarks", replace(marks, P_px=indefinite)),
        "future landmarks": ("in_landmarks", replace(marks, exposure_ns=t_ns + S)),
        "old landmarks": ("in_landmarks", replace(marks, exposure_ns=1)),
        "NaN gps": ("in_gps", gps),
        "future gps": ("in_gps", replace(gps, fix_ns=t_ns + 1)),
        "wrong gps": ("in_gps", gps),
        "NaN star": ("in_star_tracker", replace(star, beta_SN=np.full(4, np.nan))),
        "long star": ("in_star_tracker", replace(star, beta_SN=np.array([1.0, 1.0, 0.0, 0.0]))),
        "invalid star": ("in_star_tracker", replace(star, valid=False)),
        "NaN gyro": ("in_gyro", IMUSensorMsg(omega_PN_P=np.zeros(3), accel_P=np.full(3, np.nan))),
    }
    name, message = messages[what]
    ports[name].write(message, t_ns)
    if what == "NaN gps":
        ports[name].row["r_AE_E"][0, 1] = np.nan
    if what == "NaN gyro":
        ports[name].row["omega_PN_P"][0, 1] = np.nan


BAD = {
    "few landmarks": ("status", status.TOO_FEW),
    "no landmarks": ("status", status.INVALID),
    "NaN landmarks": ("status", status.BAD_NUMBERS),
    "indefinite matches": ("status", status.BAD_NUMBERS),
    "future landmarks": ("status", status.FROM_FUTURE),
    "old landmarks": ("status", status.TOO_LATE),
    "NaN gps": ("status_gps", status.BAD_NUMBERS),
    "future gps": ("status_gps", status.FROM_FUTURE),
    "wrong gps": ("status_gps", status.GATED),
    "NaN star": ("status_star", status.BAD_NUMBERS),
    "long star": ("status_star", status.BAD_NUMBERS),
    "invalid star": ("status_star", status.INVALID),
    "NaN gyro": ("status", status.NO_MEASUREMENT),
}


@pytest.mark.parametrize("what", list(BAD))
def test_bad_measurements_change_nothing(wide: Cached, what: str) -> None:
    """The filter says so, is as it would have been without them, and uses the next good ones."""
    pair = [ready(wide) for _ in range(2)]
    for mekf, ports in pair:
        go(wide, mekf, ports, 1, 15)
    for which, (mekf, ports) in enumerate(pair):
        if what != "NaN gyro":
            write_gyro(wide, ports, 16)
        if which:
            bad(what, wide, ports, 16 * S)
        mekf.step(16 * S)
    message = pair[1][0].out_filter.latest()
    assert message is not None
    field, expected = BAD[what]
    assert getattr(message, field) == expected
    for name in ("x", "P"):
        one, other = (np.array(getattr(mekf.state, name)) for mekf, _ in pair)
        if name == "x":
            one, other = one[:31], other[:31]  # behind are counts
        np.testing.assert_array_equal(one, other)
    assert go(wide, *pair[1], 17, 20)[0].status == status.UPDATED


def test_an_image_twice_and_missing_companions(wide: Cached) -> None:
    mekf, ports = make_filter(wide.scene.truth, exact(wide.scene.truth, 0.5))
    rng = np.random.default_rng(4)

    def seen(k: int, t: int) -> int:
        write_gyro(wide, ports, t)
        t_ns = round(float(wide.scene.images[k])) * S
        pixels = wide.seen[k] + 0.5 * rng.standard_normal(wide.seen[k].shape)
        ports["in_landmarks"].write(landmarks(t_ns, wide.scene.places[k], pixels, 0.5), t * S)
        mekf.step(t * S)
        message = mekf.out_filter.latest()
        assert message is not None
        return message.status

    assert seen(0, 10) == status.NO_CAMERA
    ports["in_camera"].write(Optics(WIDE).message, 10 * S)
    assert seen(0, 11) == status.NO_ORIENTATION
    ports["in_orientation"].write(orientation(11.0), 11 * S)
    assert seen(0, 12) == status.UPDATED
    before = np.array(mekf.state.P)
    assert seen(0, 13) == status.TOO_LATE  # the same exposure again
    assert np.trace(mekf.state.P[:3, :3]) >= np.trace(before[:3, :3])
    mekf.step(14 * S)
    message = mekf.out_filter.latest()
    assert message is not None and message.status == status.NO_MEASUREMENT and message.images == 1
    ports["in_fix"].write(fix(wide, 15 * S, P_pose=np.diag([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])), 15 * S)
    mekf.state.lost = True
    mekf.step(15 * S)
    message = mekf.out_filter.latest()
    assert message is not None and message.status_fix == status.BAD_NUMBERS and message.lost


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("P", -np.eye(12)),
        ("P", np.ones((12, 12))),
        ("P", np.diag([1.0] * 11 + [np.nan])),
        ("gyro_white", 0.0),
        ("accel_noise", -1.0),
        ("gps_sigma_r", 0.0),
        ("star_sigma", np.zeros(3)),
        ("noise_scale", 0.0),
        ("iterations", 0),
        ("dcm_SB", np.zeros((3, 3))),
        ("map_bias_P", -np.eye(3)),
        ("mount_mode", 3),
    ],
)
def test_wrong_parameters_are_refused(field: str, value: Any) -> None:
    good: dict[str, Any] = {"r_BN_N": [7e6, 0, 0], "v_BN_N": [0, 7e3, 0], "sigma_BN": np.zeros(3), "P": np.eye(12)}
    PoseMekfParams(**good)
    with pytest.raises(ValueError, match=field):
        PoseMekfParams(**{**good, field: value})


def test_false_landmarks_in_the_first_image(wide: Cached) -> None:
    """Half of the landmarks are anywhere, at a start known to 2 km and 0.3 degrees."""
    scene = Scene(wide.scene.truth, NARROW, np.array([10.0]), count=60)
    cached = Cached(scene, 10)
    for seed in range(3):
        *_, (_, message, _, _) = run(cached, Setup(star=1, outliers=0.5), seed)
        assert message.status == status.UPDATED and 20 <= message.accepted <= 42
        assert place_error(cached, message) < 3.5


def test_mountings_and_directions(wide: Cached) -> None:
    """Exact data of sensors that sit anywhere, turned anyhow, leave an exact estimate where it is."""
    P, S_B, C_B = turn(np.array([0.4, -1.0, 0.3])), turn(np.array([-0.2, 0.5, 2.0])), turn(np.array([0.1, -0.15, 1.2]))
    arm_C, arm_A, spin = np.array([300.0, -200.0, 100.0]), np.array([-40.0, 70.0, 90.0]), np.array([0.0, 0.0, WE])
    truth, cam, known = wide.scene.truth, Optics(WIDE), np.array([[1.0, 0.2, 0.0], [0.0, -1.0, 0.5], [0.3, 0.0, 1.0]])
    mekf, ports = make_filter(truth, exact(truth), dcm_PB=P, dcm_SB=S_B, r_CB_B=arm_C, r_AB_B=arm_A)
    ports["in_camera"].write(msgspec.structs.replace(cam.message, dcm_CB=C_B), 0)
    for t in range(1, 21):
        r, v, dcm_BN, _ = wide.states[t]
        E, w = orientation(float(t)).dcm_EN, truth.omega(float(t))
        ports["in_orientation"].write(wide.planet[t], t * S)
        ports["in_gyro"].write(IMUSensorMsg(omega_PN_P=P @ wide.rates[t - 1], accel_P=np.full(3, np.nan)), t * S)
        star: Any = Rotation.from_matrix((S_B @ dcm_BN).T)
        beta = star.as_quat(scalar_first=True)
        ports["in_star_tracker"].write(STAttMsg(exposure_ns=t * S, valid=True, beta_SN=beta), t * S)
        seen, sky = np.full((16, 3), np.nan), np.full((16, 3), np.nan)
        seen[:3], sky[:3] = 7.0 * known @ dcm_BN.T, known
        sigma = np.where(np.arange(16) < 3, 1e-5, np.nan)
        directions = DirectionsMsg(exposure_ns=t * S, valid=True, count=3, measured_B=seen, known_N=sky, sigma=sigma)
        ports["in_directions"].write(directions, t * S)
        r_A, v_A = r + dcm_BN.T @ arm_A, v + dcm_BN.T @ np.cross(w, arm_A)
        fixed: dict[str, Any] = {"r_AE_E": E @ r_A, "v_AE_E": E @ (v_A - np.cross(spin, r_A))}
        ports["in_gps"].write(GPSSensorMsg(fix_ns=t * S, lat=0.0, lon=0.0, h=0.0, **fixed), t * S)
        if t % 5 == 0:
            r_C = r + dcm_BN.T @ arm_C
            rays = np.random.default_rng(t).uniform(-0.5, 0.5, (20, 2))
            sight = [C_B.T @ np.array([x, y, 1.0]) for x, y in rays]
            places = np.array([ground(E @ r_C, E @ dcm_BN.T @ d, 0.0) for d in sight])
            pixels = WIDE * rays + (cam.size - 1) / 2
            ports["in_landmarks"].write(landmarks(t * S, places, pixels, 0.5), t * S)
        mekf.step(t * S)
        message = mekf.out_filter.latest()
        assert message is not None
        assert message.status_gps == message.status_star == message.status_vectors == status.UPDATED
        assert message.status == (status.UPDATED if t % 5 == 0 else status.NO_MEASUREMENT)
        # the rate of the estimate is the mean of the last second, and the arm makes that a few 0.1 mm/s
        assert np.linalg.norm(message.r_BN_N - r) < 0.01 and np.linalg.norm(message.v_BN_N - v) < 1e-3
        q: Any = Rotation.from_quat(message.beta_BN, scalar_first=True)
        assert np.linalg.norm(rotvec(dcm_BN @ q.as_matrix())) < 1e-7
        assert message.landmarks == (20 if t % 5 == 0 else 0) == message.accepted
