"""Basilisk's horizonOpNav, to compare with: see `modules.opnav.basilisk` for what is not right in it."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, axpy, dot, inverse, mat_t_vec, matmul, matvec, norm, scale, transpose
from messages.base import F64
from modules.opnav.basilisk import basilisk_radii
from modules.opnav.relative import sandwich

LIMIT = 1365
"""Basilisk's array of limb points ends here; the rest is not used."""


@compiled
def basilisk_position(
    body_id: int, dcm_CN: M3, limb_px: F64, count: int, width: int, height: int, fx: float, fy: float, noise: float
) -> tuple[V3, M3]:
    """Position relative to the planet and covariance, both in C.

    Args:
        body_id: NAIF identifier, 399, 499 or 599; another gives NaN.
        dcm_CN: maps N to C components; the pole is taken along the third axis of N.
        limb_px: points (n, 2) [px].
        count: points, n >= count >= 3.
        width: columns.
        height: rows.
        fx: focal length along columns [px].
        fy: along rows [px].
        noise: factor on the pixel noise width / count.
    """
    n = min(count, LIMIT)
    a, c = basilisk_radii(body_id)
    B = matmul(((1.0 / a, 0.0, 0.0), (0.0, 1.0 / a, 0.0), (0.0, 0.0, 1.0 / c)), transpose(dcm_CN))
    H, Q, lengths = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
    for i in range(n):
        s = matvec(B, ((limb_px[i, 0] - width // 2) / fx, (limb_px[i, 1] - height // 2) / fy, 1.0))
        lengths[i] = norm(s)
        for k in range(3):
            H[i, k] = s[k] / lengths[i]
            Q[i, k] = H[i, k]
    # least squares by modified Gram-Schmidt
    R, y, x = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for k in range(3):
        for i in range(n):
            R[k, k] += Q[i, k] * Q[i, k]
        R[k, k] = math.sqrt(R[k, k])
        for i in range(n):
            Q[i, k] /= R[k, k]
            y[k] += Q[i, k]
        for j in range(k + 1, 3):
            for i in range(n):
                R[k, j] += Q[i, k] * Q[i, j]
            for i in range(n):
                Q[i, j] -= Q[i, k] * R[k, j]
    for k in range(2, -1, -1):
        x[k] = y[k]
        for j in range(k + 1, 3):
            x[k] -= R[k, j] * x[j]
        x[k] /= R[k, k]
    m = (x[0], x[1], x[2])
    sigma = noise * width / n / fx
    s2 = sigma * sigma
    Rs = sandwich(B, ((s2, 0.0, 0.0), (0.0, s2, 0.0), (0.0, 0.0, 0.0)))
    A = np.zeros((3, 3))
    for i in range(n):
        h = (H[i, 0], H[i, 1], H[i, 2])
        J = scale(1.0 / lengths[i], axpy(-dot(m, h), h, m))
        w = 1.0 / dot(J, mat_t_vec(Rs, J))
        for j in range(3):
            for k in range(3):
                A[j, k] += w * h[j] * h[k]
    P_n = inverse(((A[0, 0], A[0, 1], A[0, 2]), (A[1, 0], A[1, 1], A[1, 2]), (A[2, 0], A[2, 1], A[2, 2])))
    d = dot(m, m) - 1.0
    if not d > 0.0:
        nan3 = (math.nan, math.nan, math.nan)
        return nan3, (nan3, nan3, nan3)
    k = -1.0 / math.sqrt(d)
    inv = inverse(B)
    F = matmul(
        inv,
        (axpy(-m[0] / d, m, (1.0, 0.0, 0.0)), axpy(-m[1] / d, m, (0.0, 1.0, 0.0)), axpy(-m[2] / d, m, (0.0, 0.0, 1.0))),
    )
    P = sandwich(F, P_n)
    return scale(k, matvec(inv, m)), (scale(k * k, P[0]), scale(k * k, P[1]), scale(k * k, P[2]))
