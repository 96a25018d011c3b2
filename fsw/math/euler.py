"""The twelve Euler angle sequences: rotation matrices, Euler parameters and rates, both ways. Compiled.

A sequence is its three axes as one number: 321 is yaw, pitch, roll about axes 3, 2 and 1 in turn, ``dcm_BN = M1(a3)
M2(a2) M3(a1)``, each M passive. Angles are rad. The middle angle that functions return lies in [-pi/2, pi/2] if the
three axes differ and in [0, pi] if the first is also the last; the others lie in [-pi, pi].

At the ends of the middle angle's range (gimbal lock) the outer two turn about one axis: `dcm_to_euler` then puts the
whole turn into the first, and rates do not exist (NaN). Source: Schaub and Junkins, "Analytical Mechanics of Space
Systems", 4th ed., sec. 3.3.
"""

from __future__ import annotations

import math

from fsw.math.attitude import ep_compose, ep_to_dcm
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, V4, cross, dot, matmul, matvec, transpose

LOCK = 1e-12
"""Below this sine (or cosine) of the middle angle, rates do not exist."""


@compiled
def euler_axes(sequence: int) -> tuple[int, int, int]:
    """The axes 0, 1 or 2 of a sequence.

    Raises:
        ValueError: if it is none of the twelve.
    """
    i, j, k = sequence // 100 - 1, sequence // 10 % 10 - 1, sequence % 10 - 1
    if min(i, j, k) < 0 or max(i, j, k) > 2 or j in (i, k):
        raise ValueError("Euler sequence: expected three axes such as 321 or 313, no two neighbours alike")
    return i, j, k


@compiled
def axis_dcm(axis: int, angle: float) -> M3:
    """Rotation matrix of a frame turned by an angle (rad) about axis 0, 1 or 2."""
    c, s = math.cos(angle), math.sin(angle)
    if axis == 0:
        return ((1.0, 0.0, 0.0), (0.0, c, s), (0.0, -s, c))
    if axis == 1:
        return ((c, 0.0, -s), (0.0, 1.0, 0.0), (s, 0.0, c))
    return ((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0))


@compiled
def axis_ep(axis: int, angle: float) -> V4:
    """Euler parameters of a frame turned by an angle (rad) about axis 0, 1 or 2; the scalar may be negative."""
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return (c, s if axis == 0 else 0.0, s if axis == 1 else 0.0, s if axis == 2 else 0.0)


@compiled
def euler_to_dcm(sequence: int, angles: V3) -> M3:
    """dcm_BN of the angles from N to B."""
    i, j, k = euler_axes(sequence)
    return matmul(axis_dcm(k, angles[2]), matmul(axis_dcm(j, angles[1]), axis_dcm(i, angles[0])))


@compiled
def euler_to_ep(sequence: int, angles: V3) -> V4:
    """beta_BN, scalar >= 0, of the angles from N to B."""
    i, j, k = euler_axes(sequence)
    return ep_compose(axis_ep(k, angles[2]), ep_compose(axis_ep(j, angles[1]), axis_ep(i, angles[0])))


@compiled
def dcm_to_euler(sequence: int, m: M3) -> V3:
    """Angles from N to B of dcm_BN; also next to gimbal lock they give the matrix back to rounding."""
    i, j, k = euler_axes(sequence)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    other = 3 - i - j  # the axis besides the first two; the last one if all differ
    if i == k:
        a, b = m[i][j], -sign * m[i][other]
        sine = math.hypot(a, b)
        second = math.atan2(sine, m[i][i])
    else:
        a, b = -sign * m[k][j], m[k][k]
        sine = math.hypot(a, b)
        second = math.atan2(sign * m[k][i], sine)
    if sine < 1e-15:
        return (math.atan2(sign * m[j][other], m[j][j]), second, 0.0)
    first = math.atan2(a, b)
    # the third angle from the matrix turned back by the first: errors of the two then cancel near gimbal lock
    c, s = math.cos(first), sign * math.sin(first)
    row = other if i == k else i
    turned = c * m[row][j] + s * m[row][other]
    return (first, second, math.atan2(-sign * turned if i == k else sign * turned, c * m[j][j] + s * m[j][other]))


@compiled
def ep_to_euler(sequence: int, beta: V4) -> V3:
    """Angles from N to B of unit Euler parameters beta_BN."""
    return dcm_to_euler(sequence, ep_to_dcm(beta))


@compiled
def euler_compose(sequence: int, angles_CB: V3, angles_BN: V3) -> V3:
    """Angles from N to C of those from B to C and from N to B, all of one sequence."""
    return dcm_to_euler(sequence, matmul(euler_to_dcm(sequence, angles_CB), euler_to_dcm(sequence, angles_BN)))


@compiled
def euler_relative(sequence: int, angles_BN: V3, angles_RN: V3) -> V3:
    """Angles from R to B of two attitudes relative to the same frame N, all of one sequence."""
    return dcm_to_euler(
        sequence, matmul(euler_to_dcm(sequence, angles_BN), transpose(euler_to_dcm(sequence, angles_RN)))
    )


@compiled
def _rate_axes(sequence: int, angles: V3) -> M3:
    """The axes about which the three angles turn, B components, as rows."""
    i, j, k = euler_axes(sequence)
    last = axis_dcm(k, angles[2])
    before = matmul(last, axis_dcm(j, angles[1]))
    third = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
    return (
        (before[0][i], before[1][i], before[2][i]),
        (last[0][j], last[1][j], last[2][j]),
        third,
    )


@compiled
def euler_rates_to_omega(sequence: int, angles: V3, rates: V3) -> V3:
    """omega_BN_B, rad/s, of the angles from N to B and their time derivatives, rad/s."""
    return matvec(transpose(_rate_axes(sequence, angles)), rates)


@compiled
def euler_matrix(sequence: int, angles: V3) -> M3:
    """The matrix that takes omega_BN_B to the time derivatives of the angles; NaN at gimbal lock."""
    a, b, c = _rate_axes(sequence, angles)
    x, y, z = cross(b, c), cross(c, a), cross(a, b)
    size = dot(a, x)
    f = 1.0 / size if abs(size) > LOCK else math.nan
    return ((f * x[0], f * x[1], f * x[2]), (f * y[0], f * y[1], f * y[2]), (f * z[0], f * z[1], f * z[2]))


@compiled
def euler_rates(sequence: int, angles: V3, omega: V3) -> V3:
    """Time derivatives of the angles from N to B, rad/s, for the rate omega_BN_B; NaN at gimbal lock."""
    return matvec(euler_matrix(sequence, angles), omega)
