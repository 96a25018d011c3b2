"""The extended Kalman filter in Joseph's form: one time update and one measurement update that all such filters use.

A covariance P (n, n) is that of the error state, whatever that is; the caller moves the state itself and applies the
correction ``dx``. States that are not ``estimated`` are considered (Schmidt): their uncertainty counts in the gain,
but they and their covariance stay. All functions write into arrays that the caller gives; on failure nothing changes.

Sources: Joseph's form in Bucy and Joseph (1968), "Filtering for stochastic processes with applications to guidance",
valid for any gain; Schmidt (1966), "Application of state-space methods to navigation problems"; Bierman (1977),
"Factorization methods for discrete sequential estimation", ch. IV for the compression of measurements.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from fsw.math.square_root import NOT_FINITE, OK, cholesky, qr_triangle, solve_lower, solve_lower_transposed
from fsw.math.unscented import GATED
from messages.base import F64

B1: TypeAlias = NDArray[np.bool_]
"""A mask (n,)."""


@compiled
def covariance_time(Phi: F64, Q: F64, P: F64) -> int:
    """P <- Phi P Phi' + Q, exactly symmetric; `NOT_FINITE` leaves P.

    Args:
        Phi: (n, n) transition of the error state over the interval.
        Q: (n, n) covariance of the noise of the whole interval.
        P: (n, n) covariance, moved.
    """
    n = P.shape[0]
    half, moved = np.zeros((n, n)), np.empty((n, n))
    for i in range(n):
        for k in range(n):
            phi = Phi[i, k]
            if phi != 0.0:
                for j in range(n):
                    half[i, j] += phi * P[k, j]
    total = 0.0
    for i in range(n):
        for j in range(i, n):
            value = 0.5 * (Q[i, j] + Q[j, i])
            for k in range(n):
                value += half[i, k] * Phi[j, k]
            moved[i, j] = moved[j, i] = value
            total += value
    if not math.isfinite(total):
        return NOT_FINITE
    for i in range(n):
        for j in range(n):
            P[i, j] = moved[i, j]
    return OK


@compiled
def times_transposed(P: F64, H: F64, PHt: F64) -> None:
    """PHt (n, m) = P H', for P (n, n) and H (m, n), most of which may be zero."""
    m, n = H.shape
    for i in range(n):
        for a in range(m):
            PHt[i, a] = 0.0
    for a in range(m):
        for k in range(n):
            h = H[a, k]
            if h != 0.0:
                for i in range(n):
                    PHt[i, a] += P[i, k] * h


@compiled
def innovation_covariance(P: F64, H: F64, R: F64, PHt: F64, S: F64) -> None:
    """S = H P H' + R.

    Args:
        P: (n, n) covariance.
        H: (m, n) derivatives of what is measured by the error state.
        R: (m, m) covariance of the measurement.
        PHt: out (n, m), P H'.
        S: out (m, m).
    """
    m, n = H.shape
    times_transposed(P, H, PHt)
    for a in range(m):
        for b in range(m):
            value = R[a, b]
            for k in range(n):
                value += H[a, k] * PHt[k, b]
            S[a, b] = value


@compiled
def normalised_square(S: F64, residual: F64, L: F64, white: F64) -> tuple[int, float]:
    """residual' S^-1 residual, with the lower factor L (m, m) of S (m, m) and L^-1 residual in ``white`` (m,).

    Returns:
        `OK` or why there is none, and the normalised innovation squared (NaN on failure).
    """
    code = cholesky(S, L)
    if code != OK:
        return code, math.nan
    for a in range(residual.shape[0]):
        white[a] = residual[a]
    code = solve_lower(L, white)
    nis = 0.0
    for a in range(residual.shape[0]):
        nis += white[a] * white[a]
    if code != OK or not math.isfinite(nis):
        return NOT_FINITE, math.nan
    return OK, nis


