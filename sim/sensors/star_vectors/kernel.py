"""The search for stars in a field of view."""

from __future__ import annotations

import math

from fsw import Row
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, dot, matvec, norm, store3, vec3
from messages.base import F64, I64
from sim.sensors.starlight import aberrated

SLOTS = 16
"""Most stars in a message."""
_MARGIN = 2e-4
"""Aberration moves no star further (rad)."""


@compiled
def find_stars(dcm_SN: M3, beta_N: V3, r_BN_N: V3, params: Row, star: I64, s_S: F64) -> int:
    """Write the brightest stars in view into ``star`` (16,) and ``s_S`` (16, 3), and return their number.

    Args:
        dcm_SN: attitude of the case.
        beta_N: velocity of the observer over that of light; zero for no aberration.
        r_BN_N: position [m]; the planet hides stars.
        params: parameters of the sensor.
        star: out, rows in the catalogue.
        s_S: out, unit vectors, S components.
    """
    near, inside = math.cos(params.fov + _MARGIN), math.cos(params.fov)
    r = norm(r_BN_N)
    hidden = -r * math.sqrt(1.0 - (params.radius / r) ** 2) if r > params.radius else -math.inf
    moving = dot(beta_N, beta_N) > 0.0
    count = 0
    for k in range(params.stars):
        if count >= SLOTS or params.magnitude[k] > params.limit:
            break
        u = vec3(params.s_N[k])
        if dot(u, dcm_SN[2]) < near or dot(u, r_BN_N) < hidden:
            continue
        s = matvec(dcm_SN, aberrated(u, beta_N) if moving else u)
        if s[2] >= inside:
            star[count] = params.star[k]
            store3(s_S[count], s)
            count += 1
    return count
