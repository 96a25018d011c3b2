"""The square-root unscented filter: one transform, which the time update and the measurement update of all filters use.

A user's motion and measurement are compiled functions; they go in as arguments and are compiled into the filter.
Covariances are lower factors S, P = S S'. Sigma points are the rows of an array (2n + 1, n): the middle, then the
middle plus gamma times each column of S, then minus.

Source: van der Merwe and Wan (2001), "The square-root unscented Kalman filter for state and parameter estimation",
ICASSP, with two corrections: noise factors are stacked so that the covariance is L L', and the points of a measurement
are drawn anew from the predicted covariance, process noise included.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.square_root import (
    NOT_FINITE,
    NOT_POSITIVE,
    OK,
    SINGULAR,
    qr_triangle,
    rank_one,
    solve_lower,
)
from messages.base import F64

Weights: TypeAlias = tuple[float, float, float, float]
"""gamma; weight of the middle point for means and for covariances; weight of each other point for both."""
Motion: TypeAlias = Callable[[F64, float, Any], int]
"""``motion(point, dt, args)`` moves one point (n,) by dt [s] in place and returns `OK` or another code."""
Measure: TypeAlias = Callable[[F64, F64, Any], int]
"""``measure(point, seen, args)`` writes what a point (n,) sees into ``seen`` (m,) and returns `OK` or another code."""


@compiled
def unscented_weights(n: int, alpha: float, beta: float, kappa: float) -> Weights:
    """Weights of the scaled unscented transform for n states, with lambda = alpha^2 (n + kappa) - n."""
    lam = alpha * alpha * (n + kappa) - n
    w = 0.5 / (n + lam)
    first = lam / (n + lam)
    return (math.sqrt(n + lam), first, first + (1.0 - alpha * alpha + beta), w)


@compiled
def draw(x: F64, S: F64, gamma: float, points: F64) -> None:
    """Sigma points (2n + 1, n) of the mean x (n,) and the lower factor S (n, n)."""
    n = x.shape[0]
    for j in range(n):
        points[0, j] = x[j]
        for i in range(n):
            step = gamma * S[j, i]
            points[1 + i, j] = x[j] + step
            points[1 + n + i, j] = x[j] - step


@compiled
def mean_of(points: F64, weights: Weights, mean: F64) -> None:
    """Weighted mean (m,) of points (2n + 1, m)."""
    count, m = points.shape
    half = (count - 1) // 2
    _, mean0, _, w = weights
    for j in range(m):
        mean[j] = mean0 * points[0, j]
    for i in range(half):
        for j in range(m):
            mean[j] += w * points[1 + i, j]
            mean[j] += w * points[1 + half + i, j]


@compiled
def factor_about(
    points: F64, mean: F64, weights: Weights, swell: float, noise: F64, factor: F64, rows: F64, triangle: F64
) -> int:
    """Lower factor of the covariance of points about their mean plus noise.

    Args:
        points: (2n + 1, m).
        mean: (m,).
        weights: of `unscented_weights`.
        swell: factor of the points' part of the factor; 1 but for Basilisk's noiseSF.
        noise: (m, m); its rows are stacked, so for a covariance L L' it holds L'.
        factor: out, lower (m, m).
        rows: work (2n + m, m).
        triangle: work (m, m).
    """
    count, m = points.shape
    _, _, cov0, w = weights
    if not w > 0.0:
        return NOT_POSITIVE
    root = math.sqrt(w) * swell
    for i in range(count - 1):
        for j in range(m):
            rows[i, j] = root * (points[1 + i, j] - mean[j])
    for i in range(m):
        for j in range(m):
            rows[count - 1 + i, j] = noise[i, j]
    code = qr_triangle(rows, triangle)
    if code not in (OK, SINGULAR):
        return code
    for i in range(m):
        rows[0, i] = points[0, i] - mean[i]
        for j in range(m):
            factor[i, j] = triangle[j, i] if j <= i else 0.0
    return rank_one(factor, rows[0], cov0, factor)


@compiled
def move(motion: Motion, dt: float, args: Any, points: F64) -> int:
    """All points moved by dt [s]; the code of the first that fails."""
    for i in range(points.shape[0]):
        code = motion(points[i], dt, args)
        if code != OK:
            return code
    return OK


@compiled
def look(measure: Measure, args: Any, points: F64, seen: F64) -> int:
    """What all points (2n + 1, n) see, (2n + 1, m); the code of the first that fails."""
    for i in range(points.shape[0]):
        code = measure(points[i], seen[i], args)
        if code != OK:
            return code
    return OK


@compiled
def gain_columns(points: F64, middle: F64, seen: F64, mean: F64, weights: Weights, factor: F64, U: F64) -> int:
    """U (n, m) = Pxy Sy'^-1, with the gain K = U Sy^-1 and the loss of covariance U U'.

    Args:
        points: (2n + 1, n).
        middle: their mean (n,).
        seen: (2n + 1, m).
        mean: their mean (m,).
        weights: of `unscented_weights`.
        factor: Sy, lower factor of the innovation's covariance (m, m).
        U: out (n, m).
    """
    count, n = points.shape
    m = seen.shape[1]
    _, _, cov0, w = weights
    for i in range(n):
        for k in range(m):
            U[i, k] = cov0 * (points[0, i] - middle[i]) * (seen[0, k] - mean[k])
    for p in range(1, count):
        for i in range(n):
            away = w * (points[p, i] - middle[i])
            for k in range(m):
                U[i, k] += away * (seen[p, k] - mean[k])
    for i in range(n):
        code = solve_lower(factor, U[i])
        if code != OK:
            return code
    return OK


@compiled
def take_away(S: F64, U: F64, column: F64) -> int:
    """S (n, n) <- lower factor of S S' - U U', U (n, m), one column after the other; ``column`` (n,) is work.

    On failure S is lost.
    """
    n, m = U.shape
    for k in range(m):
        for i in range(n):
            column[i] = U[i, k]
        code = rank_one(S, column, -1.0, S)
        if code != OK:
            return code
    return OK


@compiled
def time_update(motion: Motion, dt: float, args: Any, weights: Weights, noise: F64, x: F64, S: F64) -> int:
    """x and S moved by dt [s], with process noise; unchanged on failure.

    Args:
        motion: of the state.
        dt: interval [s].
        args: what the motion needs.
        weights: of `unscented_weights`.
        noise: transposed lower factor of the noise of the whole interval (n, n).
        x: mean (n,).
        S: lower factor (n, n).
    """
    n = x.shape[0]
    points, rows = np.empty((2 * n + 1, n)), np.empty((3 * n, n))
    mean, factor, triangle = np.empty(n), np.empty((n, n)), np.empty((n, n))
    draw(x, S, weights[0], points)
    code = move(motion, dt, args, points)
    if code == OK:
        mean_of(points, weights, mean)
        code = factor_about(points, mean, weights, 1.0, noise, factor, rows, triangle)
    if code != OK:
        return code
    for i in range(n):
        if not math.isfinite(mean[i]):
            return NOT_FINITE
    for i in range(n):
        x[i] = mean[i]
        for j in range(n):
            S[i, j] = factor[i, j]
    return OK


GATED = 1
"""The innovation is larger than the gate lets pass; nothing is changed."""


@compiled
def measurement_update(
    measure: Measure,
    args: Any,
    weights: Weights,
    noise: F64,
    observed: F64,
    gate: float,
    x: F64,
    S: F64,
    innovation: F64,
    factor: F64,
) -> tuple[int, float]:
    """x and S corrected by a measurement; unchanged on failure and if the innovation does not pass the gate.

    Args:
        measure: of the state.
        args: what the measurement needs.
        weights: of `unscented_weights`.
        noise: transposed lower factor of the measurement's noise (m, m).
        observed: (m,).
        gate: largest normalised innovation squared.
        x: mean (n,).
        S: lower factor (n, n).
        innovation: out (m,).
        factor: out, lower factor of the innovation's covariance (m, m).

    Returns:
        `OK`, `GATED` or why it failed, and the normalised innovation squared (NaN on failure).
    """
    n, m = x.shape[0], observed.shape[0]
    points, seen = np.empty((2 * n + 1, n)), np.empty((2 * n + 1, m))
    draw(x, S, weights[0], points)
    code = look(measure, args, points, seen)
    if code != OK:
        return code, math.nan
    mean, rows, triangle = np.empty((2, m)), np.empty((2 * n + m, m)), np.empty((m, m))
    mean_of(seen, weights, mean[0])
    code = factor_about(seen, mean[0], weights, 1.0, noise, factor, rows, triangle)
    if code != OK:
        return code, math.nan
    white, nis = mean[1], 0.0
    for k in range(m):
        innovation[k] = white[k] = observed[k] - mean[0, k]
    code = solve_lower(factor, white)
    for k in range(m):
        nis += white[k] * white[k]
    if code != OK or not math.isfinite(nis):
        return NOT_FINITE, math.nan
    if nis > gate:
        return GATED, nis
    U, trial, column = np.empty((n, m)), np.empty((n, n)), np.empty((2, n))
    code = gain_columns(points, x, seen, mean[0], weights, factor, U)
    if code != OK:
        return code, math.nan
    for i in range(n):
        for j in range(n):
            trial[i, j] = S[i, j]
    code = take_away(trial, U, column[0])
    if code != OK:
        return code, math.nan
    for i in range(n):
        for k in range(m):
            x[i] += U[i, k] * white[k]
        for j in range(n):
            S[i, j] = trial[i, j]
    return OK, nis


@compiled
def residual(measure: Measure, args: Any, observed: F64, x: F64, out: F64) -> int:
    """out (m,) = observed minus what the state x (n,) sees."""
    code = measure(x, out, args)
    if code == OK:
        for k in range(observed.shape[0]):
            out[k] = observed[k] - out[k]
    return code
