"""Resection: position and attitude of a calibrated camera from points of known position, by robust least squares.

Levenberg-Marquardt on six unknowns, with soft-L1 weights until it settles, then on the points within a few robust
standard deviations only (Triggs et al. 2000, "Bundle adjustment", sec. 3 and 4; Marquardt 1963 for the damping).
The attitude error theta is in camera components: dcm_CE_true = (I - [theta x]) dcm_CE.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import project_derivatives, undistort
from fsw.math.compiled import compiled

if TYPE_CHECKING:
    from messages.base import F64

SCALE = np.array([1000.0, 1000.0, 1000.0, 1.0, 1.0, 1.0])
"""Positions are solved for in km, so that the normal matrix is well scaled."""
MEDIAN_RAYLEIGH = math.sqrt(2.0 * math.log(2.0))
"""Median length of a two-dimensional residual whose coordinates have unit standard deviation."""
LINALG: Any = np.linalg
MIN_POINTS = 6
"""Fewest points of a fit: three fix a pose, but not whether it is right."""


class Resection(NamedTuple):
    """A fitted pose."""

    r_CE_E: F64
    """Position of the camera, Earth-fixed (3,) [m]."""
    dcm_CE: F64
    """Maps Earth-fixed to camera components (3, 3)."""
    inlier: NDArray[np.bool_]
    """(n,) points that counted."""
    residual_px: F64
    """(n, 2) seen minus predicted [px]; NaN for points that are not in front of the lens."""
    P_pose: F64
    """(6, 6) formal covariance [m, rad], scaled by the residuals; the points' errors are taken as independent."""
    scale: float
    """Residuals of the inliers to their sigma; 1 if the sigma is right."""


@compiled
def pose_derivatives(lens: F64, r_LE_E: F64, r_CE_E: F64, dcm_CE: F64, pixel: F64, slopes: F64) -> None:
    """Predicted pixels and their derivatives.

    Args:
        lens: lens vector of `fsw.math.camera` (11,).
        r_LE_E: points, Earth-fixed (n, 3) [m].
        r_CE_E: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: maps Earth-fixed to camera components (3, 3).
        pixel: out, (n, 2) [px]; NaN for points that are not in front of the lens.
        slopes: out, (n, 2, 6), by position [px/m, E] and attitude error [px/rad, C]; NaN likewise.
    """
    d_point, d_lens = np.empty((2, 3)), np.empty((2, 10))
    for i in range(r_LE_E.shape[0]):
        dx, dy, dz = r_LE_E[i, 0] - r_CE_E[0], r_LE_E[i, 1] - r_CE_E[1], r_LE_E[i, 2] - r_CE_E[2]
        x = dcm_CE[0, 0] * dx + dcm_CE[0, 1] * dy + dcm_CE[0, 2] * dz
        y = dcm_CE[1, 0] * dx + dcm_CE[1, 1] * dy + dcm_CE[1, 2] * dz
        z = dcm_CE[2, 0] * dx + dcm_CE[2, 1] * dy + dcm_CE[2, 2] * dz
        pixel[i, 0], pixel[i, 1] = project_derivatives(lens, x, y, z, d_point, d_lens)
        unknown = math.isnan(pixel[i, 0])
        for row in range(2):
            px, py, pz = d_point[row, 0], d_point[row, 1], d_point[row, 2]
            if unknown:
                px, py, pz = math.nan, math.nan, math.nan
            for k in range(3):
                slopes[i, row, k] = -(px * dcm_CE[0, k] + py * dcm_CE[1, k] + pz * dcm_CE[2, k])
            # d(r_LC_C) / d(theta) = [r_LC_C x]
            slopes[i, row, 3] = py * z - pz * y
            slopes[i, row, 4] = pz * x - px * z
            slopes[i, row, 5] = px * y - py * x


class _Problem:
    """The points, and the pose at which they were last predicted."""

    def __init__(self, lens: F64, r_LE_E: F64, pixel_px: F64, sigma_px: F64) -> None:
        self.lens, self.r_LE_E = lens, np.ascontiguousarray(r_LE_E, float)
        self.pixel, self.sigma = pixel_px, sigma_px[:, None]

    def at(self, r_CE_E: F64, dcm_CE: F64) -> tuple[F64, F64]:
        """Residuals over sigma (n, 2) and derivatives of the prediction over sigma (n, 2, 6), scaled."""
        n = len(self.r_LE_E)
        predicted, slopes = np.empty((n, 2)), np.empty((n, 2, 6))
        pose_derivatives(self.lens, self.r_LE_E, r_CE_E, dcm_CE, predicted, slopes)
        return (self.pixel - predicted) / self.sigma, slopes * (SCALE / self.sigma[:, :, None])


