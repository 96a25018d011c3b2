"""Truth for filters of pose: many runs at once about the Earth, with their sensors, in plain numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp as _solve_ivp  # pyright: ignore[reportUnknownVariableType]
from scipy.spatial.transform import Rotation

from messages.base import F64
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, LandmarksMsg

solve_ivp: Any = _solve_ivp  # pyright: ignore[reportUnknownVariableType]
MU, RADIUS, J2 = 3.986004415e14, 6378136.3, 1.08262617385222e-3
SPIN = 7.292115e-5
"""Of the Earth [rad/s], about the z axis of N."""
GROUND = 6371e3
"""Radius of the sphere that carries the landmarks [m]."""
INERTIA = np.array([[0.040, 0.001, 0.0], [0.001, 0.050, -0.001], [0.0, -0.001, 0.020]])
BACK = np.linalg.inv(INERTIA)
ARCSEC = math.pi / 648000.0


def rotation(vector: F64) -> F64:
    """Passive matrices exp(-[v x]) of rotation vectors (..., 3)."""
    flat = np.atleast_2d(vector)
    return np.asarray(Rotation.from_rotvec(-flat).as_matrix()).reshape(*np.shape(vector)[:-1], 3, 3)


def turn_between(true: F64, estimated: F64) -> F64:
    """Rotation vectors theta (..., 3) with true = exp(-[theta x]) estimated, of matrices (..., 3, 3)."""
    relative = true @ np.swapaxes(estimated, -1, -2)
    flat = np.asarray(Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_rotvec())
    return -flat.reshape(*relative.shape[:-2], 3)


def earth(t: float) -> F64:
    """dcm_EN."""
    c, s = math.cos(SPIN * t), math.sin(SPIN * t)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def gravity(r: F64) -> F64:
    """Acceleration at positions (..., 3), from the potential's derivative by hand."""
    far = np.linalg.norm(r, axis=-1, keepdims=True)
    z2 = (r[..., 2:] / far) ** 2
    factor = 1.5 * J2 * (RADIUS / far) ** 2
    return -MU * r / far**3 * (1.0 + factor * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2))


def orbit_frame(r: F64, v: F64) -> F64:
    """dcm_ON (..., 3, 3)."""
    z = -r / np.linalg.norm(r, axis=-1, keepdims=True)
    y: F64 = -np.cross(r, v)
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.asarray(np.stack([np.cross(y, z), y, z], axis=-2), np.float64)


def orbit_rate(r: F64, v: F64, h: float = 0.05) -> F64:
    """omega_ON_O (..., 3) by differences of the frame along the motion."""
    a = gravity(r)
    after, before = (orbit_frame(r + s * h * v + 0.5 * h * h * a, v + s * h * a) for s in (1.0, -1.0))
    W = -(after - before) / (2.0 * h) @ np.swapaxes(orbit_frame(r, v), -1, -2)
    return np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)


@dataclass
class Motion:
    """States of runs relative to N."""

    r: F64
    v: F64
    dcm_BN: F64
    omega: F64

    def at(self, k: int) -> Motion:
        """One run."""
        return Motion(self.r[k], self.v[k], self.dcm_BN[k], self.omega[k])


def slope(y: F64, torque: F64) -> F64:
    """Derivative of states (runs, 13): r, v, quaternion of scipy (active, from B to N), omega_BN_B."""
    q, w = y[:, 6:10], y[:, 10:]
    axis, scalar = q[:, :3], q[:, 3:]
    dq = 0.5 * np.hstack([scalar * w + np.cross(axis, w), -np.sum(axis * w, axis=1, keepdims=True)])
    dw = (torque - np.cross(w, w @ INERTIA)) @ BACK
    return np.hstack([y[:, 3:6], gravity(y[:, :3]), dq, dw])


def packed(m: Motion) -> F64:
    """As numbers (runs, 13)."""
    q = np.asarray(Rotation.from_matrix(np.swapaxes(m.dcm_BN, -1, -2)).as_quat())
    return np.hstack([m.r, m.v, q, m.omega])


def unpacked(y: F64) -> Motion:
    """From numbers (runs, 13)."""
    dcm = np.asarray(Rotation.from_quat(y[:, 6:10]).as_matrix())
    return Motion(y[:, :3].copy(), y[:, 3:6].copy(), np.swapaxes(dcm, -1, -2), y[:, 10:].copy())


def flown(m: Motion, dt: float, steps: int = 2, torque: F64 | float = 0.0) -> Motion:
    """By Runge-Kutta steps."""
    y, h, T = packed(m), dt / steps, np.zeros(3) + torque
    for _ in range(steps):
        a = slope(y, T)
        b = slope(y + h / 2 * a, T)
        c = slope(y + h / 2 * b, T)
        d = slope(y + h * c, T)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
    return unpacked(y)


def exact(m: Motion, times: F64, torque: F64 | float = 0.0) -> list[Motion]:
    """One run at times [s], by DOP853 of scipy."""
    T = np.zeros(3) + torque

    def right(_: float, y: F64) -> F64:
        return slope(y[None], T)[0]

    start = packed(Motion(m.r[None], m.v[None], m.dcm_BN[None], m.omega[None]))[0]
    end = float(times[-1])
    found = solve_ivp(
        right, (0.0, end), start, "DOP853", times, rtol=3e-14, atol=np.repeat([1e-6, 1e-9, 1e-14], [3, 3, 7])
    )
    return [unpacked(column[None]).at(0) for column in found.y.T]


