"""The ground that a pixel sees, with relief, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fsw.math.camera import undistort_point
from fsw.math.compiled import compiled
from fsw.math.geodesy import ecef_from_geodetic, geodetic_from_ecef, ray_to_spheroid

if TYPE_CHECKING:
    from messages.base import F64

RELIEF_ROUNDS = 12
RELIEF_TOLERANCE = 0.5
"""Height error at which the search for the ground along a ray stops [m]: a thousandth of a usual pixel."""


@compiled
def height_at(heights: F64, lat0: float, lon0: float, dlat: float, dlon: float, lat: float, lon: float) -> float:
    """Bilinear height [m] at a latitude and longitude [rad] of a `HeightGrid`; NaN beyond its edge."""
    rows, columns = heights.shape
    middle = 0.5 * dlon * (columns - 1)
    offset = lon - lon0 - middle
    offset -= 2.0 * math.pi * math.floor(offset / (2.0 * math.pi) + 0.5)
    x, y = (offset + middle) / dlon, (lat - lat0) / dlat
    if not (-0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
        return math.nan
    x, y = min(max(x, 0.0), columns - 1.0), min(max(y, 0.0), rows - 1.0)
    i, j = min(int(y), rows - 2), min(int(x), columns - 2)
    a, b = y - i, x - j
    low = heights[i, j] * (1.0 - b) + heights[i, j + 1] * b
    high = heights[i + 1, j] * (1.0 - b) + heights[i + 1, j + 1] * b
    return low * (1.0 - a) + high * a


@compiled
def ground_point(
    lens: F64,
    r_CE_E: F64,
    dcm_CE: F64,
    u: float,
    v: float,
    heights: F64,
    lat0: float,
    lon0: float,
    dlat: float,
    dlon: float,
) -> tuple[float, float, float]:
    """Latitude, longitude [rad] and height [m] of the ground that pixel (u, v) sees.

    The ray is cut with a spheroid, the spheroid is grown by the difference between the height of the terrain there
    and the height reached, and so on (study of the method: Sheng 2005, "Theoretical analysis of the iterative
    photogrammetric method"). NaN if the ray misses the Earth, or leaves the height grid, or does not settle.
    """
    x, y = undistort_point(lens, u, v)
    norm = math.sqrt(x * x + y * y + 1.0)
    dx = (dcm_CE[0, 0] * x + dcm_CE[1, 0] * y + dcm_CE[2, 0]) / norm
    dy = (dcm_CE[0, 1] * x + dcm_CE[1, 1] * y + dcm_CE[2, 1]) / norm
    dz = (dcm_CE[0, 2] * x + dcm_CE[1, 2] * y + dcm_CE[2, 2]) / norm
    grow = 0.0
    for _ in range(RELIEF_ROUNDS):
        t = ray_to_spheroid(r_CE_E[0], r_CE_E[1], r_CE_E[2], dx, dy, dz, grow)
        if not t >= 0.0:
            return math.nan, math.nan, math.nan
        lat, lon, reached = geodetic_from_ecef(r_CE_E[0] + t * dx, r_CE_E[1] + t * dy, r_CE_E[2] + t * dz)
        error = height_at(heights, lat0, lon0, dlat, dlon, lat, lon) - reached
        if math.fabs(error) < RELIEF_TOLERANCE:
            return lat, lon, reached
        grow += error
    return math.nan, math.nan, math.nan


@compiled
def ground_grid(
    lens: F64,
    r_CE_E: F64,
    dcm_CE: F64,
    step: int,
    heights: F64,
    lat0: float,
    lon0: float,
    dlat: float,
    dlon: float,
    lat: F64,
    lon: F64,
    h: F64,
) -> None:
    """`ground_point` for every ``step``-th pixel, into ``lat``, ``lon`` [rad] and ``h`` [m], each (rows, columns)."""
    for i in range(lat.shape[0]):
        for j in range(lat.shape[1]):
            lat[i, j], lon[i, j], h[i, j] = ground_point(
                lens, r_CE_E, dcm_CE, j * float(step), i * float(step), heights, lat0, lon0, dlat, dlon
            )


@compiled
def spread(nodes: F64, step: int, out: F64) -> None:
    """Bilinear values at every pixel, into ``out``, from ``nodes`` at every ``step``-th; NaN spreads to its cell."""
    for i in range(out.shape[0]):
        k, a = i // step, (i % step) / step
        for j in range(out.shape[1]):
            m, b = j // step, (j % step) / step
            low = nodes[k, m] * (1.0 - b) + nodes[k, m + 1] * b
            high = nodes[k + 1, m] * (1.0 - b) + nodes[k + 1, m + 1] * b
            out[i, j] = low * (1.0 - a) + high * a


@compiled
def ground_at(lat: F64, lon: F64, h: F64, step: int, pixel: F64, out: F64) -> None:
    """Earth-fixed ground (n, 3) [m] at pixels (n, 2), into ``out``: bilinear between the nodes of `ground_grid`.

    The chord's depth below the Earth's curve is some centimetres. NaN outside the grid or off the Earth.
    """
    rows, columns = lat.shape
    for n in range(pixel.shape[0]):
        x, y = pixel[n, 0] / step, pixel[n, 1] / step
        out[n, 0], out[n, 1], out[n, 2] = math.nan, math.nan, math.nan
        if not (0.0 <= x <= columns - 1.0 and 0.0 <= y <= rows - 1.0):
            continue
        i, j = min(int(y), rows - 2), min(int(x), columns - 2)
        a, b = y - i, x - j
        total_x, total_y, total_z = 0.0, 0.0, 0.0
        for k in range(4):
            row, column = i + k // 2, j + k % 2
            weight = (a if k >= 2 else 1.0 - a) * (b if k % 2 == 1 else 1.0 - b)
            px, py, pz = ecef_from_geodetic(lat[row, column], lon[row, column], h[row, column])
            total_x, total_y, total_z = total_x + weight * px, total_y + weight * py, total_z + weight * pz
        out[n, 0], out[n, 1], out[n, 2] = total_x, total_y, total_z
