"""Rays that end on terrain, and how its slopes are lit. Compiled, one band of rows a call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fsw.imaging.maps import HeightGrid
from fsw.math.compiled import compiled
from fsw.math.geodesy import E2, A, B, F, ray_to_spheroid
from fsw.math.vectors import V3
from messages.base import F64
from sim.camera.earth_camera.kernel import F32, arctan2

MAX_STEPS = 96
"""Most steps of a ray between the highest and the lowest terrain."""


class Terrain(NamedTuple):
    """Heights with their slopes."""

    relief: F64
    """(rows, columns, 3): height [m], and how it rises to the east and to the north."""
    frame: F64
    """Latitude of row 0 [rad], rows per radian, longitude of column 0, columns per radian (4,)."""
    low: float
    """Lowest height [m], 0 at most."""
    high: float
    """Greatest height [m], 0 at least."""
    cell: float
    """Side of a cell [m]."""


def terrain_of(grid: HeightGrid) -> Terrain:
    """Heights as rays need them."""
    h = grid.heights
    lat: F64 = grid.lat0 + grid.dlat * np.arange(h.shape[0], dtype=np.float64)
    per_east = 1.0 / (A * abs(grid.dlon) * np.maximum(np.cos(lat), 0.01))[:, None]
    east = np.gradient(h, axis=1) * per_east * np.sign(grid.dlon)
    north = np.gradient(h, axis=0) / (A * grid.dlat)
    frame = np.array([grid.lat0, 1.0 / grid.dlat, grid.lon0, 1.0 / grid.dlon])
    return Terrain(
        np.ascontiguousarray(np.dstack([h, east, north])),
        frame,
        min(float(h.min()), 0.0),
        max(float(h.max()), 0.0),
        A * abs(grid.dlat),
    )


@compiled
def geodetic_near(x: float, y: float, z: float) -> V3:
    """Latitude [rad], longitude [rad] and height [m] of a place near the ground: one step of Bowring's formula.

    Good to 1e-12 rad within 100 km of the ellipsoid (Bowring 1976, eq. 12).
    """
    p = math.sqrt(x * x + y * y)
    sb, cb = z * A, p * B
    per = 1.0 / math.sqrt(sb * sb + cb * cb)
    sb, cb = sb * per, cb * per
    up = z + E2 / (1.0 - F) * A * sb * sb * sb
    out = p - E2 * A * cb * cb * cb
    per = 1.0 / math.sqrt(up * up + out * out)
    sin, cos = up * per, out * per
    return arctan2(up, out), arctan2(y, x), p * cos + z * sin - A * math.sqrt(1.0 - E2 * sin * sin)


@compiled
def relief_at(relief: F64, frame: F64, lat: float, lon: float) -> V3:
    """Height and slopes at a place, bilinear; sea level beyond the grid."""
    y, x = (lat - frame[0]) * frame[1], (lon - frame[2]) * frame[3]
    turn = 2.0 * math.pi * math.fabs(frame[3])
    x -= turn * math.floor(x / turn + 0.5) if not 0.0 <= x <= relief.shape[1] - 1.0 else 0.0
    x += turn if x < 0.0 and x + turn <= relief.shape[1] - 1.0 else 0.0
    if not (y >= 0.0 and y <= relief.shape[0] - 1.0 and x >= 0.0 and x <= relief.shape[1] - 1.0):
        return 0.0, 0.0, 0.0
    i, j = min(int(y), relief.shape[0] - 2), min(int(x), relief.shape[1] - 2)
    y, x = y - i, x - j
    a, b, c, d = (1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y
    return (
        a * relief[i, j, 0] + b * relief[i, j + 1, 0] + c * relief[i + 1, j, 0] + d * relief[i + 1, j + 1, 0],
        a * relief[i, j, 1] + b * relief[i, j + 1, 1] + c * relief[i + 1, j, 1] + d * relief[i + 1, j + 1, 1],
        a * relief[i, j, 2] + b * relief[i, j + 1, 2] + c * relief[i + 1, j, 2] + d * relief[i + 1, j + 1, 2],
    )


@compiled
def above(r: V3, d: V3, t: float, relief: F64, frame: F64) -> float:
    """Height of a point of a ray above the terrain [m]."""
    lat, lon, h = geodetic_near(r[0] + t * d[0], r[1] + t * d[1], r[2] + t * d[2])
    return h - relief_at(relief, frame, lat, lon)[0]


@compiled
def march(r: V3, d: V3, relief: F64, frame: F64, low: float, high: float, cell: float) -> float:
    """Distance along a ray to the terrain; NaN if it passes.

    Steps of about a cell from the greatest height down find the first cell in which the ray goes under ground; there
    a secant between two ends on different sides (the Illinois rule) finds where.

    Args:
        r: start of the ray, Earth-fixed [m].
        d: direction, unit length.
        relief: as of `Terrain`; the others likewise.
        frame: see there.
        low: see there.
        high: see there.
        cell: see there.
    """
    inside = (r[0] * r[0] + r[1] * r[1]) / (A + high + 9.0) ** 2 + r[2] * r[2] / (B + high + 9.0) ** 2 < 1.0
    start = 0.0 if inside else ray_to_spheroid(r[0], r[1], r[2], d[0], d[1], d[2], high + 9.0)
    if math.isnan(start):
        return math.nan
    end = ray_to_spheroid(r[0], r[1], r[2], d[0], d[1], d[2], low - 9.0)
    if math.isnan(end):  # a grazing ray: as far as it stays below the greatest height
        closest = -(r[0] * d[0] + r[1] * d[1] + r[2] * d[2])
        end = max(2.0 * closest - start, start)
    length, drop = end - start, high - low + 18.0
    across = math.sqrt(max(length * length - drop * drop, 0.0))
    steps = min(max(int(across / cell) + 1, 1), MAX_STEPS)
    t, f = start, above(r, d, start, relief, frame)
    for k in range(steps):
        far = start + length * (k + 1) / steps
        g = above(r, d, far, relief, frame)
        if g <= 0.0:
            return _between(r, d, t, f, far, g, relief, frame)
        t, f = far, g
    return math.nan


@compiled
def _between(r: V3, d: V3, a: float, fa: float, b: float, fb: float, relief: F64, frame: F64) -> float:
    side = 0
    for _ in range(30):
        t = (fa * b - fb * a) / (fa - fb)
        f = above(r, d, t, relief, frame)
        if math.fabs(f) < 1e-3 or b - a < 1e-3:
            return t
        if f > 0.0:
            a, fa = t, f
            fb = 0.5 * fb if side == 1 else fb
            side = 1
        else:
            b, fb = t, f
            fa = 0.5 * fa if side == -1 else fa
            side = -1
    return 0.5 * (a + b)


@compiled
def terrain_band(
    x_tan: F64, y_tan: F64, first: int, step: int, r_E: F64, dcm_CE: F64, sun_E: F64,
    relief: F64, frame: F64, low: float, high: float, cell: float, lat: F64, lon: F64, light: F32,
) -> None:  # fmt: skip
    """Move the places of a band of rays from the ellipsoid onto terrain, and light its slopes.

    Arguments as of `kernel.ground_band`, which runs before, and of `Terrain`. Rays that pass the ellipsoid and all
    mountains stay as they are.
    """
    for i in range(x_tan.shape[0]):
        k = min(first + i * step, r_E.shape[0] - 1)
        r = (r_E[k, 0], r_E[k, 1], r_E[k, 2])
        for j in range(x_tan.shape[1]):
            u, v = x_tan[i, j], y_tan[i, j]
            if math.isnan(u):
                continue
            per = 1.0 / math.sqrt(u * u + v * v + 1.0)
            d = (
                per * (dcm_CE[k, 0, 0] * u + dcm_CE[k, 1, 0] * v + dcm_CE[k, 2, 0]),
                per * (dcm_CE[k, 0, 1] * u + dcm_CE[k, 1, 1] * v + dcm_CE[k, 2, 1]),
                per * (dcm_CE[k, 0, 2] * u + dcm_CE[k, 1, 2] * v + dcm_CE[k, 2, 2]),
            )
            t = march(r, d, relief, frame, low, high, cell)
            if math.isnan(t):
                continue
            place = geodetic_near(r[0] + t * d[0], r[1] + t * d[1], r[2] + t * d[2])
            lat[i, j], lon[i, j] = place[0], place[1]
            _, east, north = relief_at(relief, frame, place[0], place[1])
            sp, cp, sl, cl = math.sin(place[0]), math.cos(place[0]), math.sin(place[1]), math.cos(place[1])
            to_east = -sl * sun_E[0] + cl * sun_E[1]
            to_north = -sp * cl * sun_E[0] - sp * sl * sun_E[1] + cp * sun_E[2]
            to_up = cp * cl * sun_E[0] + cp * sl * sun_E[1] + sp * sun_E[2]
            lit = (to_up - east * to_east - north * to_north) / math.sqrt(1.0 + east * east + north * north)
            light[i, j] = lit if lit > 0.0 and to_up > 0.0 else 0.0
