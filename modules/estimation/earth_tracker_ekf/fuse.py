"""The three forms of an update by several sensors: one after the other, all at once, and local filters with a master.

For linear measurements with independent noise, linearised at the same estimate, the three give the same. They differ
where theory says so: the sequential form linearises each sensor at the estimate that those before it have corrected;
gates of local filters are wider, because their covariance is larger by their share of the information.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.extended import compress, innovation_covariance, kalman_update, normalised_square
from fsw.math.square_root import NOT_FINITE, OK, cholesky, invert_lower
from fsw.math.unscented import GATED
from messages.base import F64, I64
from modules.estimation.earth_tracker_ekf import status
from modules.estimation.pose_models.pose import SIZE

GATES = np.array([0.0, 15.137, 18.421, 21.108, 23.513, 25.745, 27.856, 29.878, 31.828, 33.720, 35.564, 37.367, 39.134])
"""Normalised squares of 0 to 12 numbers that one in 10,000 good measurements exceeds."""


@compiled
def gate_of(m: int, factor: float) -> float:
    """Largest normalised square of m numbers; none for a factor of 0."""
    return factor * GATES[m] if factor > 0.0 else math.inf


@compiled
def outcome(code: int) -> int:
    """Status for a code of `kalman_update`."""
    if code == OK:
        return status.UPDATED
    return status.GATED if code == GATED else status.FAILED_UPDATE


@compiled
def white_update(P: F64, H: F64, residual: F64, m: int, gate: float, dx: F64) -> tuple[int, float]:
    """`kalman_update` by m white rows of H (12, 12)."""
    return kalman_update(P, H[:m], np.eye(m), residual[:m], gate, np.ones(SIZE, np.bool_), dx)


@compiled
def batch(P: F64, H: F64, residual: F64, m: I64, factor: float, what: I64, nis: F64, dx: F64) -> int:
    """All sensors at once.

    Args:
        P: covariance (12, 12), updated.
        H: white rows (7, 12, 12) of each sensor.
        residual: (7, 12).
        m: (7,) how many rows; 0 for a sensor that says nothing.
        factor: of the gate of each sensor, which is judged by what was known before.
        what: out (7,), status of those that say something.
        nis: out (7,).
        dx: out (12,).

    Returns:
        `OK` or why there is no result.
    """
    total = 0
    for s in range(m.shape[0]):
        total += m[s]
    rows, n = np.empty((total, SIZE + 1)), 0
    for s in range(m.shape[0]):
        k = m[s]
        if k == 0:
            continue
        PHt, S, L, white = np.empty((SIZE, k)), np.empty((k, k)), np.empty((k, k)), np.empty(k)
        innovation_covariance(P, H[s, :k], np.eye(k), PHt, S)
        code, nis[s] = normalised_square(S, residual[s, :k], L, white)
        what[s] = status.UPDATED if code == OK else status.FAILED_UPDATE
        if code == OK and nis[s] > gate_of(k, factor):
            what[s] = status.GATED
        if what[s] != status.UPDATED:
            continue
        for i in range(k):
            for j in range(SIZE):
                rows[n, j] = H[s, i, j]
            rows[n, SIZE] = residual[s, i]
            n += 1
    few, left = np.zeros((SIZE, SIZE)), np.zeros(SIZE)
    if n > SIZE:
        code = compress(rows[:n], np.empty((SIZE + 1, SIZE + 1)), few, left)
        if code != OK:
            return code
        n = SIZE
    else:
        for i in range(n):
            left[i] = rows[i, SIZE]
            for j in range(SIZE):
                few[i, j] = rows[i, j]
    for i in range(SIZE):
        dx[i] = 0.0
    if n == 0:
        return OK
    code, _ = white_update(P, few, left, n, math.inf, dx)
    return code


@compiled
def information_of(P: F64, d: F64, Y: F64) -> int:
    """Y = (P / d d')^-1, all (12, 12), d (12,)."""
    part, L, back = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    for i in range(SIZE):
        for j in range(SIZE):
            part[i, j] = P[i, j] / (d[i] * d[j])
    code = cholesky(part, L)
    if code == OK:
        code = invert_lower(L, back)
    if code != OK:
        return code
    for i in range(SIZE):
        for j in range(i + 1):
            value = 0.0
            for k in range(i, SIZE):
                value += back[k, i] * back[k, j]
            Y[i, j] = Y[j, i] = value
    return OK


@compiled
def federated(P: F64, H: F64, residual: F64, m: I64, factor: float, shares: F64, what: I64, nis: F64, dx: F64) -> int:
    """A local filter for each sensor, and a master that fuses them and hands its result back (fusion with reset).

    Each local filter holds the common estimate with the covariance P / share (and so, all the time, process noise
    Q / share); shares are divided by their sum. It is updated by its own sensor. The master adds their information.

    Args:
        P, H, residual, m, factor, what, nis, dx: as in `batch`.
        shares: (7,) of the information, in any unit.

    Returns:
        `OK` or why there is no result; P is then unchanged.
    """
    d, Y, y, own = np.empty(SIZE), np.zeros((SIZE, SIZE)), np.zeros(SIZE), np.empty((SIZE, SIZE))
    local, step = np.empty((SIZE, SIZE)), np.empty(SIZE)
    for i in range(SIZE):
        d[i] = math.sqrt(P[i, i])
    whole = 0.0
    for s in range(m.shape[0]):
        whole += shares[s]
    for s in range(m.shape[0]):
        for i in range(SIZE):
            step[i] = 0.0
            for j in range(SIZE):
                local[i, j] = P[i, j] * whole / shares[s]
        if m[s] > 0:
            code, nis[s] = white_update(local, H[s], residual[s], m[s], gate_of(m[s], factor), step)
            what[s] = outcome(code)
            if code != OK:
                for i in range(SIZE):
                    step[i] = 0.0
        code = information_of(local, d, own)
        if code != OK:
            return code
        for i in range(SIZE):
            for j in range(SIZE):
                Y[i, j] += own[i, j]
                y[i] += own[i, j] * step[j] / d[j]
    for i in range(SIZE):
        step[i] = 1.0
    code = information_of(Y, step, own)
    if code != OK:
        return code
    for i in range(SIZE):
        total = 0.0
        for j in range(SIZE):
            total += own[i, j] * y[j]
        if not math.isfinite(total):
            return NOT_FINITE
        dx[i] = d[i] * total
    for i in range(SIZE):
        for j in range(SIZE):
            P[i, j] = d[i] * d[j] * own[i, j]
    return OK