def turned(dcm_CE: F64, theta: F64) -> F64:
    """``dcm_CE`` (3, 3) after the camera turned by the rotation vector ``theta`` (3,) [rad, C]."""
    angle = float(np.linalg.norm(theta))
    x, y, z = theta
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sinc = math.sin(angle) / angle if angle > 1e-9 else 1.0
    cosc = 0.5 * (math.sin(0.5 * angle) / (0.5 * angle)) ** 2 if angle > 1e-9 else 0.5
    return (np.eye(3) - sinc * cross + cosc * cross @ cross) @ dcm_CE


def _length(error: F64) -> tuple[F64, float]:
    """Length of each residual (infinite where unknown), and their robust standard deviation."""
    length = np.hypot(error[:, 0], error[:, 1])
    length[~np.isfinite(length)] = np.inf
    return length, float(np.median(length)) / MEDIAN_RAYLEIGH


def _normal(weight: F64, slopes: F64) -> F64:
    # einsum and not BLAS: the sum's order must not depend on the number of threads
    return np.einsum("n,nka,nkb->ab", weight, slopes, slopes)


def _cost(weight: F64, error: F64) -> float:
    return float(np.einsum("n,nk,nk->", weight, error, error))


def _descend(problem: _Problem, pose: tuple[F64, F64], weight: F64, rounds: int) -> tuple[F64, F64] | None:
    """Levenberg-Marquardt with fixed weights; None if the points do not fix a pose."""
    error, slopes = problem.at(*pose)
    use = weight > 0.0
    if not np.isfinite(error[use]).all():
        return None
    weight = weight[use]
    error, slopes = error[use], slopes[use]
    cost, damping = _cost(weight, error), 1e-6
    for _ in range(rounds):
        normal, right = _normal(weight, slopes), np.einsum("n,nka,nk->a", weight, slopes, error)
        diagonal = np.diag(np.diag(normal))
        while True:
            try:
                step: F64 = LINALG.solve(normal + damping * diagonal, right)
            except LINALG.LinAlgError:
                return None
            trial = pose[0] + SCALE[:3] * step[:3], turned(pose[1], step[3:])
            new_error, new_slopes = problem.at(*trial)
            new_error, new_slopes = new_error[use], new_slopes[use]
            new = _cost(weight, new_error)
            if new <= cost:  # false when a point went behind the camera (NaN)
                break
            damping *= 10.0
            if damping > 1e6:
                return pose
        done = cost - new <= 1e-12 * cost
        pose, cost, error, slopes, damping = trial, new, new_error, new_slopes, damping * 0.1
        if done:
            break
    return pose


def _soft(problem: _Problem, pose: tuple[F64, F64]) -> tuple[F64, F64] | None:
    """Fit with soft-L1 weights, the scale from the median."""
    length, scale = _length(problem.at(*pose)[0])
    for _ in range(30):
        if not math.isfinite(scale):
            return None
        weight = np.where(np.isfinite(length), 1.0 / np.sqrt(1.0 + (length / max(scale, 1e-9)) ** 2), 0.0)
        moved = _descend(problem, pose, weight, 2)
        if moved is None:
            return None
        pose, before = moved, scale
        length, scale = _length(problem.at(*pose)[0])
        if abs(before - scale) <= 1e-4 * scale:
            break
    return pose


