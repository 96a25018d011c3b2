"""The pose, the columns of its error state, and small pieces that all models use."""

from __future__ import annotations

import math
from typing import TypeAlias

from fsw.math.attitude import ep_to_dcm, rotvec_to_ep
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, cross, matmul, norm, scale
from messages.base import F64

Pose: TypeAlias = tuple[V3, V3, M3, V3]
"""r_BN_N [m], v_BN_N [m/s], dcm_BN, omega_BN_B [rad/s]."""
R, V, THETA, OMEGA = 0, 3, 6, 9
"""First columns of the parts of the error state."""
SIZE = 12


@compiled
def clear(H: F64) -> None:
    """Zero everywhere."""
    for i in range(H.shape[0]):
        for j in range(H.shape[1]):
            H[i, j] = 0.0


@compiled
def put_row(H: F64, row: int, column: int, a: V3) -> None:
    """Three numbers of a row, from a column on."""
    H[row, column], H[row, column + 1], H[row, column + 2] = a


@compiled
def put_block(H: F64, row: int, column: int, m: M3) -> None:
    """A block (3, 3), from a row and a column on."""
    put_row(H, row, column, m[0])
    put_row(H, row + 1, column, m[1])
    put_row(H, row + 2, column, m[2])


@compiled
def turned_by(row: V3, seen_B: V3) -> V3:
    """Derivative by theta of row . (dcm_BN a), with ``seen_B`` = dcm_BN a: row [seen_B x]."""
    return cross(row, seen_B)


@compiled
def corrected_attitude(theta: V3, dcm_BN: M3) -> M3:
    """Attitude after a correction theta [rad], B components: a whole turn, not only its first order."""
    return matmul(ep_to_dcm(rotvec_to_ep(theta)), dcm_BN)


@compiled
def across(u: V3) -> tuple[V3, V3]:
    """Two unit vectors at right angles to the unit vector u and to each other; with u a right-handed set."""
    i = 0 if abs(u[0]) <= abs(u[1]) and abs(u[0]) <= abs(u[2]) else (1 if abs(u[1]) <= abs(u[2]) else 2)
    axis = (1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0)
    first = cross(axis, u)
    first = scale(1.0 / norm(first), first)
    return first, cross(u, first)


@compiled
def is_finite(a: V3) -> bool:
    """Whether a vector has neither NaN nor infinity."""
    return math.isfinite(a[0] + a[1] + a[2])
