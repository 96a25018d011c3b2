"""The WGS84 ellipsoid: geodetic coordinates both ways, local axes, and where a ray meets a given height. Compiled.

Latitude and longitude in rad, heights in m above the ellipsoid, positions in m in Earth-fixed components (E).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fsw.math.compiled import compiled

if TYPE_CHECKING:
    from messages.base import F64

A = 6378137.0
"""Equatorial radius of WGS84 [m] (NIMA TR8350.2)."""
F = 1.0 / 298.257223563
"""Flattening of WGS84."""
B = A * (1.0 - F)
"""Polar radius [m]."""
E2 = F * (2.0 - F)
"""Eccentricity squared."""


@compiled
def ecef_from_geodetic(lat: float, lon: float, h: float) -> tuple[float, float, float]:
    """Earth-fixed position [m] of a latitude [rad], longitude [rad] and height [m]."""
    sin, cos = math.sin(lat), math.cos(lat)
    n = A / math.sqrt(1.0 - E2 * sin * sin)
    p = (n + h) * cos
    return p * math.cos(lon), p * math.sin(lon), (n * (1.0 - E2) + h) * sin


@compiled
def geodetic_from_ecef(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Latitude [rad], longitude [rad] and height [m] of an Earth-fixed position [m].

    Bowring's formula (Bowring 1976, eq. 12), repeated until the parametric latitude stands still. Good to rounding
    (below 1e-9 m near the Earth; at geostationary height the last digit of a height is 7e-9 m) from 5,000 km below the
    surface outwards; at the poles the longitude is that of `atan2`. NaN deeper than that.
    """
    p = math.sqrt(x * x + y * y)
    if not math.sqrt(p * p + z * z) > 1.3e6:
        return math.nan, math.nan, math.nan
    sb, cb = z * A, p * B  # of the parametric latitude, up to a factor
    lat = 0.0
    for _ in range(10):
        norm = math.sqrt(sb * sb + cb * cb)
        sb, cb = sb / norm, cb / norm
        up = z + E2 / (1.0 - F) * A * sb * sb * sb
        out = p - E2 * A * cb * cb * cb
        before, lat = lat, math.atan2(up, out)
        if math.fabs(lat - before) < 1e-17:
            break
        sb, cb = (1.0 - F) * up, out
    sin, cos = math.sin(lat), math.cos(lat)
    h = p * cos + z * sin - A * math.sqrt(1.0 - E2 * sin * sin)
    return lat, math.atan2(y, x), h


@compiled
def enu_dcm(lat: float, lon: float, out: F64) -> None:
    """Into ``out`` (3, 3): maps Earth-fixed to east, north, up components at a latitude and longitude [rad]."""
    sp, cp, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    out[0, 0], out[0, 1], out[0, 2] = -sl, cl, 0.0
    out[1, 0], out[1, 1], out[1, 2] = -sp * cl, -sp * sl, cp
    out[2, 0], out[2, 1], out[2, 2] = cp * cl, cp * sl, sp


@compiled
def ned_dcm(lat: float, lon: float, out: F64) -> None:
    """Into ``out`` (3, 3): maps Earth-fixed to north, east, down components at a latitude and longitude [rad]."""
    sp, cp, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    out[0, 0], out[0, 1], out[0, 2] = -sp * cl, -sp * sl, cp
    out[1, 0], out[1, 1], out[1, 2] = -sl, cl, 0.0
    out[2, 0], out[2, 1], out[2, 2] = -cp * cl, -cp * sl, -sp


@compiled
def ray_to_spheroid(x: float, y: float, z: float, dx: float, dy: float, dz: float, grow: float) -> float:
    """Distance along a ray to the spheroid with semi-axes A + grow, B + grow, first crossing; NaN if it misses.

    Args:
        x: start of the ray, Earth-fixed [m]; y, z: likewise.
        y: second component.
        z: third component.
        dx: direction, Earth-fixed, unit length; dy, dz: likewise.
        dy: second component.
        dz: third component.
        grow: added to both semi-axes [m].
    """
    a, b = A + grow, B + grow
    x, y, z = x / a, y / a, z / b
    dx, dy, dz = dx / a, dy / a, dz / b
    dd = dx * dx + dy * dy + dz * dz
    rd = x * dx + y * dy + z * dz
    rr = x * x + y * y + z * z - 1.0
    # the square of rr * dd - rd^2, by the closest point of the line: no cancellation far away
    t = -rd / dd
    px, py, pz = x + t * dx, y + t * dy, z + t * dz
    room = (1.0 - (px * px + py * py + pz * pz)) / dd
    if not room >= 0.0:
        return math.nan
    if rr < 0.0 or rd >= 0.0:
        return math.nan
    return t - math.sqrt(room)


@compiled
def ray_to_height(
    x: float, y: float, z: float, dx: float, dy: float, dz: float, h: float
) -> tuple[float, float, float]:
    """Where a ray first comes down to a geodetic height.

    Args:
        x: start of the ray, Earth-fixed [m], above the height; y, z: likewise.
        y: second component.
        z: third component.
        dx: direction, Earth-fixed, unit length; dy, dz: likewise.
        dy: second component.
        dz: third component.
        h: height above the ellipsoid [m].

    Returns:
        Latitude [rad], longitude [rad] and distance along the ray [m]; NaN if the ray misses, leads away, or starts
        below the height.
    """
    # Surfaces of constant height are not spheroids, but nearly: correct the semi-axes by the difference
    grow = h
    lat, lon, distance = math.nan, math.nan, math.nan
    for _ in range(4):
        distance = ray_to_spheroid(x, y, z, dx, dy, dz, grow)
        if not distance >= 0.0:
            return math.nan, math.nan, math.nan
        lat, lon, reached = geodetic_from_ecef(x + distance * dx, y + distance * dy, z + distance * dz)
        if math.fabs(h - reached) < 1e-9:
            break
        grow += h - reached
    return lat, lon, distance
