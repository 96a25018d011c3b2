"""Where the parts of estimate and error state are, and which states are estimated.

The estimate is an array x (34,), the error state has 26 numbers: position, velocity (N), attitude (B), bias of the gyro
(P), and the nuisance states. A true value is the estimated one plus the error, but for the two rotations: the true
attitude is (I - [theta x]) dcm_BN, the true mounting (I - [mu x]) dcm_CB.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.module import Row
from messages.base import F64
from messages.filters import POSE_STATES
from modules.estimation.pose_models.pose import SIZE as POSE_SIZE

SIZE = POSE_STATES
"""Numbers of the error state."""
R, V, THETA, BIAS = 0, 3, 6, 9
CORE = POSE_SIZE
MOUNT, FOCAL, CENTER, K1, GPS, MAP, TIME = 12, 15, 16, 18, 19, 22, 25
"""First columns of the nuisance states: turn of the camera (C), relative focal length, principal point, k1, bias of the
navigation receiver (E), error that all places on the map share (E), exposure after its stamp."""
X_R, X_V, X_BETA, X_BIAS, X_NUISANCE = 0, 3, 6, 10, 13
"""Places in the estimate; nuisance states are in the order of the error state."""
X_READING = 27
"""Angular rate that the gyro has read last, or that is held in its place (B)."""
X_HELD = 30
"""1 while the rate is held because the gyro is silent."""
X_HEARD = 31
"""1 once the gyro has given a reading."""
X_USED, X_REFUSED = 32, 33
"""Measurements used and refused."""
ESTIMATE = 34
OFF, CONSIDER, ESTIMATED = 0, 1, 2
"""Modes of a nuisance state: no error, known with an error that stays, estimated."""


@compiled
def _group(estimated: F64, sigma: F64, first: int, size: int, mode: int, value: float) -> None:
    for i in range(first, first + size):
        estimated[i] = 1.0 if mode == ESTIMATED else 0.0
        sigma[i] = value if mode != OFF else 0.0


@compiled
def modes(params: Row, estimated: F64, sigma: F64) -> None:
    """Which states are estimated, (26,) 1 or 0, and the first standard deviations of the nuisance states (26,)."""
    for i in range(CORE):
        estimated[i], sigma[i] = 1.0, 0.0
    _group(estimated, sigma, MOUNT, 3, params.mount_mode, params.mount_sigma)
    _group(estimated, sigma, FOCAL, 1, params.focal_mode, params.focal_sigma)
    _group(estimated, sigma, CENTER, 1, params.center_mode, params.center_sigma[0])
    _group(estimated, sigma, CENTER + 1, 1, params.center_mode, params.center_sigma[1])
    _group(estimated, sigma, K1, 1, params.k1_mode, params.k1_sigma)
    _group(estimated, sigma, GPS, 3, params.gps_mode, params.gps_bias_sigma)
    for i in range(3):
        _group(estimated, sigma, MAP + i, 1, params.map_mode, math.sqrt(params.map_bias_P[i, i]))
    _group(estimated, sigma, TIME, 1, params.time_mode, params.time_sigma)


@compiled
def mask(estimated: F64) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """The flags (26,) as booleans."""
    chosen = np.empty(SIZE, np.bool_)
    for i in range(SIZE):
        chosen[i] = estimated[i] > 0.5
    return chosen


@compiled
def copy_estimate(x: F64, P: F64, x_out: F64, P_out: F64) -> None:
    """Copy an estimate (34,) and its covariance (26, 26)."""
    for i in range(ESTIMATE):
        x_out[i] = x[i]
    for i in range(SIZE):
        for j in range(SIZE):
            P_out[i, j] = P[i, j]
