"""What landmarks in an image say: pixels or unit vectors, each through a gate, as six rows."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.camera import LENS_SIZE, distort_slopes, undistort_point
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, dot, mat3, unit, vec3
from fsw.module import Row
from messages.base import F64, I64
from modules.estimation.earth_tracker_ekf import status
from modules.estimation.earth_tracker_ekf.few import Found, divide, put_compressed
from modules.estimation.pose_models.landmarks import landmark_direction, landmark_from_camera, landmark_pixel
from modules.estimation.pose_models.pose import SIZE, THETA, Pose, R, across
from modules.opnav.relative import lens_of

LANDMARK_GATE = 18.42
"""Normalised square of a landmark's two residuals that one in 10,000 good ones exceeds."""


@compiled
def pose_covariance(P: F64, M: F64, near: F64) -> None:
    """Covariance ``near`` (6, 6) of position and attitude of the pose; M (12, 12) by P's error (12, 12)."""
    half = np.zeros((6, SIZE))
    for i in range(6):
        row = i if i < 3 else i + 3
        for k in range(SIZE):
            m = M[row, k]
            if m != 0.0:
                for j in range(SIZE):
                    half[i, j] += m * P[k, j]
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(SIZE):
                total += half[i, k] * M[j if j < 3 else j + 3, k]
            near[i, j] = near[j, i] = total


@compiled
def normal_pair(H: F64, residual: F64, near: F64) -> float:
    """Normalised square of two white residuals (2,) with derivatives H (2, 12) by a pose of covariance (6, 6)."""
    a, b, c = 1.0, 0.0, 1.0
    for i in range(6):
        p = q = 0.0
        for k in range(6):
            column = k if k < 3 else k + 3
            p += near[i, k] * H[0, column]
            q += near[i, k] * H[1, column]
        column = i if i < 3 else i + 3
        a += H[0, column] * p
        b += H[0, column] * q
        c += H[1, column] * q
    u, v = residual[0], residual[1]
    return (c * u * u - 2.0 * b * u * v + a * v * v) / (a * c - b * b)


@compiled
def whiten_pair(a: float, b: float, c: float, H: F64, residual: F64) -> bool:
    """Two rows (2, 12), (2,) with the covariance [[a, b], [b, c]] made independent; False if that is not positive."""
    if not (a > 0.0 and a * c - b * b > 0.0):
        return False
    first = math.sqrt(a)
    mixed = b / first
    second = math.sqrt(c - mixed * mixed)
    divide(H, residual, 0, first)
    residual[1] -= mixed * residual[0]
    for j in range(SIZE):
        H[1, j] -= mixed * H[0, j]
    divide(H, residual, 1, second)
    return True


@compiled
def pixel_rows(
    pose: Pose, dcm_CB: M3, dcm_EN: M3, k: int, lens: F64, params: Row, found: Row, H: F64, residual: F64, work: F64
) -> bool:
    """The two rows (2, 12) of a landmark, by pixel or by unit vector; False if it is outside the lens or no number."""
    r_CB_B, r_LE_E, zero = vec3(params.r_CB_B), vec3(found.r_LE_E[k]), (0.0, 0.0, 0.0)
    u, v = found.pixel_px[k, 0], found.pixel_px[k, 1]
    a, b, c = found.P_px[k, 0, 0], found.P_px[k, 1, 0], found.P_px[k, 1, 1]
    if math.isnan(a + b + c):
        a, b = found.sigma_px[k] * found.sigma_px[k], 0.0
        c = a
    if params.unit_vectors:
        x, y = undistort_point(lens, u, v)
        seen = unit((x, y, 1.0))
        first, second = landmark_direction(
            pose, dcm_CB, r_CB_B, dcm_EN, r_LE_E, seen, H, work[0:2], work[2:4], work[4:6]
        )
        residual[0], residual[1] = first, second
        if not math.isfinite(first + second):
            return False
        # the pixel's covariance on the two axes across the landmark, through tangents and direction
        xx, xy, yx, yy = distort_slopes(lens, x, y)
        ux, uy = lens[0] * xx + lens[4] * yx, lens[0] * xy + lens[4] * yy
        vx, vy = lens[1] * yx, lens[1] * yy
        det, far = ux * vy - uy * vx, math.sqrt(x * x + y * y + 1.0)
        _, p_C = landmark_from_camera(pose, dcm_CB, r_CB_B, dcm_EN, r_LE_E)
        e1, e2 = across(unit(p_C))
        p, q = across_pixel(e1, seen, far, ux, uy, vx, vy, det)
        s, t = across_pixel(e2, seen, far, ux, uy, vx, vy, det)
        a, b, c = (
            p * p * a + 2.0 * p * q * b + q * q * c,
            p * s * a + (p * t + q * s) * b + q * t * c,
            s * s * a + 2.0 * s * t * b + t * t * c,
        )
    else:
        x, y, _, _ = landmark_pixel(
            pose, dcm_CB, r_CB_B, lens, dcm_EN, zero, r_LE_E, H, work[0:2], work[6:8], work[2:4], work[4:6]
        )
        residual[0], residual[1] = u - x, v - y
        if not math.isfinite(residual[0] + residual[1]):
            return False
    if params.sigma_map > 0.0:  # an error of the map moves the landmark as one of the position moves the camera
        s2 = params.sigma_map * params.sigma_map
        for j in range(3):
            a += s2 * H[0, R + j] * H[0, R + j]
            b += s2 * H[0, R + j] * H[1, R + j]
            c += s2 * H[1, R + j] * H[1, R + j]
    return whiten_pair(a, b, c, H, residual)