@compiled
def gain(PHt: F64, L: F64, estimated: B1, K: F64) -> int:
    """K (n, m) = P H' S^-1, zero in the rows that are only considered.

    Args:
        PHt: (n, m) of `innovation_covariance`.
        L: (m, m) lower factor of S.
        estimated: (n,) which states are corrected.
        K: out (n, m).
    """
    n, m = PHt.shape
    for i in range(n):
        for a in range(m):
            K[i, a] = PHt[i, a] if estimated[i] else 0.0
        if estimated[i]:
            code = solve_lower(L, K[i])
            if code == OK:
                code = solve_lower_transposed(L, K[i])
            if code != OK:
                return code
    return OK


@compiled
def joseph(K: F64, H: F64, R: F64, P: F64) -> int:
    """P <- (I - K H) P (I - K H)' + K R K', exactly symmetric, for any gain K; `NOT_FINITE` leaves P.

    Args:
        K: (n, m) gain.
        H: (m, n) derivatives.
        R: (m, m) covariance of the measurement.
        P: (n, n) covariance, updated.
    """
    n, m = K.shape
    first, PHt, KR = np.empty((n, n)), np.empty((n, m)), np.zeros((n, m))
    times_transposed(P, H, PHt)
    for i in range(n):
        for j in range(n):
            value = P[i, j]
            for a in range(m):
                value -= K[i, a] * PHt[j, a]
            first[i, j] = value
    # (first H' - K R) K' is what the right side takes away
    for a in range(m):
        for i in range(n):
            value = 0.0
            for k in range(n):
                h = H[a, k]
                if h != 0.0:
                    value += first[i, k] * h
            for b in range(m):
                value -= K[i, b] * R[b, a]
            KR[i, a] = value
    total = 0.0
    for i in range(n):
        for j in range(n):
            for a in range(m):
                first[i, j] -= KR[i, a] * K[j, a]
            total += first[i, j]
    if not math.isfinite(total):
        return NOT_FINITE
    for i in range(n):
        for j in range(i, n):
            P[i, j] = P[j, i] = 0.5 * (first[i, j] + first[j, i])
    return OK


@compiled
def kalman_update(P: F64, H: F64, R: F64, residual: F64, gate: float, estimated: B1, dx: F64) -> tuple[int, float]:
    """Correct an estimate by a measurement; nothing is changed if its normalised square is above the gate.

    Args:
        P: (n, n) covariance of the error state, updated.
        H: (m, n) derivatives of what is measured by the error state, at the estimate.
        R: (m, m) covariance of the measurement.
        residual: (m,) measured minus predicted.
        gate: largest normalised innovation squared; infinity for none.
        estimated: (n,) which states are corrected; the others are considered.
        dx: out (n,), correction of the error state.

    Returns:
        `OK`, `GATED` or why it failed, and the normalised innovation squared (NaN on failure).
    """
    m, n = H.shape
    PHt, K, S, L, white = np.empty((n, m)), np.empty((n, m)), np.empty((m, m)), np.empty((m, m)), np.empty(m)
    innovation_covariance(P, H, R, PHt, S)
    code, nis = normalised_square(S, residual, L, white)
    if code != OK:
        return code, nis
    if nis > gate:
        return GATED, nis
    code = gain(PHt, L, estimated, K)
    if code == OK:
        code = joseph(K, H, R, P)
    if code != OK:
        return code, math.nan
    for i in range(n):
        dx[i] = 0.0
        for a in range(m):
            dx[i] += K[i, a] * residual[a]
    return OK, nis


@compiled
def compress(rows: F64, triangle: F64, H: F64, residual: F64) -> int:
    """Many measurements as few: the orthogonal triangle of their rows, which holds the same information.

    Args:
        rows: (m, n + 1), m > n, each row of derivatives and its residual divided by the standard deviation, rows
            independent; overwritten.
        triangle: work (n + 1, n + 1).
        H: out (n, n), derivatives of n measurements of covariance one.
        residual: out (n,), their residuals.

    Returns:
        `OK` or `NOT_FINITE`. A direction that no row sees gives a zero row, which changes nothing.
    """
    n = H.shape[0]
    if qr_triangle(rows, triangle) == NOT_FINITE:
        return NOT_FINITE
    for i in range(n):
        residual[i] = triangle[i, n]
        for j in range(n):
            H[i, j] = triangle[i, j]
    return OK
