"""Straight lines through intervals: what stamps that are cut off say of an even clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def line_within(earliest: F64, latest: F64, x: F64, slopes: F64) -> tuple[F64, F64] | None:
    """Mean and covariance of the lines a + b x that pass through all intervals, each as likely as another.

    Args:
        earliest, latest: (n,) intervals. x: (n,) where they stand. slopes: (m,) even grid of b.

    Returns:
        Mean (2,) and covariance (2, 2) of (a, b), or None if no line on the grid fits.
    """
    steps = x[None, :] * slopes[:, None]
    low, high = np.max(earliest - steps, axis=1), np.min(latest - steps, axis=1)
    width = np.maximum(high - low, 0.0)
    if not width.sum() > 0.0:
        return None
    weight = width / width.sum()
    middle = 0.5 * (low + high)
    mean = np.array([weight @ middle, weight @ slopes])
    da, db = middle - mean[0], slopes - mean[1]
    cov_ab = weight @ (da * db)
    var_a = weight @ (da * da + width * width / 12.0)
    return mean, np.array([[var_a, cov_ab], [cov_ab, weight @ (db * db)]])
