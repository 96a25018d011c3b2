"""The landmarks of one image as one measurement: iterated, gated one by one, with robust weights.

Sources: Bell and Cathey (1993), "The iterated Kalman filter update as a Gauss-Newton method", IEEE Trans. Automatic
Control 38(2); Huber (1981), "Robust Statistics", ch. 7; `fsw.math.extended.compress` for the many rows.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from fsw.math.attitude import ep_to_dcm, rotvec_to_dcm
from fsw.math.camera import LENS_SIZE
from fsw.math.compiled import compiled
from fsw.math.extended import compress, gain, innovation_covariance, normalised_square
from fsw.math.square_root import OK
from fsw.math.vectors import M3, V3, add, mat3, matmul, scale, vec3, vec4
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf.instants import by_error_state
from modules.estimation.pose_mekf.layout import (
    BIAS,
    CENTER,
    CORE,
    FOCAL,
    K1,
    MAP,
    MOUNT,
    SIZE,
    THETA,
    TIME,
    X_BETA,
    X_NUISANCE,
    R,
    V,
    mask,
)
from modules.estimation.pose_mekf.motion import field, pose_of
from modules.estimation.pose_models.landmarks import exposed_at, landmark_pixel
from modules.estimation.pose_models.pose import Pose
from modules.opnav.relative import lens_of

Scene: TypeAlias = tuple[Pose, V3, M3, M3, V3, float]
"""Pose at the stamp, acceleration, mounting, dcm_EN, angular rate of E, time of the exposure after its stamp."""


@compiled
def _scene(x: F64, lens: F64, params: Row, in_camera: Row, dcm_EN: M3, omega_EN_N: V3) -> Scene:
    """What all landmarks share for an estimate (34,); writes the lens (11,) with its corrections."""
    lens_of(in_camera, lens)
    n = X_NUISANCE - CORE
    grown = 1.0 + x[n + FOCAL]
    lens[0], lens[1], lens[4] = lens[0] * grown, lens[1] * grown, lens[4] * grown
    lens[2], lens[3] = lens[2] + x[n + CENTER], lens[3] + x[n + CENTER + 1]
    lens[5] += x[n + K1]
    dcm_CB = matmul(rotvec_to_dcm(vec3(x[n + MOUNT :])), mat3(in_camera.dcm_CB))
    pose = pose_of(x, ep_to_dcm(vec4(x[X_BETA:])))
    return pose, field(pose[0], dcm_EN, params), dcm_CB, dcm_EN, omega_EN_N, x[n + TIME]


@compiled
def _pixel(scene: Scene, lens: F64, params: Row, map_bias: V3, r_LE_E: V3, after: float, H: F64) -> tuple[float, float]:
    """Predicted pixel and its derivatives H (2, 26) of a landmark exposed ``after`` [s] later; NaN: unseen."""
    pose, accel, dcm_CB, dcm_EN, omega_EN_N, late = scene
    t = late + after
    if t != 0.0:
        pose = exposed_at(pose, accel, rotvec_to_dcm(scale(t, pose[3])), t)
        dcm_EN = matmul(dcm_EN, rotvec_to_dcm(scale(t, omega_EN_N)))
    H_pose, H_mount, H_lens = np.empty((2, CORE)), np.empty((2, 3)), np.empty((2, 10))
    H_map, d_point = np.empty((2, 3)), np.empty((2, 3))
    u, v, du, dv = landmark_pixel(
        pose,
        dcm_CB,
        vec3(params.r_CB_B),
        lens,
        dcm_EN,
        omega_EN_N,
        add(r_LE_E, map_bias),
        H_pose,
        H_mount,
        H_lens,
        H_map,
        d_point,
    )
    if math.isnan(u):
        return u, v
    for a in range(2):
        by_error_state(H_pose, a, H)
        for j in range(3):
            # errors of rate and velocity have moved the pose by the time of the exposure
            H[a, V + j] += t * H_pose[a, R + j]
            H[a, BIAS + j] -= t * H_pose[a, THETA + j]
            H[a, MOUNT + j] = H_mount[a, j]
            H[a, MAP + j] = H_map[a, j]
        H[a, CENTER], H[a, CENTER + 1] = H_lens[a, 2], H_lens[a, 3]
        H[a, K1] = H_lens[a, 5]
        H[a, TIME] = du if a == 0 else dv
    H[0, FOCAL], H[1, FOCAL] = u - lens[2], v - lens[3]
    return u, v


@compiled
def _whitened(params: Row, marks: Row, i: int, z: F64, H: F64, row: F64) -> bool:
    """Residual (2,) and derivatives (2, 26) of landmark ``i`` in units of its noise, as rows (2, 27); False: no noise.

    The noise is that of the match and the random error of the map.
    """
    scaled = params.noise_scale * params.noise_scale
    a, b, c = marks.P_px[i, 0, 0], marks.P_px[i, 0, 1], marks.P_px[i, 1, 1]
    if not math.isfinite(a + b + c):
        a = c = marks.sigma_px[i] * marks.sigma_px[i]
        b = 0.0
    a, b, c = scaled * a, scaled * b, scaled * c
    error = params.map_noise * params.map_noise
    for j in range(3):
        p, q = H[0, MAP + j], H[1, MAP + j]
        a, b, c = a + error * p * p, b + error * p * q, c + error * q * q
    # lower factor of the noise: (f, 0), (g, h)
    if not (a > 0.0 and a * c - b * b > 0.0 and math.isfinite(a + c)):
        return False
    f = math.sqrt(a)
    g = b / f
    h = math.sqrt(c - g * g)
    for j in range(SIZE):
        row[0, j] = H[0, j] / f
        row[1, j] = (H[1, j] - g * row[0, j]) / h
    row[0, SIZE] = z[0] / f
    row[1, SIZE] = (z[1] - g * row[0, SIZE]) / h
    return math.isfinite(row[0, SIZE] + row[1, SIZE])


@compiled
def linearize(
    x: F64, sigma: F64, params: Row, marks: Row, in_camera: Row, dcm_EN: M3, omega_EN_N: V3, rows: F64
) -> int:
    """Rows (2 x 1024, 27) of all landmarks at an estimate (34,); one that cannot be used has NaN in its residual.

    Returns:
        How many can be used. Columns of states that have no error (``sigma`` (26,)) are zero.
    """
    lens, H, z = np.empty(LENS_SIZE), np.empty((2, SIZE)), np.empty(2)
    scene = _scene(x, lens, params, in_camera, dcm_EN, omega_EN_N)
    middle = 0.5 * (in_camera.height_px - 1.0)
    bias = vec3(x[X_NUISANCE - CORE + MAP :])
    usable = 0
    for i in range(marks.count):
        after = params.row_time * (marks.pixel_px[i, 1] - middle)
        row = rows[2 * i : 2 * i + 2]
        row[0, SIZE] = math.nan
        if not math.isfinite(after):
            continue
        u, v = _pixel(scene, lens, params, bias, vec3(marks.r_LE_E[i]), after, H)
        if math.isnan(u):
            continue
        z[0], z[1] = marks.pixel_px[i, 0] - u, marks.pixel_px[i, 1] - v
        if not _whitened(params, marks, i, z, H, row):
            row[0, SIZE] = math.nan
            continue
        for j in range(CORE, SIZE):
            if sigma[j] == 0.0:
                row[0, j] = row[1, j] = 0.0
        usable += 1
    return usable


@compiled
def _square(rows: F64, i: int) -> float:
    """Squared length of the residual of landmark ``i``, in units of its noise."""
    return rows[2 * i, SIZE] ** 2 + rows[2 * i + 1, SIZE] ** 2


@compiled
def gate_one_by_one(P: F64, rows: F64, count: int, huber: float, gate: float, weight: F64) -> int:
    """First weights (1024,) of landmarks, from their innovation and its covariance; returns how many pass the gate."""
    S, L, white, PHt, unit = np.empty((2, 2)), np.empty((2, 2)), np.empty(2), np.empty((SIZE, 2)), np.eye(2)
    passed = 0
    for i in range(count):
        weight[i] = 0.0
        if math.isnan(rows[2 * i, SIZE]):
            continue
        innovation_covariance(P, rows[2 * i : 2 * i + 2, :SIZE], unit, PHt, S)
        code, nis = normalised_square(S, rows[2 * i : 2 * i + 2, SIZE], L, white)
        if code != OK or nis > gate:
            continue
        weight[i] = 1.0 if nis <= huber * huber else huber / math.sqrt(nis)
        passed += 1
    return passed


@compiled
def robust_weights(rows: F64, count: int, huber: float, gate: float, weight: F64) -> int:
    """Weights (1024,) from residuals, zero beyond the gate, for landmarks that had one; returns how many have one."""
    kept = 0
    for i in range(count):
        square = _square(rows, i)
        if weight[i] == 0.0 or math.isnan(square) or square > gate:
            weight[i] = 0.0
            continue
        weight[i] = 1.0 if square <= huber * huber else huber / math.sqrt(square)
        kept += 1
    return kept


@compiled
def largest_change(rows: F64, count: int, weight: F64, last: F64) -> float:
    """Largest change of the length of a residual that has a weight; ``last`` (n,) holds the lengths, old then new."""
    most = 0.0
    for i in range(count):
        if weight[i] > 0.0:
            length = math.sqrt(_square(rows, i))
            # a false landmark far away tells nothing
            most = max(most, math.fabs(length - last[i]) * min(1.0, weight[i]))
            last[i] = length
    return most


@compiled
def solve(
    P: F64, rows: F64, count: int, weight: F64, moved: F64, estimated: F64, H: F64, K: F64, dx: F64
) -> tuple[int, float]:
    """The correction of the estimate before the image, from rows taken at an estimate that is ``moved`` (26,) from it.

    Args:
        P: covariance before the image (26, 26).
        rows: of `linearize`.
        count: landmarks.
        weight: (1024,).
        moved: (26,).
        estimated: (26,) of `modes`.
        H: out (26, 26), the rows as few; their noise has covariance one.
        K: out (26, 26), gain.
        dx: out (26,).

    Returns:
        A code of `fsw.math.square_root`, and the normalised innovation squared of all rows.
    """
    used = 0
    for i in range(count):
        if weight[i] > 0.0:
            used += 2
    # more rows than columns, for the triangle; rows of zeros change nothing
    stack, triangle = np.zeros((max(used, SIZE + 2), SIZE + 1)), np.empty((SIZE + 1, SIZE + 1))
    at = 0
    for i in range(count):
        if weight[i] > 0.0:
            root = math.sqrt(weight[i])
            for a in range(2):
                total = rows[2 * i + a, SIZE]
                for j in range(SIZE):
                    total += rows[2 * i + a, j] * moved[j]
                    stack[at, j] = root * rows[2 * i + a, j]
                stack[at, SIZE] = root * total
                at += 1
    residual, white, unit = np.empty(SIZE), np.empty(SIZE), np.eye(SIZE)
    PHt, S, L = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    code = compress(stack, triangle, H, residual)
    if code != OK:
        return code, math.nan
    innovation_covariance(P, H, unit, PHt, S)
    code, nis = normalised_square(S, residual, L, white)
    if code == OK:
        code = gain(PHt, L, mask(estimated), K)
    if code != OK:
        return code, math.nan
    for i in range(SIZE):
        dx[i] = 0.0
        for a in range(SIZE):
            dx[i] += K[i, a] * residual[a]
    return OK, nis + triangle[SIZE, SIZE] ** 2
