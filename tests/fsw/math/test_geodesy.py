"""WGS84 against ERFA and mpmath."""

from __future__ import annotations

import math
from typing import Any

import erfa
import mpmath
import numpy as np
import pytest

from fsw.math import geodesy
from messages.base import F64

ERFA: Any = erfa
MPMATH: Any = mpmath
PLACES = [
    (0.0, 0.0, 0.0),
    (0.7, 0.9, 0.0),
    (-0.7, -2.9, 420e3),
    (math.pi / 2, 0.3, 100.0),
    (-math.pi / 2, 0.0, 420e3),
    (math.pi / 2 - 1e-9, 1.0, 8000.0),
    (1e-12, 3.1, -400.0),
    (0.4, 0.1, -11e3),
    (1.2, -1.0, 2000e3),
]
GEOSTATIONARY = [(0.0, 1.0, 35_786e3), (0.6, 1.0, 35_786e3), (-1.5, 1.0, 35_786e3)]


@pytest.mark.parametrize("place", PLACES + GEOSTATIONARY)
def test_positions_are_those_of_erfa(place: tuple[float, float, float]) -> None:
    lat, lon, h = place
    mine = np.array(geodesy.ecef_from_geodetic(lat, lon, h))
    # 1e-9 m is the last bit near the Earth; farther out the last bit is larger
    np.testing.assert_allclose(mine, ERFA.gd2gc(1, lon, lat, h), rtol=2.3e-16, atol=1e-9)


@pytest.mark.parametrize("place", PLACES + GEOSTATIONARY)
def test_geodetic_coordinates_are_those_of_mpmath(place: tuple[float, float, float]) -> None:
    with MPMATH.workdps(40):
        x, y, z = (MPMATH.mpf(c) for c in exact_position(*place))
        # the exact position rounded to doubles is the input; solve for its exact coordinates
        start = [float(x), float(y), float(z)]
        lat, h = exact_inverse(start[0], start[1], start[2], place)
        mine = geodesy.geodetic_from_ecef(start[0], start[1], start[2])
        radius = math.sqrt(sum(c * c for c in start))
        assert abs(mine[0] - lat) * radius < 1e-9 + 2.3e-16 * radius
        assert abs(mine[2] - h) < 1e-9 + 2.3e-16 * radius
    if abs(place[0]) < 1.57:
        assert abs(mine[1] - place[1]) < 1e-15 * 4


def exact_position(lat: float, lon: float, h: float) -> tuple[Any, Any, Any]:
    e2 = MPMATH.mpf(1) / MPMATH.mpf("298.257223563")
    e2 = e2 * (2 - e2)
    n = 6378137 / MPMATH.sqrt(1 - e2 * MPMATH.sin(lat) ** 2)
    p = (n + h) * MPMATH.cos(lat)
    return p * MPMATH.cos(lon), p * MPMATH.sin(lon), (n * (1 - e2) + h) * MPMATH.sin(lat)


def exact_inverse(x: float, y: float, z: float, near: tuple[float, float, float]) -> tuple[Any, Any]:
    """Latitude and height by Newton's method on the two meridian equations, 40 digits."""
    p = MPMATH.sqrt(MPMATH.mpf(x) ** 2 + MPMATH.mpf(y) ** 2)

    def equations(lat: Any, h: Any) -> list[Any]:
        px, _, pz = exact_position(lat, 0, h)
        return [px - p, pz - z]

    lat, h = MPMATH.findroot(equations, (near[0], near[2]), tol=1e-40)
    return lat, h


def test_deep_inside_is_refused() -> None:
    assert all(math.isnan(v) for v in geodesy.geodetic_from_ecef(1e5, 0.0, 1e5))
    assert all(math.isnan(v) for v in geodesy.geodetic_from_ecef(math.nan, 0.0, 7e6))


def test_local_axes() -> None:
    lat, lon, step = 0.6, -2.0, 1e-6
    enu, ned = np.empty((3, 3)), np.empty((3, 3))
    geodesy.enu_dcm(lat, lon, enu)
    geodesy.ned_dcm(lat, lon, ned)
    here = np.array(geodesy.ecef_from_geodetic(lat, lon, 0.0))
    for row, moved in enumerate([(lat, lon + step, 0.0), (lat + step, lon, 0.0), (lat, lon, 10.0)]):
        way = np.array(geodesy.ecef_from_geodetic(*moved)) - here
        np.testing.assert_allclose(enu[row], way / np.linalg.norm(way), atol=1e-6)
    np.testing.assert_allclose(enu @ enu.T, np.eye(3), atol=4e-16)
    np.testing.assert_array_equal(ned, np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ enu)


def rays(n: int = 200) -> tuple[F64, F64]:
    rng = np.random.default_rng(2)
    start = rng.normal(size=(n, 3))
    start *= rng.uniform(6.8e6, 4.2e7, (n, 1)) / np.linalg.norm(start, axis=1)[:, None]
    target = rng.normal(size=(n, 3))
    target *= 6.0e6 / np.linalg.norm(target, axis=1)[:, None]
    way = target - start
    return start, way / np.linalg.norm(way, axis=1)[:, None]


@pytest.mark.parametrize("h", [0.0, 8848.0, -400.0, 100e3])
def test_rays_end_at_the_height(h: float) -> None:
    for start, way in zip(*rays(), strict=True):
        lat, lon, distance = geodesy.ray_to_height(start[0], start[1], start[2], way[0], way[1], way[2], h)
        there = start + distance * way
        lon_e, lat_e, h_e = ERFA.gc2gd(1, there)
        assert abs(h_e - h) < 1e-7  # the last bits of positions of 4e7 m, at slanting rays
        assert abs(lat - lat_e) < 1e-14
        assert abs(lon - lon_e) < 1e-13
        # the first crossing: half-way there the ray is still above
        assert ERFA.gc2gd(1, start + 0.5 * distance * way)[2] > h


def test_rays_that_miss_are_refused() -> None:
    up = geodesy.ray_to_height(7e6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    past = geodesy.ray_to_height(7e6, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    below = geodesy.ray_to_height(6.37e6, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    assert all(math.isnan(v) for answer in (up, past, below) for v in answer)
