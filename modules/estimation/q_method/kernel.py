"""Davenport's q-method: the attitude with the least weighted squares, as an eigenvector, and its covariance."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, V4, cross, determinant, dot, inverse, norm, unit, vec3
from fsw.module import Row
from messages.base import F64
from modules.estimation.q_method import status

PARALLEL = 1e-6
"""Least determinant of the information, relative to the cube of its mean: about the square of the directions' angle."""


@compiled
def largest_eigenvector(K: F64) -> V4:
    """Unit eigenvector of the largest eigenvalue of a symmetric K (4, 4), which is lost; by Jacobi rotations."""
    V = np.eye(4)
    for _ in range(30):
        off, size = 0.0, 0.0
        for i in range(4):
            size += K[i, i] * K[i, i]
            for j in range(i):
                off += K[i, j] * K[i, j]
        if not off > 1e-34 * size:
            break
        for i in range(3):
            for j in range(i + 1, 4):
                if K[i, j] == 0.0:
                    continue
                ratio = (K[j, j] - K[i, i]) / (2.0 * K[i, j])
                t = math.copysign(1.0, ratio) / (math.fabs(ratio) + math.sqrt(1.0 + ratio * ratio))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(4):
                    a, b = K[k, i], K[k, j]
                    K[k, i], K[k, j] = c * a - s * b, s * a + c * b
                for k in range(4):
                    a, b = K[i, k], K[j, k]
                    K[i, k], K[j, k] = c * a - s * b, s * a + c * b
                    a, b = V[k, i], V[k, j]
                    V[k, i], V[k, j] = c * a - s * b, s * a + c * b
    best = 0
    for i in range(1, 4):
        if K[i, i] > K[best, best]:
            best = i
    return (V[0, best], V[1, best], V[2, best], V[3, best])


@compiled
def checked(directions: Row) -> int:
    """Status of a message of directions before anything is computed."""
    if not directions.valid:
        return status.INVALID
    if directions.count < 2:
        return status.TOO_FEW
    for k in range(directions.count):
        length = norm(vec3(directions.measured_B[k])) * norm(vec3(directions.known_N[k]))
        if not (math.isfinite(length) and length > 0.0 and math.isfinite(directions.sigma[k])):
            return status.BAD_NUMBERS
        if not directions.sigma[k] > 0.0:
            return status.BAD_NUMBERS
    return status.VALID


@compiled
def q_attitude(directions: Row) -> tuple[int, V4, M3, float]:
    """Attitude from two or more directions that passed `checked`.

    Returns:
        Status, beta_BN (scalar first, not negative), covariance of the attitude error in B [rad^2], and the weighted
        squares that remain by their degrees of freedom, 2 n - 3.
    """
    B, K, information = np.zeros((3, 3)), np.zeros((4, 4)), np.zeros((3, 3))
    z: V3 = (0.0, 0.0, 0.0)
    total = 0.0
    for k in range(directions.count):
        b, r = unit(vec3(directions.measured_B[k])), unit(vec3(directions.known_N[k]))
        w = 1.0 / (directions.sigma[k] * directions.sigma[k])
        total += w
        turn = cross(b, r)
        z = (z[0] + w * turn[0], z[1] + w * turn[1], z[2] + w * turn[2])
        for i in range(3):
            for j in range(3):
                B[i, j] += w * b[i] * r[j]
                information[i, j] += w * ((1.0 if i == j else 0.0) - b[i] * b[j])
    trace = B[0, 0] + B[1, 1] + B[2, 2]
    K[0, 0] = trace
    for i in range(3):
        K[0, 1 + i] = K[1 + i, 0] = z[i]
        for j in range(3):
            K[1 + i, 1 + j] = B[i, j] + B[j, i] - (trace if i == j else 0.0)
    nothing = (math.nan, math.nan, math.nan)
    none = (nothing, nothing, nothing)
    known = (vec3(information[0]), vec3(information[1]), vec3(information[2]))
    mean = (known[0][0] + known[1][1] + known[2][2]) / 3.0
    if not determinant(known) > PARALLEL * mean * mean * mean:
        return status.PARALLEL, (math.nan, math.nan, math.nan, math.nan), none, math.nan
    q = largest_eigenvector(K)
    sign = 1.0 if q[0] >= 0.0 else -1.0
    beta = (sign * q[0], sign * q[1], sign * q[2], sign * q[3])
    return status.VALID, beta, inverse(known), remaining(directions, beta) / (2 * directions.count - 3)


@compiled
def remaining(directions: Row, beta: V4) -> float:
    """Sum of squared distances of measured from turned known unit vectors, by their variances."""
    q0, q = beta[0], (beta[1], beta[2], beta[3])
    total = 0.0
    for k in range(directions.count):
        b, r = unit(vec3(directions.measured_B[k])), unit(vec3(directions.known_N[k]))
        # r in B components, of passive Euler parameters
        turn, along, scalar = cross(r, q), 2.0 * dot(q, r), 2.0 * q0 * q0 - 1.0
        w = 1.0 / (directions.sigma[k] * directions.sigma[k])
        for i in range(3):
            away = b[i] - (scalar * r[i] + along * q[i] + 2.0 * q0 * turn[i])
            total += w * away * away
    return total
