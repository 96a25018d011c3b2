"""EarthTrackerEkf with sensors at their own rates, late, lost and wrong, and with those of the simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.scenarios.earth_runs import (
    ACCEL,
    ARW,
    COUNT,
    GPS,
    NARROW,
    P0,
    PIXEL,
    TORQUE,
    TRACKER,
    Wired,
    gps_message,
    gyro_message,
    landmarks_message,
    latest,
    params_of,
    tracker_message,
    wired,
)
from benchmarks.scenarios.earth_truth import (
    Camera,
    Motion,
    disturbed,
    flown,
    nadir_pointing,
    relative_error,
    state_of,
    turn_between,
    with_noise,
)
from fsw import Simulation, Task, minutes, ms, s
from fsw.math.attitude import mrp_to_dcm
from fsw.math.compiled import plain
from fsw.math.epoch import epoch
from fsw.math.geomagnetic import coefficients_at
from messages.base import F64
from messages.control import CmdTorqueBodyMsg
from messages.sensors import CSSArraySensorMsg, STAttMsg
from modules.estimation.earth_tracker_ekf import BATCH, FEDERATED, EarthTrackerEkf, status
from sim.environment.magnetic_field import igrf14
from sim.environment.star_catalogue import bright_stars
from sim.scenarios.leo_sensors.graph import ARM_B, DCM_SIDE, DCM_ZENITH, EPOCH, GYRO_BIAS, build
from tests.modules.estimation.filter_truth import outside_band

Criterion = Callable[[str, float], None]
CAMERA = Camera(NARROW)
LANDMARKS, FIX, TRACK = "in_landmarks", "in_gps", "in_star_tracker"


def picture(m: Motion, t: float, rng: np.random.Generator, **more: Any) -> Any:
    """Landmarks of an image with noise."""
    seen = CAMERA.landmarks(m, COUNT, t, rng)
    pixel = CAMERA.pixels(m, seen, t) + PIXEL * rng.normal(size=(COUNT, 2))
    return landmarks_message(seen, pixel, PIXEL, round(t * 1e9), **more)


def follow(fleet: list[Wired], seconds: int, late: int = 0) -> Motion:
    """The nominal motion with all its sensors for a fleet of filters; images come ``late`` [s] to all but the first."""
    rng, m = np.random.default_rng(3), nadir_pointing()
    true = disturbed(m, rng.normal(size=(1, 12)) * 0.1 @ np.sqrt(P0))
    waiting: dict[int, Any] = {}
    for k in range(1, seconds + 1):
        true = flown(true, 1.0)
        m = true.at(0)
        messages = {
            "in_gyro": gyro_message(m, ARW * rng.normal(size=3)),
            TRACK: tracker_message(m, TRACKER * rng.normal(size=3), s(k)),
            FIX: gps_message(m, GPS * rng.normal(size=6), k),
        }
        if k % 10 == 0:
            waiting[k] = picture(m, k, rng)
        for i, (ekf, feed) in enumerate(fleet):
            for name, message in messages.items():
                feed[name].write(message, s(k))
            image = waiting.get(k - (late if i else 0))
            if image is not None:
                feed[LANDMARKS].write(image, s(k))
            ekf.step(s(k))
    return true.at(0)


def fleet_of(*more: dict[str, Any]) -> list[Wired]:
    x = state_of(nadir_pointing())
    return [wired(x, CAMERA, P=0.01 * P0, **each) for each in more]


def apart(one: Wired, other: Wired) -> float:
    """Largest difference of two estimates in sigma."""
    a, b = latest(one[0]), latest(other[0])
    difference = np.delete(a.x - b.x, 6)
    difference[6:9] *= 2.0  # of Euler parameters near no turn
    return float(np.max(np.abs(difference) / np.sqrt(np.diag(a.P))))


def test_forms_and_orders_agree(criterion: Criterion) -> None:
    """Nonlinear, so not to the last digit: forms, and an order against another."""
    fleet = fleet_of({}, {"order": np.array([3, 4, 2, 0, 1, 6, 5])}, {"form": BATCH}, {"form": FEDERATED})
    follow(fleet, 60)
    for other in fleet[1:]:
        criterion("EKF-12", apart(fleet[0], other))
        np.testing.assert_array_equal(latest(other[0]).refused, 0)


def test_late_image(criterion: Criterion) -> None:
    """Four seconds late, while other sensors go on; with process noise some of what it says would be lost."""
    calm = {"accel_density": 1e-20, "torque_density": 1e-22}
    fleet = fleet_of(calm, calm, {"form": BATCH, **calm})
    follow(fleet, 44, late=4)
    for other in fleet[1:]:
        assert latest(other[0]).used[0] == 4
        criterion("EKF-13", apart(fleet[0], other))


@pytest.mark.slow
def test_outage(criterion: Criterion) -> None:
    """Half an hour without GPS: gyro at 1 Hz, tracker each 3 s, images each 17 s and 2.5 s late; a tenth is lost."""
    rng, runs, nominal = np.random.default_rng(8), 30, nadir_pointing()
    fleet = [wired(state_of(nominal), CAMERA) for _ in range(runs)]
    true = disturbed(nominal, rng.normal(size=(runs, 12)) @ np.sqrt(P0))
    nees: list[F64] = []
    images: list[Any] = [None] * runs
    for k in range(1, 120 + 1800 + 1):
        before = true
        true = with_noise(flown(true, 1.0), 1.0, ACCEL, TORQUE, rng)
        half = flown(before, 0.5, 1)
        for i, (ekf, feed) in enumerate(fleet):
            m, kept = true.at(i), rng.random(4) > 0.1
            if kept[0]:
                feed["in_gyro"].write(gyro_message(m, ARW * rng.normal(size=3)), s(k))
            if kept[1] and k % 3 == 0:
                feed[TRACK].write(tracker_message(m, TRACKER * rng.normal(size=3), s(k)), s(k))
            if kept[2] and k <= 120:
                feed[FIX].write(gps_message(m, GPS * rng.normal(size=6), k), s(k))
            if k % 17 == 0:
                images[i] = picture(half.at(i), k - 0.5, rng)
            if kept[3] and k % 17 == 2 and k > 17:
                feed[LANDMARKS].write(images[i], s(k))
            ekf.step(s(k))
        if k % 60 == 0:
            squares = [relative_error(true.at(i), latest(e).x) for i, (e, _) in enumerate(fleet)]
            nees.append(
                np.array([d @ np.linalg.solve(latest(e).P, d) for d, (e, _) in zip(squares, fleet, strict=True)])
            )
    criterion("EKF-14", max(outside_band(nees[i].tolist(), 12, 0.9999) for i in (1, 6, 16, -1)))


def test_sensors_of_the_simulation(criterion: Criterion) -> None:
    """Two minutes in sunlight with the truth side: frames, mountings, field, aberration of both sides agree."""
    early, world, begin = build(3), build(3), minutes(26)
    early.sim.run_until(begin)
    start, truth = world.spacecraft, early.spacecraft.out_state.latest()
    assert truth is not None
    gyro, dcm_BN = GYRO_BIAS, np.array(plain(mrp_to_dcm)(tuple(truth.sigma_BN)))
    guess = disturbed(
        Motion(truth.r_BN_N, truth.v_BN_N, dcm_BN, truth.omega_BN_B),
        np.repeat([300.0, 1.0, 5e-3, 1e-4], 3)[None] * np.random.default_rng(2).normal(size=12),
    ).at(0)
    stars = np.zeros((5120, 3))
    catalogue = bright_stars().u_N
    stars[: len(catalogue)] = catalogue
    g, h = coefficients_at(igrf14(), epoch(EPOCH))
    params = params_of(
        state_of(guess),
        start_ns=begin,
        P=np.diag(np.repeat([300.0, 1.0, 5e-3, 1e-4], 3) ** 2),
        inertia_B=np.array(start.params.inertia_B),
        mu=start.params.mu,
        radius=start.params.radius,
        j2=start.params.j2,
        gravity_gradient=True,
        accel_density=1e-10,
        torque_density=1e-13,
        sigma_gyro=3e-4,
        gyro_bias_P=gyro,
        gyro_delay=0.05,
        sigma_tracker=np.array([4.85e-5, 4.85e-5, 2.91e-4]),
        dcm_SB=DCM_SIDE,
        dcm_VB=DCM_ZENITH,
        star_count=len(catalogue),
        star_N=stars,
        aberration=True,
        r_AB_B=ARM_B,
        sigma_gps_r=6.0,
        field_degree=13,
        field_g=g,
        field_h=h,
        magnetic_bias_M=np.array([3e-7, -2e-7, 5e-7]),
        sigma_css=0.2,
    )
    ekf = EarthTrackerEkf("ekf", params)
    world.gps.out_fix.connect(ekf.in_gps)
    world.gyro.out_imu.connect(ekf.in_gyro)
    world.css_array.out_css.connect(ekf.in_css)
    world.magnetometer.out_field.connect(ekf.in_magnetometer)
    world.star_tracker.out_attitude.connect(ekf.in_star_tracker)
    world.star_vectors.out_stars.connect(ekf.in_star_vectors)
    world.sun.out_ephemeris.connect(ekf.in_sun)
    world.orientation.out_orientation.connect(ekf.in_orientation)
    tasks = [*world.sim.tasks, Task("filter", period=ms(500), modules=[ekf])]
    Simulation(tasks, seed=3).run_until(begin + minutes(2))
    message, truth, attitude = latest(ekf), start.out_state.latest(), ekf.out_attitude.latest()
    assert truth is not None
    assert attitude is not None
    assert np.all(message.used[[1, 2, 3, 4, 5, 6]] > 100)
    assert np.sum(message.refused) <= 2
    away = truth.r_BN_N - message.x[:3]  # the receiver's slow error of 3 m is not in the filter's covariance
    true = np.array(plain(mrp_to_dcm)(tuple(truth.sigma_BN)))
    turn = turn_between(true, np.array(plain(mrp_to_dcm)(tuple(attitude.sigma_BN))))
    criterion("EKF-15", float(turn @ np.linalg.solve(message.P[6:9, 6:9], turn)) / 3)
    assert float(np.linalg.norm(away)) < 10.0
    assert float(np.linalg.norm(turn)) < 1e-4


def test_many_steps(criterion: Criterion) -> None:
    """Ten thousand updates by a tracker that is very good and sees little of the rest."""
    (ekf, feed), m, worst = wired(state_of(nadir_pointing()), CAMERA), nadir_pointing(), 0
    message = tracker_message(m, np.zeros(3), 0)
    for k in range(1, 10_001):
        feed[TRACK].write(STAttMsg(exposure_ns=s(k), valid=True, beta_SN=message.beta_SN), s(k))
        ekf.step(s(k))
        if k % 100 == 0:
            P = latest(ekf).P
            size = np.sqrt(np.diag(P))
            worst += int(not np.linalg.eigvalsh(P / np.outer(size, size))[0] > 0.0)
            assert np.array_equal(P, P.T)
    criterion("EKF-16", worst)


def state(ekf: EarthTrackerEkf) -> int:
    return int(latest(ekf).status)


def test_wrong_measurements() -> None:
    """Each is refused with its reason, changes nothing, and the next good one is used."""
    (plain_ekf, _), (ekf, feed), m, rng = *fleet_of({}, {}), nadir_pointing(), np.random.default_rng(1)
    now = flown(Motion(m.r[None], m.v[None], m.dcm_BN[None], m.omega[None]), 1.0).at(0)
    good = tracker_message(now, np.zeros(3), s(1))
    nan, zero = np.full(4, np.nan), np.zeros(6)
    wrong: list[tuple[str, Any, int, int]] = [
        (TRACK, STAttMsg(exposure_ns=s(1), valid=True, beta_SN=nan), status.STAR_TRACKER, status.BAD_NUMBERS),
        (TRACK, STAttMsg(exposure_ns=s(1), valid=False, beta_SN=nan), status.STAR_TRACKER, status.INVALID),
        (TRACK, tracker_message(now, np.zeros(3), s(9)), status.STAR_TRACKER, status.FROM_FUTURE),
        (TRACK, tracker_message(now, np.full(3, 0.5), s(1)), status.STAR_TRACKER, status.GATED),
        (FIX, gps_message(now, zero + 1e5, 1.0), status.GPS, status.GATED),
        (LANDMARKS, picture(now, 1.0, rng, count=2), status.LANDMARKS, status.TOO_FEW),
        (LANDMARKS, picture(now, 1.0, rng, sigma_px=np.full(1024, np.nan)), status.LANDMARKS, status.BAD_NUMBERS),
        (LANDMARKS, picture(now, 1.0, rng, status=3), status.LANDMARKS, status.INVALID),
        ("in_css", CSSArraySensorMsg(signal=np.ones(6)), status.SUN_SENSORS, status.NO_INPUT),
    ]
    plain_ekf.step(s(1))
    clean = latest(plain_ekf)
    for name, message, sensor, reason in wrong:
        feed[name].write(message, s(1))
        ekf.step(s(1))
        found = latest(ekf)
        assert found.sensor_status[sensor] == reason, (name, found.sensor_status)
        np.testing.assert_array_equal(found.x, clean.x)
        np.testing.assert_array_equal(found.P, clean.P)
    feed[TRACK].write(good, s(1))
    ekf.step(s(1))
    used = latest(ekf)
    assert used.sensor_status[status.STAR_TRACKER] == status.UPDATED
    feed[TRACK].write(good, s(1))  # the same once more
    ekf.step(s(1))
    assert latest(ekf).sensor_status[status.STAR_TRACKER] == status.TOO_LATE
    np.testing.assert_array_equal(latest(ekf).x, used.x)
    ekf.step(s(1))
    assert latest(ekf).sensor_status[status.STAR_TRACKER] == status.NO_MEASUREMENT
    feed["in_torque"].write(CmdTorqueBodyMsg(torque_B=np.zeros(3)), s(1))
    feed["in_torque"].row["torque_B"] = np.nan
    ekf.step(s(2))
    assert state(ekf) == status.FAILED_PREDICTION
    np.testing.assert_array_equal(latest(ekf).x, used.x)
    feed["in_torque"].write(CmdTorqueBodyMsg(torque_B=np.zeros(3)), s(2))
    ekf.step(s(3))
    assert state(ekf) == 0
    assert latest(ekf).estimate_ns == s(3)


def test_outliers_among_landmarks() -> None:
    """Each third landmark is off by 60 px: they are left out one by one, and the estimate is that without them."""
    fleet, m, rng = fleet_of({}, {}), nadir_pointing(), np.random.default_rng(4)
    now = flown(Motion(m.r[None], m.v[None], m.dcm_BN[None], m.omega[None]), 1.0).at(0)
    for _, feed in fleet:
        feed[TRACK].write(tracker_message(now, np.zeros(3), s(1)), s(1))
        feed[FIX].write(gps_message(now, np.zeros(6), 1.0), s(1))
    image = picture(now, 1.0, rng)
    pixel, keep = image.pixel_px.copy(), np.arange(COUNT) % 3 != 0
    pixel[:COUNT][~keep] += 60.0
    bad = landmarks_message(image.r_LE_E[:COUNT], pixel[:COUNT], PIXEL, s(1))
    clean = landmarks_message(image.r_LE_E[:COUNT][keep], pixel[:COUNT][keep], PIXEL, s(1))
    for (ekf, feed), message in zip(fleet, (bad, clean), strict=True):
        feed[LANDMARKS].write(message, s(1))
        ekf.step(s(1))
        assert latest(ekf).landmarks == np.sum(keep)
    np.testing.assert_allclose(latest(fleet[0][0]).x, latest(fleet[1][0]).x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"P": np.diag([1.0] * 11 + [-1.0])}, "positive definite"),
        ({"sigma_gyro": 0.0}, "sigma_gyro"),
        ({"sigma_gps_r": -1.0}, "sigma_gps_r"),
        ({"accel_density": -1e-9}, "accel_density"),
        ({"order": np.array([0, 0, 1, 2, 3, 4, 5])}, "each of 0 to 6 once"),
        ({"shares": np.zeros(7)}, "shares"),
        ({"dcm_SB": 2.0 * np.eye(3)}, "rotation matrix"),
        ({"beta_BO": np.array([1.0, 1.0, 0.0, 0.0])}, "unit length"),
        ({"v_BN_N": np.zeros(3)}, "orbit"),
        ({"normals_B": np.zeros((6, 3))}, "normals_B"),
        ({"inertia_B": np.diag([1.0, 1.0, 9.0])}, "inertia"),
    ],
)
def test_wrong_parameters(more: dict[str, Any], text: str) -> None:
    """Refused when they are made, by name."""
    with pytest.raises(ValueError, match=text):
        params_of(state_of(nadir_pointing()), **more)
