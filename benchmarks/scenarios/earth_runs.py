"""A fleet of Earth tracker filters along runs of the truth, and the bound of their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm as _expm  # pyright: ignore[reportUnknownVariableType]
from scipy.spatial.transform import Rotation

from benchmarks.scenarios.earth_truth import (
    ARCSEC,
    INERTIA,
    J2,
    MU,
    RADIUS,
    SPIN,
    Camera,
    Motion,
    attitude_error,
    disturbed,
    earth,
    flown,
    gravity,
    landmarks_message,
    nadir_pointing,
    relative_error,
    rotation,
    state_of,
    turn_between,
    with_noise,
)
from benchmarks.scenarios.feed import fed
from fsw import OutPort, s
from messages.base import F64
from messages.environment import PlanetOrientationMsg
from messages.filters import EarthTrackerFilterMsg
from messages.sensors import GPSSensorMsg, IMUSensorMsg, STAttMsg
from modules.estimation.analysis import Bound
from modules.estimation.earth_tracker_ekf import EarthTrackerEkf

expm: Any = _expm  # pyright: ignore[reportUnknownVariableType]
ARW = math.radians(0.1) / 60.0
"""Angle random walk of the gyro [rad/s^0.5]; at 1 Hz its readings have this error [rad/s]."""
TRACKER = np.array([10.0, 10.0, 60.0]) * ARCSEC
GPS = np.repeat([5.0, 0.05], 3)
PIXEL, COUNT, EVERY = 0.5, 30, 10
"""Error of a pixel's coordinate, landmarks in an image, seconds between images."""
P0 = np.diag(np.repeat([2000.0, 3.0, math.radians(0.3), 1e-4], 3) ** 2)
ACCEL, TORQUE = 1e-14, 1e-14
NARROW, WIDE = 500e3 / 15.0, 1024.0 / math.tan(math.radians(30.0))
"""Focal lengths [px] of 15 m on the ground at 500 km and of a field of view of 60 degrees."""
Wired = tuple[EarthTrackerEkf, dict[str, OutPort[Any]]]


def params_of(x: F64, **more: Any) -> EarthTrackerEkf.Params:
    """Parameters that agree with the truth, from the 13 numbers of the first guess."""
    given: dict[str, Any] = {
        "r_BN_N": x[:3],
        "v_BN_N": x[3:6],
        "beta_BO": x[6:10],
        "omega_BO_B": x[10:],
        "P": P0,
        "inertia_B": INERTIA,
        "mu": MU,
        "radius": RADIUS,
        "j2": J2,
        "accel_density": ACCEL,
        "torque_density": TORQUE,
        "sigma_gyro": ARW,
        "sigma_tracker": TRACKER,
        "sigma_gps_r": GPS[0],
        "sigma_gps_v": GPS[3],
    }
    return EarthTrackerEkf.Params(**{**given, **more})


def wired(x: F64, camera: Camera | None = None, **more: Any) -> Wired:
    """A filter and its inputs; the Earth turns and is at its zero at the start."""
    ekf = EarthTrackerEkf("ekf", params_of(x, **more))
    feed = fed(ekf)
    feed["in_orientation"].write(PlanetOrientationMsg(dcm_EN=earth(0.0), omega_EN_N=np.array([0.0, 0.0, SPIN])), 0)
    if camera is not None:
        feed["in_camera"].write(camera.message, 0)
    return ekf, feed


def latest(ekf: EarthTrackerEkf) -> EarthTrackerFilterMsg:
    """What the filter wrote last."""
    message = ekf.out_filter.latest()
    assert message is not None
    return message


def gyro_message(m: Motion, noise: F64) -> IMUSensorMsg:
    """A reading of the gyro."""
    return IMUSensorMsg(omega_PN_P=m.omega + noise, accel_P=np.full(3, np.nan))


def tracker_message(m: Motion, noise: F64, t_ns: int) -> STAttMsg:
    """An attitude of the star tracker."""
    a, b, c, w = np.asarray(Rotation.from_matrix((rotation(noise) @ m.dcm_BN).T).as_quat())
    return STAttMsg(exposure_ns=t_ns, valid=True, beta_SN=np.array([w, a, b, c]))


def gps_message(m: Motion, noise: F64, t: float) -> GPSSensorMsg:
    """A fix of the receiver."""
    E, spin = earth(t), np.array([0.0, 0.0, SPIN])
    r, v = E @ m.r + noise[:3], E @ (m.v - np.cross(spin, m.r)) + noise[3:]
    return GPSSensorMsg(fix_ns=round(t * 1e9), r_AE_E=r, v_AE_E=v, lat=0.0, lon=0.0, h=0.0)


@dataclass
class Outcome:
    """Of some runs at the times of images: errors (K, runs, 3) [m], [rad] and squares (K, runs) of 12 numbers."""

    position: F64
    attitude: F64
    nees: F64
    error: F64
    P: F64
    bound: F64
    """(K, 12, 12), of the error relative to N."""


