"""Each measurement model against plain numpy, and its derivatives against midpoint differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw.math.vectors import mat3, vec3
from messages.base import F64
from modules.estimation.pose_models import landmarks, sensors
from modules.estimation.pose_models.pose import Pose, corrected_attitude

STEP = np.repeat([1.0, 1e-2, 1e-6, 1e-6], 3)
LENS = np.array([2000.0, 1990.0, 511.5, 383.5, 0.7, -0.1, 0.02, 1e-3, -5e-4, 0.003, 1e12])
OMEGA_EN_N = (0.0, 0.0, 7.292e-5)
Out = tuple[F64, F64]


def dcm(rng: np.random.Generator, size: float = 10.0) -> F64:
    """A random rotation."""
    return np.asarray(Rotation.from_rotvec(rng.normal(size=3) * size).as_matrix())


class Setup:
    """A spacecraft 500 km above a landmark, camera near nadir."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        up = rng.normal(size=3)
        up /= np.linalg.norm(up)
        self.r, self.v, self.omega = 6.878e6 * up, np.cross(up, rng.normal(size=3)) * 5e3, rng.normal(size=3) * 1e-2
        self.dcm_BN, self.dcm_EN, self.dcm_CB = dcm(rng), dcm(rng), dcm(rng)
        self.r_CB_B = rng.normal(size=3)
        # camera looks down: turn it so that C's z axis is -up
        down_B = self.dcm_BN @ -up
        side = np.cross(down_B, self.dcm_BN[0])
        side /= np.linalg.norm(side)
        self.dcm_CB = np.array([side, np.cross(down_B, side), down_B])
        self.L_E = self.dcm_EN @ (6.371e6 * (up + 0.02 * rng.normal(size=3)))

    def pose(self, error: F64) -> Pose:
        """The pose whose error state, seen from the nominal one, is ``error`` (12,)."""
        attitude = corrected_attitude(vec3(error[6:9]), mat3(self.dcm_BN))
        return vec3(self.r + error[:3]), vec3(self.v + error[3:6]), attitude, vec3(self.omega + error[9:])


def check(setup: Setup, residual: Callable[[Pose], Out], tolerance: float = 2e-7) -> None:
    """Derivatives of minus the residual by all twelve numbers."""
    _, H = residual(setup.pose(np.zeros(12)))
    for j in range(12):
        step = np.zeros(12)
        step[j] = STEP[j]
        slope = -(residual(setup.pose(step))[0] - residual(setup.pose(-step))[0]) / (2.0 * STEP[j])
        assert np.max(np.abs(slope - H[:, j])) <= tolerance * max(np.max(np.abs(slope)), 1e-3 * np.max(np.abs(H)))


def pixel(setup: Setup, pose: Pose, lens: F64 = LENS) -> tuple[F64, F64, list[F64], F64]:
    """Of the landmark: minus the pixel, derivatives, the other derivatives, rates."""
    H, mount, by_lens, by_map, work = (np.zeros((2, n)) for n in (12, 3, 10, 3, 3))
    seen = landmarks.landmark_pixel(
        pose,
        mat3(setup.dcm_CB),
        vec3(setup.r_CB_B),
        lens,
        mat3(setup.dcm_EN),
        OMEGA_EN_N,
        vec3(setup.L_E),
        H,
        mount,
        by_lens,
        by_map,
        work,
    )
    return -np.array(seen[:2]), H, [mount, by_lens, by_map], np.array(seen[2:])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_landmark_pixel(seed: int) -> None:
    """Pixel by numpy; derivatives by pose, mounting, lens and map; rate by a later pose."""
    s = Setup(seed)
    nominal = s.pose(np.zeros(12))
    minus, _, (mount, by_lens, by_map), rates = pixel(s, nominal)
    p = s.dcm_CB @ (s.dcm_BN @ (s.dcm_EN.T @ s.L_E - s.r) - s.r_CB_B)
    x, y = p[0] / p[2], p[1] / p[2]
    q = x * x + y * y
    radial = 1.0 - 0.1 * q + 0.02 * q * q + 0.003 * q**3
    xd = x * radial + 2.0 * 1e-3 * x * y - 5e-4 * (q + 2.0 * x * x)
    yd = y * radial + 1e-3 * (q + 2.0 * y * y) - 2.0 * 5e-4 * x * y
    np.testing.assert_allclose(-minus, [2000.0 * xd + 0.7 * yd + 511.5, 1990.0 * yd + 383.5], rtol=1e-12)
    check(s, lambda pose: pixel(s, pose)[:2])
    for j in range(10):
        step = np.zeros(11)
        step[j] = 1e-6 * max(1.0, abs(LENS[j]))
        slope = -(pixel(s, nominal, LENS + step)[0] - pixel(s, nominal, LENS - step)[0]) / (2.0 * step[j])
        np.testing.assert_allclose(slope, by_lens[:, j], atol=1e-6 * np.max(np.abs(by_lens[:, j])) + 1e-7)
    kept = s.dcm_CB, s.L_E
    for j in range(3):
        step = np.zeros(3)
        step[j] = 1e-6
        seen: list[F64] = []
        for sign in (1.0, -1.0):
            s.dcm_CB = np.asarray(corrected_attitude(vec3(sign * step), mat3(kept[0])))
            seen.append(pixel(s, nominal)[0])
        np.testing.assert_allclose((seen[1] - seen[0]) / 2e-6, mount[:, j], atol=1e-6 * np.max(np.abs(mount)))
        s.dcm_CB = kept[0]
        seen = []
        for sign in (1.0, -1.0):
            s.L_E = kept[1] + sign * step * 1e6
            seen.append(pixel(s, nominal)[0])
        np.testing.assert_allclose((seen[1] - seen[0]) / 2.0, by_map[:, j], atol=1e-6 * np.max(np.abs(by_map)))
        s.L_E = kept[1]
    # rate: the body moves and turns, the Earth turns
    t, moved = 1e-3, Setup(seed)
    moved.r, moved.dcm_BN = s.r + t * s.v, np.asarray(corrected_attitude(vec3(t * s.omega), mat3(s.dcm_BN)))
    moved.dcm_EN, moved.dcm_CB, moved.L_E = s.dcm_EN @ _spin(-t), s.dcm_CB, s.L_E
    later = pixel(moved, moved.pose(np.zeros(12)))[0]
    np.testing.assert_allclose((minus - later) / t, rates, rtol=1e-3)


