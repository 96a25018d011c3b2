"""Frames that an orbit carries, with their rates: Hill (H) and local vertical, local horizontal (O). Compiled.

H: x radial, y along the track, z along h = r x v. O: z to nadir, y against h, x along the track. r and v are relative
to the centre of the body, inertial, components of N: m and m/s. All functions give NaN if r and v are parallel, where
there is no plane of the orbit. Frames of a place on the Earth (east-north-up, north-east-down) are in `geodesy`.
Source: Schaub and Junkins, "Analytical Mechanics of Space Systems", 4th ed., sec. 14.3.
"""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, cross, dot, mat_t_vec, matvec, norm, scale, sub, unit

PARALLEL = 1e-12
"""r and v are parallel if the sine of their angle is below this."""


@compiled
def hill_frame(r_BN_N: V3, v_BN_N: V3) -> M3:
    """dcm_HN: rows radial, along track, orbit normal."""
    h = cross(r_BN_N, v_BN_N)
    if not norm(h) > PARALLEL * norm(r_BN_N) * norm(v_BN_N):
        nan = (math.nan, math.nan, math.nan)
        return (nan, nan, nan)
    x, z = unit(r_BN_N), unit(h)
    return (x, cross(z, x), z)


@compiled
def orbit_frame(r_BN_N: V3, v_BN_N: V3) -> M3:
    """dcm_ON: rows along track, minus orbit normal, nadir."""
    x, y, z = hill_frame(r_BN_N, v_BN_N)
    return (y, scale(-1.0, z), scale(-1.0, x))


@compiled
def hill_rate(r_BN_N: V3, v_BN_N: V3, a_BN_N: V3) -> V3:
    """omega_HN_H, rad/s, for an acceleration of any cause, m/s^2.

    On an orbit with gravity towards the centre only it is (0, 0, h / r^2); a push along the normal also turns H about
    the radius.
    """
    h = cross(r_BN_N, v_BN_N)
    size, r = norm(h), norm(r_BN_N)
    if not size > PARALLEL * r * norm(v_BN_N):
        return (math.nan, math.nan, math.nan)
    return (r * dot(h, a_BN_N) / (size * size), 0.0, size / (r * r))


@compiled
def orbit_rate(r_BN_N: V3, v_BN_N: V3) -> V3:
    """omega_ON_O = (0, -h / r^2, 0), rad/s, under gravity towards the centre only."""
    rate = hill_rate(r_BN_N, v_BN_N, (0.0, 0.0, 0.0))
    return (0.0, -rate[2], 0.0)


@compiled
def orbit_rate_derivative(r_BN_N: V3, v_BN_N: V3) -> V3:
    """Time derivative of `orbit_rate`, O components, rad/s^2: (0, 2 h (r.v) / r^4, 0)."""
    rate = orbit_rate(r_BN_N, v_BN_N)
    return (0.0, -2.0 * rate[1] * dot(r_BN_N, v_BN_N) / dot(r_BN_N, r_BN_N), 0.0)


@compiled
def to_hill(r_CN_N: V3, v_CN_N: V3, r_DN_N: V3, v_DN_N: V3) -> tuple[V3, V3]:
    """Position and velocity of a deputy D relative to a chief C as seen in the chief's turning frame H, m and m/s."""
    dcm_HN = hill_frame(r_CN_N, v_CN_N)
    omega_N = mat_t_vec(dcm_HN, hill_rate(r_CN_N, v_CN_N, (0.0, 0.0, 0.0)))
    r = sub(r_DN_N, r_CN_N)
    return matvec(dcm_HN, r), matvec(dcm_HN, sub(sub(v_DN_N, v_CN_N), cross(omega_N, r)))


@compiled
def from_hill(r_CN_N: V3, v_CN_N: V3, r_DC_H: V3, v_DC_H: V3) -> tuple[V3, V3]:
    """Inertial position and velocity of a deputy, m and m/s: the inverse of `to_hill`."""
    dcm_HN = hill_frame(r_CN_N, v_CN_N)
    omega_H = hill_rate(r_CN_N, v_CN_N, (0.0, 0.0, 0.0))
    v = mat_t_vec(dcm_HN, add(v_DC_H, cross(omega_H, r_DC_H)))
    return add(r_CN_N, mat_t_vec(dcm_HN, r_DC_H)), add(v_CN_N, v)