class Bounded:
    """The bound along the nominal motion, by derivatives of its own."""

    def __init__(self, nominal: Motion, P: F64) -> None:
        """Start with the prior P (12, 12) of the error relative to O."""
        size, T = np.sqrt(np.diag(P)), np.empty((12, 12))
        for j in range(12):  # the prior is of the error relative to O
            step = np.zeros((2, 12))
            step[0, j], step[1, j] = 0.01 * size[j], -0.01 * size[j]
            moved = disturbed(nominal, step)
            a, b = (relative_to_N(moved.at(i), nominal) for i in range(2))
            T[:, j] = (a - b) / (0.02 * size[j])
        self.bound = Bound(T @ P @ T.T)

    def predict(self, m: Motion, dt: float, accel: float, torque: float) -> None:
        """Over dt [s], with these densities."""
        F = np.zeros((12, 12))
        F[:3, 3:6] = F[6:9, 9:] = np.eye(3)
        F[3:6, :3] = np.column_stack([(gravity(m.r + e) - gravity(m.r - e)) / 20.0 for e in 10.0 * np.eye(3)])
        F[6:9, 6:9] = -cross(m.omega)
        F[9:, 9:] = np.linalg.solve(INERTIA, cross(INERTIA @ m.omega) - cross(m.omega) @ INERTIA)
        back, Q = np.linalg.inv(INERTIA), np.zeros((12, 12))
        for at, q in ((0, accel * np.eye(3)), (6, torque * back @ back.T)):
            Q[at : at + 6, at : at + 6] = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], q)
        self.bound.predict(expm(F * dt), Q)

    def landmarks(self, m: Motion, camera: Camera, r_LE_E: F64, t: float, sigma: float) -> None:
        """An image."""
        p = (r_LE_E @ earth(t) - m.r) @ m.dcm_BN.T
        H = np.zeros((2 * len(p), 12))
        for i, (x, y, z) in enumerate(p):
            D = camera.focal / z * np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z]])
            H[2 * i : 2 * i + 2, :3], H[2 * i : 2 * i + 2, 6:9] = -D @ m.dcm_BN, D @ cross(p[i])
        self.bound.measure(H, sigma**2 * np.eye(len(H)))

    def part(self, rows: slice, sigma: F64) -> None:
        """Of the error state itself."""
        self.bound.measure(np.eye(12)[rows], np.diag(sigma**2))


def cross(a: F64) -> F64:
    """Matrix [a x]."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def relative_to_N(true: Motion, nominal: Motion) -> F64:
    """Error state (12,) relative to N."""
    turn = turn_between(true.dcm_BN, nominal.dcm_BN)
    return np.concatenate([true.r - nominal.r, true.v - nominal.v, turn, true.omega - nominal.omega])


def fly(
    focal: float,
    off_nadir: float,
    use: str,
    runs: int,
    seconds: int,
    seed: int,
    accel: float = ACCEL,
    torque: float = TORQUE,
    **more: Any,
) -> Outcome:
    """Runs from first guesses with the covariance P0, sensors at 1 Hz, images every ten seconds.

    Args:
        focal: of the camera [px].
        off_nadir: tilt of its axis [rad].
        use: sensors beside camera and gyro, "tracker" or "gps" or both.
        runs: how many.
        seconds: how long.
        seed: of the random numbers.
        accel: density of the truth's acceleration, known to the filter.
        torque: density of the truth's torque, known to the filter.
        more: parameters of the filter.
    """
    rng, camera, nominal = np.random.default_rng(seed), Camera(focal), nadir_pointing(off_nadir)
    guess = state_of(nominal)
    fleet = [wired(guess, camera, accel_density=accel, torque_density=torque, **more) for _ in range(runs)]
    true = disturbed(nominal, rng.normal(size=(runs, 12)) @ np.sqrt(P0))
    middle = Motion(nominal.r[None], nominal.v[None], nominal.dcm_BN[None], nominal.omega[None])
    bounded, K = Bounded(nominal, P0), seconds // EVERY
    out = Outcome(
        np.empty((K, runs, 3)),
        np.empty((K, runs, 3)),
        np.empty((K, runs)),
        np.empty((K, runs, 12)),
        np.empty((K, runs, 12, 12)),
        np.empty((K, 12, 12)),
    )
    for k in range(1, seconds + 1):
        t_ns, seen = s(k), np.empty((0, 3))
        bounded.predict(middle.at(0), 1.0, accel, torque)
        true, middle = with_noise(flown(true, 1.0), 1.0, accel, torque, rng), flown(middle, 1.0)
        bounded.part(slice(9, 12), np.full(3, ARW))
        if "tracker" in use:
            bounded.part(slice(6, 9), TRACKER)
        if "gps" in use:
            bounded.part(slice(0, 6), GPS)
        if k % EVERY == 0:
            seen = camera.landmarks(middle.at(0), COUNT, k, rng)
            bounded.landmarks(middle.at(0), camera, seen, k, PIXEL)
            out.bound[k // EVERY - 1] = bounded.bound.covariance()
        for i, (ekf, feed) in enumerate(fleet):
            m = true.at(i)
            feed["in_gyro"].write(gyro_message(m, ARW * rng.normal(size=3)), t_ns)
            if "tracker" in use:
                feed["in_star_tracker"].write(tracker_message(m, TRACKER * rng.normal(size=3), t_ns), t_ns)
            if "gps" in use:
                feed["in_gps"].write(gps_message(m, GPS * rng.normal(size=6), k), t_ns)
            if len(seen):
                pixel = camera.pixels(m, seen, k) + PIXEL * rng.normal(size=(COUNT, 2))
                feed["in_landmarks"].write(landmarks_message(seen, pixel, PIXEL, t_ns), t_ns)
            ekf.step(t_ns)
            if len(seen):
                message, row = latest(ekf), k // EVERY - 1
                error = relative_error(m, message.x)
                out.position[row, i], out.attitude[row, i] = error[:3], attitude_error(m, message.x)
                out.error[row, i], out.P[row, i] = error, message.P
                out.nees[row, i] = error @ np.linalg.solve(message.P, error)
    return out
