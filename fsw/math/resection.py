"""Resection: position and attitude of a calibrated camera from points of known position, by robust least squares.

Levenberg-Marquardt on six unknowns, with soft-L1 weights until it settles, then on the points within a few robust
standard deviations only (Huber and Ronchetti 2009, sec. 7; Triggs et al. 2000, "Bundle adjustment").
The attitude error theta is in camera components: dcm_CE_true = (I - [theta x]) dcm_CE.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import project_derivatives, project_point
from fsw.math.compiled import compiled

if TYPE_CHECKING:
    from messages.base import F64

SCALE = 1000.0
"""Positions are solved for in km, so that the normal matrix is well scaled."""
MEDIAN_RAYLEIGH = math.sqrt(2.0 * math.log(2.0))
"""Median length of a two-dimensional residual whose coordinates have unit standard deviation."""
MIN_POINTS = 6


@compiled
def residuals(lens: F64, r_LE_E: F64, pixel: F64, sigma: F64, r_CE_E: F64, dcm_CE: F64, out: F64) -> None:
    """Seen minus predicted pixel over sigma, into ``out`` (n, 2); NaN where a point is not in front of the lens."""
    c = np.empty(3)
    for i in range(r_LE_E.shape[0]):
        _to_camera(r_LE_E, i, r_CE_E, dcm_CE, c)
        u, v = project_point(lens, c[0], c[1], c[2])
        out[i, 0] = (pixel[i, 0] - u) / sigma[i]
        out[i, 1] = (pixel[i, 1] - v) / sigma[i]


@compiled
def _to_camera(r_LE_E: F64, i: int, r_CE_E: F64, dcm_CE: F64, out: F64) -> None:
    """Point i in camera components, into ``out`` (3,)."""
    dx, dy, dz = r_LE_E[i, 0] - r_CE_E[0], r_LE_E[i, 1] - r_CE_E[1], r_LE_E[i, 2] - r_CE_E[2]
    for k in range(3):
        out[k] = dcm_CE[k, 0] * dx + dcm_CE[k, 1] * dy + dcm_CE[k, 2] * dz


@compiled
def pose_derivatives(lens: F64, r_LE_E: F64, i: int, r_CE_E: F64, dcm_CE: F64, jac: F64) -> tuple[float, float]:
    """Predicted pixel of point i, and its derivatives by position [km, E] and attitude error [rad, C] in ``jac`` (2, 6)."""
    c, d_point, d_lens = np.empty(3), np.empty((2, 3)), np.empty((2, 10))
    _to_camera(r_LE_E, i, r_CE_E, dcm_CE, c)
    u, v = project_derivatives(lens, c[0], c[1], c[2], d_point, d_lens)
    for row in range(2):
        px, py, pz = d_point[row, 0], d_point[row, 1], d_point[row, 2]
        for k in range(3):
            jac[row, k] = -SCALE * (px * dcm_CE[0, k] + py * dcm_CE[1, k] + pz * dcm_CE[2, k])
        # d(r_C)/d(theta) = [r_C x]
        jac[row, 3] = py * c[2] - pz * c[1]
        jac[row, 4] = pz * c[0] - px * c[2]
        jac[row, 5] = px * c[1] - py * c[0]
    return u, v


@compiled
def _normal_equations(
    lens: F64, r_LE_E: F64, pixel: F64, sigma: F64, weight: F64, r_CE_E: F64, dcm_CE: F64, normal: F64, right: F64
) -> None:
    """Weighted normal matrix (6, 6) and right-hand side (6,), into ``normal`` and ``right``."""
    jac = np.empty((2, 6))
    normal[:, :] = 0.0
    right[:] = 0.0
    for i in range(r_LE_E.shape[0]):
        if weight[i] == 0.0:
            continue
        u, v = pose_derivatives(lens, r_LE_E, i, r_CE_E, dcm_CE, jac)
        if not (u - u == 0.0 and v - v == 0.0):
            continue
        w = weight[i] / (sigma[i] * sigma[i])
        du, dv = pixel[i, 0] - u, pixel[i, 1] - v
        for a in range(6):
            right[a] += w * (jac[0, a] * du + jac[1, a] * dv)
            for b in range(a + 1):
                normal[a, b] += w * (jac[0, a] * jac[0, b] + jac[1, a] * jac[1, b])
    for a in range(6):
        for b in range(a):
            normal[b, a] = normal[a, b]


@compiled
def cholesky_solve(matrix: F64, right: F64, out: F64) -> bool:
    """Solve a symmetric positive definite system (n, n) for several right-hand sides (n, m), into ``out`` (n, m).

    Returns:
        False, with ``out`` undefined, if the matrix is not positive definite.
    """
    n, m = right.shape
    low = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            if i == j:
                if not total > 1e-13 * matrix[i, i]:
                    return False
                low[i, i] = math.sqrt(total)
            else:
                low[i, j] = total / low[j, j]
    for column in range(m):
        for i in range(n):
            total = right[i, column]
            for k in range(i):
                total -= low[i, k] * out[k, column]
            out[i, column] = total / low[i, i]
        for i in range(n - 1, -1, -1):
            total = out[i, column]
            for k in range(i + 1, n):
                total -= low[k, i] * out[k, column]
            out[i, column] = total / low[i, i]
    return True


@compiled
def _moved(r_CE_E: F64, dcm_CE: F64, step: F64, r_new: F64, dcm_new: F64) -> None:
    """Pose after a step (6, 1): position in km, attitude error in rad; exact rotation, so the matrix stays orthogonal."""
    for k in range(3):
        r_new[k] = r_CE_E[k] + SCALE * step[k, 0]
    x, y, z = step[3, 0], step[4, 0], step[5, 0]
    angle2 = x * x + y * y + z * z
    angle = math.sqrt(angle2)
    sinc = math.sin(angle) / angle if angle > 1e-9 else 1.0
    cosc = (1.0 - math.cos(angle)) / angle2 if angle > 1e-4 else 0.5
    for k in range(3):
        a, b, c = dcm_CE[0, k], dcm_CE[1, k], dcm_CE[2, k]
        # exp(-[theta x]) v = v - sin/angle theta x v + (1 - cos)/angle^2 theta x (theta x v)
        ca, cb, cc = y * c - z * b, z * a - x * c, x * b - y * a
        dcm_new[0, k] = a - sinc * ca + cosc * (y * cc - z * cb)
        dcm_new[1, k] = b - sinc * cb + cosc * (z * ca - x * cc)
        dcm_new[2, k] = c - sinc * cc + cosc * (x * cb - y * ca)


@compiled
def _cost(weight: F64, error: F64) -> float:
    total = 0.0
    for i in range(weight.shape[0]):
        if weight[i] > 0.0:
            total += weight[i] * (error[i, 0] ** 2 + error[i, 1] ** 2)
    return total


@compiled
def _descend(
    lens: F64, r_LE_E: F64, pixel: F64, sigma: F64, weight: F64, r_CE_E: F64, dcm_CE: F64, error: F64, rounds: int
) -> bool:
    """Levenberg-Marquardt with fixed weights, in place on the pose and ``error``; False if the points do not fix it."""
    normal, right, step = np.empty((6, 6)), np.empty((6, 1)), np.empty((6, 1))
    damped, r_new, dcm_new, trial = np.empty((6, 6)), np.empty(3), np.empty((3, 3)), np.empty_like(error)
    damping, cost = 1e-6, _cost(weight, error)
    for _ in range(rounds):
        _normal_equations(lens, r_LE_E, pixel, sigma, weight, r_CE_E, dcm_CE, normal, right[:, 0])
        better = False
        while not better and damping < 1e6:
            damped[:, :] = normal
            for k in range(6):
                damped[k, k] *= 1.0 + damping
            if not cholesky_solve(damped, right, step):
                return False
            _moved(r_CE_E, dcm_CE, step, r_new, dcm_new)
            residuals(lens, r_LE_E, pixel, sigma, r_new, dcm_new, trial)
            new = _cost(weight, trial)
            better = new <= cost  # false when a weighted point went behind the camera (NaN)
            damping = damping * 0.1 if better else damping * 10.0
        if not better:
            break
        r_CE_E[:], dcm_CE[:, :], error[:, :] = r_new, dcm_new, trial
        done = cost - new <= 1e-12 * cost
        cost = new
        if done:
            break
    return True


@compiled
def _lengths(error: F64, out: F64) -> float:
    """Length of each residual into ``out`` (infinite where unknown); returns the robust standard deviation."""
    for i in range(error.shape[0]):
        e = math.sqrt(error[i, 0] ** 2 + error[i, 1] ** 2)
        out[i] = e if e - e == 0.0 else math.inf
    return float(np.median(out)) / MEDIAN_RAYLEIGH


@compiled
def fit_pose(
    lens: F64,
    r_LE_E: F64,
    pixel: F64,
    sigma: F64,
    r_CE_E: F64,
    dcm_CE: F64,
    reject: float,
    inlier: NDArray[np.bool_],
    P_pose: F64,
) -> float:
    """Fit a pose to points, robustly.

    Args:
        lens: lens vector of `fsw.math.camera` (11,).
        r_LE_E: points, Earth-fixed (n, 3) [m].
        pixel: where they were seen (n, 2) [px].
        sigma: standard deviation of each coordinate (n,) [px].
        r_CE_E: start, and out: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: start, and out: maps E to C components (3, 3).
        reject: points farther off than this many robust standard deviations do not count.
        inlier: out, (n,): the points that count.
        P_pose: out, (6, 6): formal covariance [m, rad], with the residuals' own scale; errors taken as independent.

    Returns:
        Scale of the residuals: 1 if they are as ``sigma`` says. NaN if there is no solution; the pose is then undefined.
    """
    n = r_LE_E.shape[0]
    inlier[:] = False
    if n < MIN_POINTS:
        return math.nan
    error, length, weight = np.empty((n, 2)), np.empty(n), np.empty(n)
    residuals(lens, r_LE_E, pixel, sigma, r_CE_E, dcm_CE, error)
    scale = _lengths(error, length)
    for _ in range(30):
        if not scale < math.inf:
            return math.nan
        for i in range(n):
            ratio = length[i] / max(scale, 1e-9)
            weight[i] = 0.0 if length[i] == math.inf else 1.0 / math.sqrt(1.0 + ratio * ratio)
        if not _descend(lens, r_LE_E, pixel, sigma, weight, r_CE_E, dcm_CE, error, 2):
            return math.nan
        before, scale = scale, _lengths(error, length)
        if math.fabs(before - scale) <= 1e-5 * scale:
            break
    for _ in range(10):
        count, changed = 0, False
        limit = reject * max(scale, 1e-9)
        for i in range(n):
            keep = length[i] <= limit
            changed = changed or keep != inlier[i]
            inlier[i] = keep
            weight[i] = 1.0 if keep else 0.0
            count += keep
        if count < MIN_POINTS:
            return math.nan
        if not changed:
            break
        if not _descend(lens, r_LE_E, pixel, sigma, weight, r_CE_E, dcm_CE, error, 20):
            return math.nan
        scale = _lengths(error, length)
    return _formal(lens, r_LE_E, pixel, sigma, weight, r_CE_E, dcm_CE, error, P_pose)


@compiled
def _formal(
    lens: F64, r_LE_E: F64, pixel: F64, sigma: F64, weight: F64, r_CE_E: F64, dcm_CE: F64, error: F64, P_pose: F64
) -> float:
    """Covariance at the solution, into ``P_pose``; returns the scale of the residuals."""
    normal, right, one = np.empty((6, 6)), np.empty(6), np.zeros((6, 6))
    for k in range(6):
        one[k, k] = 1.0
    _normal_equations(lens, r_LE_E, pixel, sigma, weight, r_CE_E, dcm_CE, normal, right)
    if not cholesky_solve(normal, one, P_pose):
        return math.nan
    scale2 = _cost(weight, error) / max(2.0 * weight.sum() - 6.0, 1.0)
    for a in range(6):
        for b in range(6):
            P_pose[a, b] *= scale2 * (SCALE if a < 3 else 1.0) * (SCALE if b < 3 else 1.0)
    return math.sqrt(scale2)