def fit_pose(
    lens: F64, r_LE_E: F64, pixel_px: F64, sigma_px: F64, r_CE_E: F64, dcm_CE: F64, reject: float = 3.0
) -> Resection | None:
    """Fit a pose to points, robustly. Nothing holds it to the start.

    Args:
        lens: lens vector of `fsw.math.camera` (11,).
        r_LE_E: points, Earth-fixed (n, 3) [m].
        pixel_px: where they were seen (n, 2) [px].
        sigma_px: standard deviation of each coordinate (n,) [px].
        r_CE_E: start: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: start: maps Earth-fixed to camera components (3, 3).
        reject: points farther off than this many robust standard deviations do not count.

    Returns:
        The pose, or None if there are too few points, most are not in front of the lens, or they do not fix a pose.
    """
    if len(r_LE_E) < MIN_POINTS:
        return None
    problem = _Problem(lens, r_LE_E, pixel_px, sigma_px)
    pose = _soft(problem, (np.array(r_CE_E, float), np.array(dcm_CE, float)))
    if pose is None:
        return None
    inlier = np.zeros(len(r_LE_E), np.bool_)
    for _ in range(10):
        length, scale = _length(problem.at(*pose)[0])
        keep = length <= reject * max(scale, 1e-9)
        if keep.sum() < MIN_POINTS:
            return None
        if (keep == inlier).all():
            break
        inlier = keep
        moved = _descend(problem, pose, inlier.astype(float), 20)
        if moved is None:
            return None
        pose = moved
    return _result(problem, pose, inlier)


def _result(problem: _Problem, pose: tuple[F64, F64], inlier: NDArray[np.bool_]) -> Resection | None:
    error, slopes = problem.at(*pose)
    weight = np.ones(int(inlier.sum()))
    normal = _normal(weight, slopes[inlier])
    if np.linalg.cond(normal / np.sqrt(np.outer(np.diag(normal), np.diag(normal)))) > 1e10:
        return None
    scale2 = _cost(weight, error[inlier]) / max(2 * len(weight) - 6, 1)
    formal = scale2 * np.linalg.inv(normal) * np.outer(SCALE, SCALE)
    return Resection(*pose, inlier, error * problem.sigma, 0.5 * (formal + formal.T), math.sqrt(scale2))


def attitude_from_rays(lens: F64, r_LE_E: F64, pixel_px: F64, r_CE_E: F64) -> F64:
    """The attitude at which a camera of known position sees points where they were seen, by least squares on unit rays.

    Wahba's problem by singular values (Markley 1988). No start is needed, so any attitude is found.

    Args:
        lens: lens vector (11,).
        r_LE_E: points, Earth-fixed (n, 3) [m], n of 2 or more.
        pixel_px: where they were seen (n, 2) [px]; those beyond the lens's range do not count.
        r_CE_E: position of the camera, Earth-fixed (3,) [m].

    Returns:
        dcm_CE (3, 3).
    """
    tangents = np.empty((len(pixel_px), 2))
    undistort(lens, np.ascontiguousarray(pixel_px, float), tangents)
    known = np.isfinite(tangents[:, 0])
    seen = np.column_stack([tangents[known], np.ones(int(known.sum()))])
    ground = r_LE_E[known] - r_CE_E
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    ground /= np.linalg.norm(ground, axis=1)[:, None]
    u, _, vt = np.linalg.svd(np.einsum("ni,nj->ij", seen, ground))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt


def shared_covariance(lens: F64, r_LE_E: F64, sigma_px: F64, group: NDArray[np.int64], r_CE_E: F64, dcm_CE: F64) -> F64:
    """Covariance of a fitted pose, if all points of a group err together by one pixel, and groups independently.

    Neighbouring landmarks share errors of map and heights, so they do not average out. With N the normal matrix and
    G_c the sum of weight times derivative over group c, it is N^-1 (sum of G_c' G_c) N^-1 (Huber 1967; the clustered
    form of Liang and Zeger 1986).

    Args:
        lens: lens vector (11,).
        r_LE_E: points of the fit, Earth-fixed (n, 3) [m].
        sigma_px: their standard deviations (n,) [px], as in the fit.
        group: number of the group of each point (n,).
        r_CE_E: fitted position (3,) [m].
        dcm_CE: fitted attitude (3, 3).

    Returns:
        (6, 6) [m, rad] for one pixel; it grows with the square of the error.
    """
    n = len(r_LE_E)
    predicted, slopes = np.empty((n, 2)), np.empty((n, 2, 6))
    pose_derivatives(lens, np.ascontiguousarray(r_LE_E, float), r_CE_E, dcm_CE, predicted, slopes)
    slopes *= SCALE
    weight = sigma_px**-2.0
    inverse: F64 = LINALG.inv(_normal(weight, slopes))
    sums = np.zeros((int(group.max()) + 1, 2, 6))
    np.add.at(sums, group, weight[:, None, None] * slopes)
    middle = np.einsum("cka,ckb->ab", sums, sums)
    return np.einsum("ab,bc,cd->ad", inverse, middle, inverse) * np.outer(SCALE, SCALE)