def with_noise(m: Motion, dt: float, accel: float, torque: float, rng: np.random.Generator) -> Motion:
    """What white acceleration and torque of these densities add in dt, by its exact covariance without gravity."""
    root = np.linalg.cholesky(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
    runs = len(m.r)
    push = math.sqrt(accel) * np.einsum("ij,jrk->irk", root, rng.normal(size=(2, runs, 3)))
    twist = math.sqrt(torque) * np.einsum("ij,jrk->irk", root, rng.normal(size=(2, runs, 3)))
    twist = np.einsum("ij,arj->ari", np.linalg.inv(INERTIA), twist)
    return Motion(m.r + push[0], m.v + push[1], rotation(twist[0]) @ m.dcm_BN, m.omega + twist[1])


def nadir_pointing(off_nadir: float = 0.0, height: float = 500e3) -> Motion:
    """The nominal motion: inclined orbit, camera's axis turned about the along-track axis, at rest in O."""
    far, inclination = 6378137.0 + height, math.radians(51.6)
    u = math.radians(25.0)
    c, n = math.cos(inclination), math.sin(inclination)
    node = np.array([[1.0, 0.0, 0.0], [0.0, c, -n], [0.0, n, c]])
    r = node @ np.array([math.cos(u), math.sin(u), 0.0]) * far
    v = node @ np.array([-math.sin(u), math.cos(u), 0.0]) * math.sqrt(MU / far)
    dcm_BO = rotation(np.array([off_nadir, 0.0, 0.0]))
    dcm_ON = orbit_frame(r, v)
    return Motion(r, v, dcm_BO @ dcm_ON, dcm_BO @ orbit_rate(r, v))


def disturbed(m: Motion, error: F64) -> Motion:
    """The motion whose error (runs, 12) relative to a nominal one is dr, dv, theta_BO, domega_BO."""
    r, v = m.r + error[:, :3], m.v + error[:, 3:6]
    dcm_BO = m.dcm_BN @ orbit_frame(m.r, m.v).T
    omega_BO = m.omega - dcm_BO @ orbit_rate(m.r, m.v)
    true_BO = rotation(error[:, 6:9]) @ dcm_BO
    omega = omega_BO + error[:, 9:] + np.einsum("rij,rj->ri", true_BO, orbit_rate(r, v))
    return Motion(r, v, true_BO @ orbit_frame(r, v), omega)


def relative_error(true: Motion, x: F64) -> F64:
    """Error (12,) of a filter's 13 numbers: true minus estimated."""
    w, a, b, c = x[6:10]
    estimated = np.asarray(Rotation.from_quat([a, b, c, w]).as_matrix()).T
    dcm_BO = true.dcm_BN @ orbit_frame(true.r, true.v).T
    omega_BO = true.omega - dcm_BO @ orbit_rate(true.r, true.v)
    return np.concatenate([true.r - x[:3], true.v - x[3:6], turn_between(dcm_BO, estimated), omega_BO - x[10:]])


def attitude_error(true: Motion, x: F64) -> F64:
    """Attitude error (3,) relative to N."""
    w, a, b, c = x[6:10]
    estimated = np.asarray(Rotation.from_quat([a, b, c, w]).as_matrix()).T @ orbit_frame(x[:3], x[3:6])
    return turn_between(true.dcm_BN, estimated)


def state_of(m: Motion) -> F64:
    """The 13 numbers of one motion."""
    dcm_BO = m.dcm_BN @ orbit_frame(m.r, m.v).T
    a, b, c, w = np.asarray(Rotation.from_matrix(dcm_BO.T).as_quat())
    return np.concatenate([m.r, m.v, [w, a, b, c], m.omega - dcm_BO @ orbit_rate(m.r, m.v)])


@dataclass
class Camera:
    """A square camera without distortion that looks along z of B."""

    focal: float
    size: int = 2048
    message: CameraConfigMsg = field(init=False)

    def __post_init__(self) -> None:
        """Make its message."""
        self.message = CameraConfigMsg(
            width_px=self.size,
            height_px=self.size,
            focal_px=np.full(2, self.focal),
            center_px=np.full(2, (self.size - 1) / 2),
        )

    def pixels(self, m: Motion, r_LE_E: F64, t: float) -> F64:
        """Of landmarks (n, 3) for one run, (n, 2)."""
        p = (r_LE_E @ earth(t) - m.r) @ m.dcm_BN.T
        return self.focal * p[:, :2] / p[:, 2:] + (self.size - 1) / 2

    def landmarks(self, m: Motion, n: int, t: float, rng: np.random.Generator, part: float = 0.85) -> F64:
        """Places (n, 3) on the ground in a middle part of the view."""
        tangent = (rng.uniform(-0.5, 0.5, (n, 2)) * part * self.size) / self.focal
        ray = np.column_stack([tangent, np.ones(n)]) @ m.dcm_BN
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        along = -ray @ m.r
        reach = along - np.sqrt(along**2 - (m.r @ m.r - GROUND**2))
        return (m.r + reach[:, None] * ray) @ earth(t).T


def landmarks_message(r_LE_E: F64, pixel: F64, sigma: float, exposure_ns: int, **more: Any) -> LandmarksMsg:
    """Landmarks (n, 3) seen at pixels (n, 2)."""
    n = len(pixel)
    arrays: dict[str, F64] = {
        "r_LE_E": np.full((MAX_LANDMARKS, 3), np.nan),
        "pixel_px": np.full((MAX_LANDMARKS, 2), np.nan),
        "sigma_px": np.full(MAX_LANDMARKS, np.nan),
    }
    for name, values in (("r_LE_E", r_LE_E), ("pixel_px", pixel), ("sigma_px", np.full(n, sigma))):
        arrays[name][:n] = values
    other: dict[str, Any] = {"count": n, "candidates": n, "cells": 24, "score": np.full(MAX_LANDMARKS, np.nan)}
    fields: dict[str, Any] = {**arrays, **other, **more}
    return LandmarksMsg(exposure_ns=exposure_ns, **fields)
