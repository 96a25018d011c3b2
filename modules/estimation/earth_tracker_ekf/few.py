"""Small pieces of rows: dividing by a standard deviation, and few rows instead of many."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.extended import compress
from fsw.math.square_root import OK
from messages.base import F64
from modules.estimation.earth_tracker_ekf import status
from modules.estimation.pose_models.pose import SIZE, THETA, R

Found: TypeAlias = tuple[int, int]
"""Status and number of rows."""


@compiled
def divide(H: F64, residual: F64, row: int, sigma: float) -> None:
    """A row of H (m, 12) and its residual in units of its standard deviation."""
    residual[row] /= sigma
    for j in range(SIZE):
        H[row, j] /= sigma


@compiled
def put_compressed(rows: F64, H: F64, residual: F64) -> Found:
    """Rows (m, 7) by position and attitude, the residual last, as at most six rows of H (12, 12), residual (12,)."""
    m, few = rows.shape[0], np.zeros((6, 6))
    left = np.zeros(6)
    if m > 6:
        if compress(rows, np.empty((7, 7)), few, left) != OK:
            return status.BAD_NUMBERS, 0
        m = 6
    else:
        for i in range(m):
            left[i] = rows[i, 6]
            for j in range(6):
                few[i, j] = rows[i, j]
    n = 0
    for i in range(m):
        size = 0.0
        for j in range(6):
            size += abs(few[i, j])
        if size == 0.0:  # a direction that no row sees
            continue
        for j in range(SIZE):
            H[n, j] = 0.0
        for j in range(3):
            H[n, R + j], H[n, THETA + j] = few[i, j], few[i, 3 + j]
        residual[n] = left[i]
        n += 1
    return status.UPDATED, n
