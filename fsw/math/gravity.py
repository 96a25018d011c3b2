"""Gravity of a central body: point mass and the zonal term J2, acceleration and potential.

Constants of the Earth: EGM2008 (Pavlis, Holmes, Kenyon and Factor, 2012, J. Geophys. Res. 117, B04406), tide free.
"""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.vectors import V3, dot

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
