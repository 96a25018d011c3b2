"""Which matches agree with each other, and how good each is."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import undistort
from messages.base import F64

SIGMA_AT_ZERO = 1.0
SIGMA_PER_SCORE = -0.7
"""Standard deviation of a match [px] against its score: a line through the residuals of the ten shipped photos."""
CV: Any = cv2


def undistorted_px(lens: F64, pixel: F64) -> F64:
    """Pixels (n, 2) as an ideal camera of the same focal length would see them; NaN beyond the lens's range."""
    out = np.empty((len(pixel), 2))
    undistort(lens, np.ascontiguousarray(pixel, float), out)
    return out * lens[:2]


def homography_consensus(a_px: F64, b_px: F64, threshold_px: float) -> NDArray[np.bool_]:
    """Which pairs of ideal pixels (n, 2) agree on one homography, by MAGSAC++ (Barath et al. 2020), always the same.

    Two views of the ground from nearly one place differ by a homography, but for relief. (In the map's own plane it
    would be wrong: over a wide field the Earth's curvature shows.)
    """
    none = np.zeros(len(a_px), np.bool_)
    known = np.isfinite(a_px).all(axis=1) & np.isfinite(b_px).all(axis=1)
    if known.sum() < 8:
        return none
    CV.setRNGSeed(1)
    found, inlier = CV.findHomography(
        a_px[known], b_px[known], cv2.USAC_MAGSAC, threshold_px, maxIters=10000, confidence=0.9999
    )
    if found is None:
        return none
    none[np.flatnonzero(known)[inlier.ravel() > 0]] = True
    return none


def sigma_of(score: F64) -> F64:
    """Standard deviation of each coordinate of a match [px], from its score."""
    return np.maximum(SIGMA_AT_ZERO + SIGMA_PER_SCORE * score, 0.2)