@compiled
def across_pixel(
    axis: V3, seen: V3, far: float, ux: float, uy: float, vx: float, vy: float, det: float
) -> tuple[float, float]:
    """How the component of a direction along an axis changes with the pixel's column and row [rad/px]."""
    along = dot(axis, seen)
    by_x, by_y = (axis[0] - along * seen[0]) / far, (axis[1] - along * seen[1]) / far
    return (by_x * vy - by_y * vx) / det, (by_y * ux - by_x * uy) / det


@compiled
def landmark_rows(
    pose: Pose,
    P: F64,
    M: F64,
    params: Row,
    found: Row,
    camera: Row,
    dcm_EN: M3,
    first: bool,
    keep: I64,
    H: F64,
    residual: F64,
) -> Found:
    """All landmarks of an image that pass the gate, as six rows.

    Args:
        pose: at the exposure.
        P: covariance (12, 12) of the filter's error now.
        M: derivative (12, 12) of the error of the pose by that.
        params: of the module.
        found: the landmarks.
        camera: lens and mounting.
        dcm_EN: orientation of the Earth at the exposure.
        first: choose the landmarks; if not, take those that were chosen.
        keep: in and out (n,), 1 for chosen ones.
        H: out.
        residual: out.
    """
    count = found.count
    if found.status != 0:
        return status.INVALID, 0
    if count < params.min_landmarks:
        return status.TOO_FEW, 0
    lens, rows, work = np.empty(LENS_SIZE), np.empty((2 * count, 7)), np.empty((8, 10))
    pair, seen = np.empty((2, SIZE)), np.empty(2)
    lens_of(camera, lens)
    dcm_CB = mat3(camera.dcm_CB)
    near = np.zeros((6, 6))
    if first:
        pose_covariance(P, M, near)
    n = 0
    for k in range(count):
        if not first and keep[k] == 0:
            continue
        keep[k] = 0
        check = found.sigma_px[k]
        for i in range(3):
            check += found.r_LE_E[k, i] + (found.pixel_px[k, i] if i < 2 else 0.0)
        if not math.isfinite(check) or not found.sigma_px[k] > 0.0:
            return status.BAD_NUMBERS, 0
        if not pixel_rows(pose, dcm_CB, dcm_EN, k, lens, params, found, pair, seen, work):
            continue
        if first and params.gate > 0.0 and not normal_pair(pair, seen, near) <= params.gate * LANDMARK_GATE:
            continue
        keep[k] = 1
        for i in range(2):
            for j in range(3):
                rows[n, j], rows[n, 3 + j] = pair[i, R + j], pair[i, THETA + j]
            rows[n, 6] = seen[i]
            n += 1
    if n < 2 * params.min_landmarks:
        return status.TOO_FEW, 0
    return put_compressed(rows[:n], H, residual)
