"""The frame that looks from an orbit to a place on the ground, and its motion. Compiled."""

from __future__ import annotations

import math

from fsw.math.attitude import rotvec_to_dcm
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, axpy, cross, dot, mat_t_vec, norm, scale, sub

Moving = tuple[V3, V3, V3]
"""A vector and its first two time derivatives."""


@compiled
def unit_moving(a: Moving) -> Moving:
    """The unit vector along ``a`` and its derivatives (Eq. 2 of the spec)."""
    n = norm(a[0])
    u = scale(1.0 / n, a[0])
    rate = dot(u, a[1])
    u1 = scale(1.0 / n, axpy(-rate, u, a[1]))
    second = dot(u1, a[1]) + dot(u, a[2])
    u2 = scale(1.0 / n, axpy(-2.0 * rate, u1, axpy(-second, u, a[2])))
    return u, u1, u2


@compiled
def cross_moving(a: Moving, b: Moving) -> Moving:
    """a x b and its derivatives."""
    first = add(cross(a[1], b[0]), cross(a[0], b[1]))
    second = add(axpy(2.0, cross(a[1], b[1]), cross(a[2], b[0])), cross(a[0], b[2]))
    return cross(a[0], b[0]), first, second


@compiled
def ahead(r: V3, v: V3, mu: float, dt: float) -> tuple[V3, V3]:
    """Position (m) and velocity (m/s) after a short ``dt`` (s) under the planet's pull, to third order in it."""
    k = -mu / norm(r) ** 3
    a = scale(k, r)
    jerk = scale(k, axpy(-3.0 * dot(r, v) / dot(r, r), r, v))
    r1 = axpy(dt, v, axpy(0.5 * dt * dt, a, axpy(dt * dt * dt / 6.0, jerk, r)))
    return r1, axpy(dt, a, axpy(0.5 * dt * dt, jerk, v))


@compiled
def turned(r_LE_E: V3, dcm_EN: M3, omega_EN: V3, dt: float) -> Moving:
    """A place fixed to the Earth, N components, ``dt`` (s) after ``dcm_EN`` holds, and its derivatives (Eq. 1)."""
    r = mat_t_vec(rotvec_to_dcm(scale(dt, omega_EN)), mat_t_vec(dcm_EN, r_LE_E))
    v = cross(omega_EN, r)
    return r, v, cross(omega_EN, v)


@compiled
def looking_frame(sight: Moving, normal: V3) -> tuple[M3, V3, V3]:
    """Rows: line of sight, orbit normal as near as it can be, across both; rate (rad/s) and its derivative (Eq. 3).

    Args:
        sight: from the spacecraft to the place, m, and derivatives, N components. normal: along r x v, constant.
    """
    fixed = (normal, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    one = unit_moving(sight)
    three = unit_moving(cross_moving(sight, fixed))
    two = cross_moving(three, one)
    omega, domega = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in (one, two, three):
        omega = axpy(0.5, cross(e[0], e[1]), omega)
        domega = axpy(0.5, cross(e[0], e[2]), domega)
    return (one[0], two[0], three[0]), omega, domega


@compiled
def up(lat: float, lon: float) -> V3:
    """Outward normal of the ellipsoid, E components."""
    return math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)


@compiled
def axes_of_body(axis_B: V3, beside_B: V3) -> M3:
    """Rows: the axis, the other one made square to it, and what completes them; unit vectors in B components."""
    one = scale(1.0 / norm(axis_B), axis_B)
    rest = axpy(-dot(one, beside_B), one, beside_B)
    two = scale(1.0 / norm(rest), rest)
    return one, two, cross(one, two)


@compiled
def difference(a: Moving, b: Moving) -> Moving:
    """a - b and its derivatives."""
    return sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2])
