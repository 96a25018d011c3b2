"""Vectors and matrices of three as tuples, and products of larger ones written into an output.

A vector is a tuple (x, y, z); a 3 x 3 matrix is a tuple of its three rows. Units and frames are the caller's.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

from fsw.math.compiled import compiled
from messages.base import F64

V3: TypeAlias = tuple[float, float, float]
V4: TypeAlias = tuple[float, float, float, float]
M3: TypeAlias = tuple[V3, V3, V3]
Row3: TypeAlias = Any
"""An array (3,), as a field of a row."""


@compiled
def vec3(a: Row3) -> V3:
    """The tuple of an array (3,)."""
    return (a[0], a[1], a[2])


@compiled
def vec4(a: Row3) -> V4:
    """The tuple of an array (4,)."""
    return (a[0], a[1], a[2], a[3])


@compiled
def mat3(a: Row3) -> M3:
    """The tuple of rows of an array (3, 3)."""
    return ((a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2]))


@compiled
def store3(out: Row3, a: V3) -> None:
    """Write a vector into the array ``out`` (3,)."""
    out[0] = a[0]
    out[1] = a[1]
    out[2] = a[2]


@compiled
def store4(out: Row3, a: V4) -> None:
    """Write four numbers into the array ``out`` (4,)."""
    out[0] = a[0]
    out[1] = a[1]
    out[2] = a[2]
    out[3] = a[3]


@compiled
def store33(out: Row3, m: M3) -> None:
    """Write a matrix into the array ``out`` (3, 3)."""
    for i in range(3):
        out[i, 0] = m[i][0]
        out[i, 1] = m[i][1]
        out[i, 2] = m[i][2]


@compiled
def add(a: V3, b: V3) -> V3:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def sub(a: V3, b: V3) -> V3:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def scale(k: float, a: V3) -> V3:
    """k a."""
    return (k * a[0], k * a[1], k * a[2])


@compiled
def axpy(k: float, a: V3, b: V3) -> V3:
    """k a + b."""
    return (k * a[0] + b[0], k * a[1] + b[1], k * a[2] + b[2])


@compiled
def dot(a: V3, b: V3) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: V3, b: V3) -> V3:
    """Cross product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def norm(a: V3) -> float:
    """Euclidean length; squares must not overflow, so elements are below 1e150."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@compiled
def unit(a: V3) -> V3:
    """a divided by its length; NaN if the length is 0."""
    n = norm(a)
    if not n > 0.0:
        return (math.nan, math.nan, math.nan)
    return (a[0] / n, a[1] / n, a[2] / n)


@compiled
def angle_between(a: V3, b: V3) -> float:
    """Angle of two directions of any length [rad]; exact also where it is small or near pi."""
    return math.atan2(norm(cross(a, b)), dot(a, b))


@compiled
def matvec(m: M3, a: V3) -> V3:
    """m a."""
    return (dot(m[0], a), dot(m[1], a), dot(m[2], a))


@compiled
def mat_t_vec(m: M3, a: V3) -> V3:
    """m' a, the transposed matrix times a vector."""
    return (
        m[0][0] * a[0] + m[1][0] * a[1] + m[2][0] * a[2],
        m[0][1] * a[0] + m[1][1] * a[1] + m[2][1] * a[2],
        m[0][2] * a[0] + m[1][2] * a[1] + m[2][2] * a[2],
    )


@compiled
def transpose(m: M3) -> M3:
    """m'."""
    return ((m[0][0], m[1][0], m[2][0]), (m[0][1], m[1][1], m[2][1]), (m[0][2], m[1][2], m[2][2]))


@compiled
def matmul(a: M3, b: M3) -> M3:
    """a b."""
    return (mat_t_vec(b, a[0]), mat_t_vec(b, a[1]), mat_t_vec(b, a[2]))


@compiled
def determinant(m: M3) -> float:
    """Determinant of m."""
    return dot(m[0], cross(m[1], m[2]))


@compiled
def inverse(m: M3) -> M3:
    """Inverse of m by cofactors, good for well-conditioned matrices such as inertias; NaN if m is singular."""
    a, b, c = cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])
    d = dot(m[0], a)
    k = 1.0 / d if d != 0.0 else math.nan
    return (
        (k * a[0], k * b[0], k * c[0]),
        (k * a[1], k * b[1], k * c[1]),
        (k * a[2], k * b[2], k * c[2]),
    )


@compiled
def matvec_into(a: F64, x: F64, out: F64) -> None:
    """out = a x for a (m, n), x (n,), out (m,), which must not overlap ``x``; column by column, which vectorises."""
    for i in range(a.shape[0]):
        out[i] = 0.0
    for j in range(a.shape[1]):
        xj = x[j]
        for i in range(a.shape[0]):
            out[i] += a[i, j] * xj


@compiled
def mat_t_vec_into(a: F64, x: F64, out: F64) -> None:
    """out = a' x for a (m, n), x (m,), out (n,), which must not overlap ``x``."""
    for j in range(a.shape[1]):
        out[j] = 0.0
    for i in range(a.shape[0]):
        xi = x[i]
        for j in range(a.shape[1]):
            out[j] += a[i, j] * xi


@compiled
def matmul_into(a: F64, b: F64, out: F64) -> None:
    """out = a b for a (m, k), b (k, n), out (m, n), which must not overlap ``a`` or ``b``."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
        for k in range(a.shape[1]):
            aik = a[i, k]
            for j in range(b.shape[1]):
                out[i, j] += aik * b[k, j]
