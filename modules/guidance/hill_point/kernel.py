"""The Hill frame of an orbit and its motion."""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, cross, dot, norm, scale, unit


@compiled
def hill_frame(r: V3, v: V3) -> tuple[M3, V3, V3]:
    """dcm_HN, omega_HN_N (rad/s) and its derivative (rad/s^2) of a position (m) and velocity (m/s) (Eq. 1 to 3).

    All is NaN if r and v are parallel or zero, for which there is no orbital plane.
    """
    radial, normal = unit(r), unit(cross(r, v))
    h, r2 = norm(cross(r, v)), dot(r, r)
    omega = scale(h / r2 if r2 > 0.0 else h, normal)
    domega = scale(-2.0 * dot(r, v) / r2 if r2 > 0.0 else h, omega)
    return (radial, cross(normal, radial), normal), omega, domega