def _spin(t: float) -> F64:
    """Rotation that takes a vector fixed in the turning Earth back by t [s]."""
    return np.asarray(Rotation.from_rotvec(np.array(OMEGA_EN_N) * t).as_matrix())


@pytest.mark.parametrize("seed", [4, 5])
def test_landmark_direction(seed: int) -> None:
    """Two residuals across the predicted direction; zero for the true one."""
    s = Setup(seed)
    p = s.dcm_CB @ (s.dcm_BN @ (s.dcm_EN.T @ s.L_E - s.r) - s.r_CB_B)
    measured = p / np.linalg.norm(p)

    def residual(pose: Pose) -> Out:
        H, mount, by_map, work = np.zeros((2, 12)), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))
        at = mat3(s.dcm_CB), vec3(s.r_CB_B), mat3(s.dcm_EN), vec3(s.L_E)
        return np.array(landmarks.landmark_direction(pose, *at, vec3(measured), H, mount, by_map, work)), H

    assert np.max(np.abs(residual(s.pose(np.zeros(12)))[0])) < 1e-15
    check(s, residual, 1e-5)
    turned = s.pose(np.array([0.0] * 6 + [1e-3, 2e-3, -1e-3] + [0.0] * 3))
    shift = s.dcm_CB @ np.asarray(turned[2]) @ s.dcm_BN.T @ s.dcm_CB.T @ measured
    assert np.linalg.norm(residual(turned)[0]) == pytest.approx(np.linalg.norm(np.cross(shift, measured)), rel=1e-5)


def test_gps() -> None:
    """Antenna on an arm, in the turning frame."""
    s = Setup(6)
    arm = np.array([1.5, -0.7, 0.4])
    r_A = s.r + s.dcm_BN.T @ arm
    v_A = s.v + s.dcm_BN.T @ np.cross(s.omega, arm)
    truth = s.dcm_EN @ r_A, s.dcm_EN @ (v_A - np.cross(OMEGA_EN_N, r_A))

    def residual(pose: Pose) -> Out:
        out, H = np.empty(6), np.empty((6, 12))
        sensors.gps(pose, vec3(arm), mat3(s.dcm_EN), OMEGA_EN_N, vec3(truth[0]), vec3(truth[1]), out, H)
        return out, H

    assert np.max(np.abs(residual(s.pose(np.zeros(12)))[0])) < 1e-8
    check(s, residual, 2e-3)  # a metre in 7e6 m has nine digits, and the arm's part is small


def test_attitude_sensors() -> None:
    """Gyro, star tracker, direction, Sun cell, magnetometer at the truth and by differences."""
    s = Setup(8)
    S, known = dcm(s.rng), np.array([0.6, 0.0, -0.8])
    field, gradient = np.array([2e-5, -1e-5, 3e-5]), np.array([[1.0, 2, 3], [2, -3, 1], [3, 1, 2]]) * 1e-12
    seen_B = s.dcm_BN @ known
    normal, bias = seen_B + np.array([0.3, -0.2, 0.1]), np.array([1e-6, 2e-6, -1e-6])
    normal /= np.linalg.norm(normal)
    at = mat3(S)

    def rate(pose: Pose) -> Out:
        out, H = np.empty(3), np.empty((3, 12))
        sensors.gyro(pose, at, vec3(bias), vec3(S @ s.omega + bias), out, H)
        return out, H

    def tracker(pose: Pose) -> Out:
        out, H = np.empty(3), np.empty((3, 12))
        sensors.star_tracker(pose, at, mat3(S @ s.dcm_BN), out, H)
        return out, H

    def star(pose: Pose) -> Out:
        out, H = np.empty(2), np.empty((2, 12))
        sensors.direction(pose, at, vec3(known), vec3(S @ seen_B), out, H)
        return out, H

    def cell(pose: Pose) -> Out:
        out, H = np.empty(1), np.empty((1, 12))
        cosine = sensors.sun_cell(pose, vec3(normal), vec3(known), 0.97, 0.97 * float(normal @ seen_B), out, H)
        assert cosine > 0.5
        return out, H

    def magnet(pose: Pose) -> Out:
        out, H = np.empty(3), np.empty((3, 12))
        here = field + gradient @ (np.array(pose[0]) - s.r)
        truth = S @ s.dcm_BN @ field + bias
        sensors.magnetometer(pose, at, vec3(here), mat3(gradient), vec3(bias), vec3(truth), out, H)
        return out, H

    for model in (rate, tracker, star, cell, magnet):
        assert np.max(np.abs(model(s.pose(np.zeros(12)))[0])) < 1e-14
        check(s, model, 1e-4)
