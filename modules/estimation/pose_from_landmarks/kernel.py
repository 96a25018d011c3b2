"""The checks of a fix, and its distance from the prior."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fsw.math.geodesy import geodetic_from_ecef
from messages.base import F64
from modules.estimation.pose_from_landmarks.status import FixStatus
from modules.estimation.rotations import rotation_vector

LINALG: Any = np.linalg


class Limits(NamedTuple):
    """The limits of the checks: the parameters of the same names."""

    min_inliers: int
    min_share: float
    min_cells: int
    max_rms_px: float
    min_altitude: float
    max_altitude: float
    max_sigma: float
    prior_gate_sigma: float


class Quality(NamedTuple):
    """What is known of a fix that says whether it is true."""

    inliers: int
    candidates: int
    cells: int
    rms_px: float
    altitude: float
    """[m]"""
    sigma: float
    """Largest standard deviation of the position in any direction [m]."""
    distance: float
    """From the prior, in standard deviations of the difference."""


def prior_distance(r_CE_E: F64, dcm_CE: F64, P_pose: F64, r_prior: F64, dcm_prior: F64, P_prior: F64) -> float:
    """Mahalanobis distance of two independent poses.

    Args:
        r_CE_E: position of the camera (3,) [m].
        dcm_CE: attitude (3, 3).
        P_pose: covariance (6, 6) of position [m] and attitude error in C [rad].
        r_prior: position of the prior (3,) [m].
        dcm_prior: attitude of the prior (3, 3).
        P_prior: covariance of the prior (6, 6).

    Returns:
        sqrt(d' (P + P_prior)^-1 d), d the difference of position and the rotation vector from prior to fix.
    """
    # r_fix - r_prior and theta with dcm_CE = exp(-[theta x]) dcm_prior
    difference = np.concatenate([r_CE_E - r_prior, rotation_vector(dcm_CE @ dcm_prior.T)])
    scale = np.sqrt(np.diag(P_pose + P_prior))
    total = (P_pose + P_prior) / np.outer(scale, scale)
    scaled = difference / scale
    return math.sqrt(max(0.0, float(scaled @ LINALG.solve(total, scaled))))


def height_of(r_CE_E: F64) -> float:
    """Height above the ellipsoid [m] of an Earth-fixed position (3,) [m]."""
    x, y, z = (float(c) for c in r_CE_E)
    return geodetic_from_ecef(x, y, z)[2]


def largest_sigma(P: F64) -> float:
    """Standard deviation in the direction in which a covariance (n, n) is largest."""
    eigenvalues: F64 = LINALG.eigvalsh(P)
    return math.sqrt(float(eigenvalues[-1]))


def rms_length(vectors: F64) -> float:
    """Root mean square length of vectors (n, m)."""
    return math.sqrt(float(np.square(vectors).sum()) / len(vectors))


def check(quality: Quality, limits: Limits) -> FixStatus:
    """The first check that a fix fails, or VALID."""
    q = quality
    failed = (
        (q.inliers < limits.min_inliers, FixStatus.FEW_INLIERS),
        (q.inliers < limits.min_share * q.candidates, FixStatus.LOW_SHARE),
        (q.cells < limits.min_cells, FixStatus.BADLY_SPREAD),
        (not q.rms_px <= limits.max_rms_px, FixStatus.LARGE_RESIDUALS),
        (not limits.min_altitude <= q.altitude <= limits.max_altitude, FixStatus.ALTITUDE),
        (not q.sigma <= limits.max_sigma, FixStatus.WEAK),
        (limits.prior_gate_sigma > 0.0 and not q.distance <= limits.prior_gate_sigma, FixStatus.AGAINST_PRIOR),
    )
    return next((status for bad, status in failed if bad), FixStatus.VALID)
