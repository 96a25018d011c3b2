"""Basilisk's square-root unscented filters as they are in its release 2.12.1, with their faults, to compare with.

Inside everything is in km and km/s. Noise of a measurement is stacked untransposed, process noise is added at each
update, the mean is the middle point, sigma points are not drawn anew, and NaN passes every check.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.square_root import (
    NOT_FINITE,
    NOT_POSITIVE,
    OK,
    SINGULAR,
    cholesky,
    invert_lower,
    rank_one,
    transpose_in_place,
)
from fsw.math.two_body import orbit_step
from fsw.math.unscented import Motion, Weights, draw, factor_about, mean_of, move
from fsw.math.vectors import V3, dot, matmul_into, scale
from fsw.module import Row
from messages.base import F64

GRAVITY_KM = np.array([[399.0, 398600.436], [499.0, 42828.314], [599.0, 126712767.881]])
"""NAIF identifier and gravitational parameter [km^3/s^2] of Basilisk's planets."""


@compiled
def gravity_km(body_id: int) -> float:
    """Gravitational parameter [km^3/s^2]; NaN for a body that Basilisk does not know."""
    for i in range(GRAVITY_KM.shape[0]):
        if GRAVITY_KM[i, 0] == body_id:
            return GRAVITY_KM[i, 1]
    return math.nan


@compiled
def basilisk_pull(r: V3, mu: float) -> V3:
    """Acceleration with the rounding of Basilisk, which takes the cube by ``pow``."""
    return scale(-mu / math.pow(math.sqrt(dot(r, r)), 3.0), r)


@compiled
def basilisk_motion(state: F64, dt: float, mu: float) -> int:
    """A step about a point mass, to the bit as in Basilisk."""
    return orbit_step(basilisk_pull, state, dt, mu)


@compiled
def factor_of(A: F64, L: F64) -> int:
    """Cholesky as in Basilisk, which takes a last pivot of zero for good."""
    code = cholesky(A, L)
    if code == SINGULAR:
        for i in range(A.shape[0] - 1):
            if L[i, i] == 0.0:
                return SINGULAR
        return OK
    return code


@compiled
def failed(code: int) -> bool:
    """Whether Basilisk notices; it does not see NaN."""
    return code in (NOT_POSITIVE, SINGULAR)


@compiled
def basilisk_time_update(
    motion: Motion, t: float, args: Row, weights: Weights, noise: F64, state: Row, points: F64, middle: F64
) -> int:
    """Move ``state.x``, ``state.S``, ``state.time`` to t [s]; a failure leaves them as they were (CleanUpdate).

    Args:
        motion: of a point.
        t: time [s].
        args: what the motion needs.
        weights: of `unscented_weights`.
        noise: transposed factor of qNoise (n, n).
        state: row of the filter's state.
        points: out (2n + 1, n), the moved points.
        middle: out (n,), their mean.
    """
    n = points.shape[1]
    draw(state.x, state.S, weights[0], points)
    move(motion, t - state.time, args, points)
    factor = np.empty((n, n))
    mean_of(points, weights, middle)
    code = factor_about(points, middle, weights, 1.0, noise, factor, np.empty((3 * n, n)), np.empty((n, n)))
    if failed(code):
        return code
    for i in range(n):
        state.x[i] = points[0, i]
        for j in range(n):
            state.S[i, j] = math.nan if code == NOT_FINITE else factor[i, j]
    state.time = t
    return OK


@compiled
def basilisk_orbit_update(
    t: float, mu: float, weights: Weights, noise: F64, state: Row, points: F64, middle: F64
) -> int:
    """`basilisk_time_update` about a point mass [km^3/s^2]."""
    return basilisk_time_update(basilisk_motion, t, mu, weights, noise, state, points, middle)


@compiled
def basilisk_measurement_update(
    weights: Weights, swell: float, R: F64, observed: F64, seen: F64, points: F64, middle: F64, state: Row
) -> int:
    """Correct ``state.x`` and ``state.S``; a failure leaves them as they were (CleanUpdate).

    Args:
        weights: of `unscented_weights`.
        swell: noiseSF.
        R: covariance of the measurement (m, m).
        observed: (m,).
        seen: what the points see (2n + 1, m).
        points: as the time update left them (2n + 1, n).
        middle: their mean (n,).
        state: row of the filter's state.
    """
    count, n = points.shape
    m = observed.shape[0]
    small, mean, S, column = np.zeros((3, m, m)), np.zeros(m), np.empty((n, n)), np.empty(n)
    L, factor, inverse = small[0], small[1], small[2]
    Pxy, half, K = np.zeros((n, m)), np.empty((n, m)), np.empty((n, m))
    code = factor_of(R, L)
    if failed(code):
        return code
    for p in range(count):
        for k in range(m):
            mean[k] += weights[1 if p == 0 else 3] * seen[p, k]
    code = factor_about(seen, mean, weights, swell, L, factor, np.empty((count - 1 + m, m)), np.empty((m, m)))
    if failed(code):
        return code
    bad = code == NOT_FINITE
    for p in range(count):
        for i in range(n):
            away = weights[2 if p == 0 else 3] * (points[p, i] - middle[i])
            for k in range(m):
                Pxy[i, k] += away * (seen[p, k] - mean[k])
    if not bad and invert_lower(factor, inverse) == SINGULAR:
        return SINGULAR
    transpose_in_place(inverse)
    matmul_into(Pxy, inverse, half)
    transpose_in_place(inverse)
    matmul_into(half, inverse, K)
    matmul_into(K, factor, half)
    for i in range(n):
        for j in range(n):
            S[i, j] = state.S[i, j]
    for k in range(m):
        for i in range(n):
            column[i] = half[i, k]
        code = rank_one(S, column, -1.0, S)
        if failed(code):
            return code
        bad = bad or code == NOT_FINITE
    for i in range(n):
        total = 0.0
        for k in range(m):
            total += K[i, k] * (observed[k] - mean[k])
        state.x[i] += math.nan if bad else total
        for j in range(n):
            state.S[i, j] = math.nan if bad else S[i, j]
    return OK


@compiled
def post_fit(weights: Weights, observed: F64, seen: F64, out: F64) -> None:
    """out (3,): observed minus the mean of what the points see, of which the first three numbers count."""
    for k in range(3):
        mean = weights[1] * seen[0, k]
        for p in range(1, seen.shape[0]):
            mean += weights[3] * seen[p, k]
        out[k] = observed[k] - mean
