"""Light on a photocell: direct from the Sun, and thrown back by the planet."""

from __future__ import annotations

import math

from fsw import Row
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, dot, norm


@compiled
def earthshine(r_BN_N: V3, sun_N: V3, radius: float, albedo: float) -> float:
    """Irradiance on a cell that faces the planet, in units of the Sun's (spec, Eq. 3).

    Args:
        r_BN_N: position of the spacecraft [m].
        sun_N: unit vector from the planet to the Sun.
        radius: of the planet [m].
        albedo: part of the light thrown back, 0 to 1.
    """
    r = norm(r_BN_N)
    if albedo == 0.0:
        return 0.0
    return albedo * (radius / r) ** 2 * max(0.0, dot(r_BN_N, sun_N) / r)


@compiled
def cell(n_B: V3, sun_B: V3, light: float, nadir_B: V3, shine: float, params: Row) -> float:
    """Current of one cell without its own errors (spec, Eq. 1 and 2).

    Args:
        n_B: normal of the cell, unit vector.
        sun_B: unit vector to the Sun.
        light: irradiance of the Sun, 1 at 1 au.
        nadir_B: unit vector to the planet.
        shine: irradiance of the planet on a cell that faces it.
        params: parameters of the array.
    """
    direct, cosine = 0.0, dot(n_B, sun_B)
    if cosine >= math.cos(params.fov):
        direct = cosine * light
        if params.kelly_factor > 0.0 and cosine > 0.0:
            direct *= -math.expm1(-(cosine**params.kelly_power) / params.kelly_factor)
    return direct + shine * max(0.0, dot(n_B, nadir_B))
