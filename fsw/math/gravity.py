"""Gravity: point mass and zonal terms J2 to J6 of a central body, other bodies, and the torque of the gradient.

Constants of the Earth: EGM2008 (Pavlis, Holmes, Kenyon and Factor, 2012, J. Geophys. Res. 117, B04406), tide free.
Frames: a zonal field is that of a body whose pole is the z axis of the frame of ``r``.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, cross, dot, matvec, scale

Zonals: TypeAlias = tuple[float, float, float, float, float]
"""J2 to J6, not normalised."""

MU_EARTH = 3.986004415e14
"""Gravitational parameter of the Earth, m^3/s^2."""
RADIUS_EARTH = 6378136.3
"""Reference radius of the coefficients, m."""
J2_EARTH = 4.84165143790815e-4 * math.sqrt(5.0)
"""Zonal coefficient of degree 2, not normalised."""


@compiled
def gravity_acceleration(r: V3, mu: float, radius: float, j2: float) -> V3:
    """Acceleration, m/s^2, at ``r`` (m), in the frame of ``r``, whose z axis is the pole of the body.

    Vallado, "Fundamentals of Astrodynamics", 4th ed., sec. 8.7; ``j2`` = 0 gives the point mass of ``mu`` (m^3/s^2).
    """
    r2 = dot(r, r)
    k = mu / (r2 * math.sqrt(r2))
    c = 1.5 * j2 * (radius * radius / r2)
    z2 = 5.0 * r[2] * r[2] / r2
    a = -k * (1.0 + c * (1.0 - z2))
    return (a * r[0], a * r[1], -k * (1.0 + c * (3.0 - z2)) * r[2])


@compiled
def gravity_potential(r: V3, mu: float, radius: float, j2: float) -> float:
    """Potential energy of a unit mass at ``r``, J/kg; its negative gradient is `gravity_acceleration`."""
    r2 = dot(r, r)
    c = 0.5 * j2 * (radius * radius / r2)
    return -mu / math.sqrt(r2) * (1.0 - c * (3.0 * r[2] * r[2] / r2 - 1.0))


@compiled
def zonal_acceleration(r: V3, mu: float, radius: float, zonals: Zonals) -> V3:
    """Acceleration, m/s^2, of the point mass ``mu`` (m^3/s^2) with J2 to J6, at ``r`` (m); z is the pole.

    The gradient of ``mu/r (1 - sum J_n (R/r)^n P_n(z/r))``, Vallado eq. 8-25, with P_n by recursion.
    """
    r1 = math.sqrt(dot(r, r))
    u, q = r[2] / r1, radius / r1
    before, p, slope_before, slope = 1.0, u, 0.0, 1.0  # P_0, P_1 and their derivatives
    power, radial, polar = q, 1.0, 0.0
    for i in range(5):
        n = i + 2
        p, before = ((2 * n - 1) * u * p - (n - 1) * before) / n, p
        slope, slope_before = slope_before + (2 * n - 1) * before, slope
        power *= q
        radial -= (n + 1) * zonals[i] * power * p
        polar -= zonals[i] * power * slope
    k = mu / (r1 * r1)
    a = -k * (radial + u * polar) / r1
    return (a * r[0], a * r[1], a * r[2] + k * polar)


@compiled
def zonal_potential(r: V3, mu: float, radius: float, zonals: Zonals) -> float:
    """Potential energy of a unit mass at ``r``, J/kg; its negative gradient is `zonal_acceleration`."""
    r1 = math.sqrt(dot(r, r))
    u, q = r[2] / r1, radius / r1
    before, p = 1.0, u
    power, total = q, 1.0
    for i in range(5):
        n = i + 2
        p, before = ((2 * n - 1) * u * p - (n - 1) * before) / n, p
        power *= q
        total -= zonals[i] * power * p
    return -mu / r1 * total


@compiled
def third_body_acceleration(r: V3, body: V3, mu: float) -> V3:
    """Acceleration, m/s^2, of a satellite at ``r`` relative to its planet, by a body at ``body`` (m), ``mu`` (m^3/s^2).

    Battin's form, which does not lose digits when the body is far away: Battin, "An Introduction to the Mathematics
    and Methods of Astrodynamics", eq. 8.60 to 8.62.
    """
    d = (body[0] - r[0], body[1] - r[1], body[2] - r[2])
    q = (dot(r, r) - 2.0 * dot(r, body)) / dot(body, body)
    f = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) * math.sqrt(1.0 + q))
    k = -mu / (dot(d, d) * math.sqrt(dot(d, d)))
    return (k * (r[0] + f * body[0]), k * (r[1] + f * body[1]), k * (r[2] + f * body[2]))


@compiled
def gravity_gradient_torque(r_B: V3, mu: float, inertia: M3) -> V3:
    """Torque, N m, of a point mass ``mu`` (m^3/s^2) on a body of ``inertia`` (kg m^2) at ``r_B`` (m), all in B.

    Schaub and Junkins, "Analytical Mechanics of Space Systems", 4th ed., eq. 4.155.
    """
    r2 = dot(r_B, r_B)
    return scale(3.0 * mu / (r2 * r2 * math.sqrt(r2)), cross(r_B, matvec(inertia, r_B)))
