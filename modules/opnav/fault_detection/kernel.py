"""How far two positions are apart for their covariances, and what is best made of both."""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, determinant, dot, inverse, matvec, sub


@compiled
def positive(P: M3) -> bool:
    """Whether a matrix is symmetric to 1e-6 of its largest element and positive definite (Sylvester's criterion)."""
    size = max(P[0][0], P[1][1], P[2][2])
    skew = max(math.fabs(P[0][1] - P[1][0]), math.fabs(P[0][2] - P[2][0]), math.fabs(P[1][2] - P[2][1]))
    if not (P[0][0] > 0.0 and P[1][1] > 0.0 and P[2][2] > 0.0 and math.isfinite(size) and skew <= 1e-6 * size):
        return False
    if not P[0][0] * P[1][1] - P[0][1] * P[1][0] > 0.0:
        return False
    return determinant(P) > 0.0


@compiled
def summed(P: M3, Q: M3) -> M3:
    """P + Q."""
    return (add(P[0], Q[0]), add(P[1], Q[1]), add(P[2], Q[2]))


@compiled
def distance2(r1: V3, P1: M3, r2: V3, P2: M3) -> float:
    """Squared Mahalanobis distance of two positions with independent errors; chi-square, 3 degrees of freedom."""
    d = sub(r2, r1)
    return dot(d, matvec(inverse(summed(P1, P2)), d))


@compiled
def merged(r1: V3, P1: M3, r2: V3, P2: M3) -> tuple[V3, M3]:
    """Best linear combination of two positions with independent errors, and its covariance."""
    A, B = inverse(P1), inverse(P2)
    P = inverse(summed(A, B))
    return matvec(P, add(matvec(A, r1), matvec(B, r2))), P


@compiled
def frobenius(P: M3) -> float:
    """Root of the sum of the squares of all elements."""
    return math.sqrt(dot(P[0], P[0]) + dot(P[1], P[1]) + dot(P[2], P[2]))
