"""From pixels back to the ground: directions and places, plainly. Lens distortion is always taken out."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.geodesy import ecef_from_geodetic, geodetic_from_ecef, ray_to_height
from fsw.math.view_geometry import pixel_ray
from messages.base import F64


def unit_vectors(lens: F64, pixel: F64) -> F64:
    """Unit vectors (n, 3), camera components, of what pixels (n, 2) (column, row) see; NaN beyond the lens's range.

    Args:
        lens: lens vector of `fsw.math.camera` (11,).
        pixel: (n, 2) [px], distorted, as seen.
    """
    return np.array([pixel_ray(lens, u, v) for u, v in np.asarray(pixel, float).tolist()]).reshape(-1, 3)


def ground_points(lens: F64, r_CE_E: F64, dcm_CE: F64, pixel: F64, h: float = 0.0) -> F64:
    """Latitude, longitude [rad] and distance [m] (n, 3) of the ground at a height that pixels see; NaN if none.

    Args:
        lens: lens vector (11,).
        r_CE_E: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: maps Earth-fixed to camera components (3, 3).
        pixel: (n, 2) [px].
        h: geodetic height of the ground [m].
    """
    x, y, z = (float(c) for c in r_CE_E)
    rays: F64 = unit_vectors(lens, pixel) @ dcm_CE
    places = [ray_to_height(x, y, z, dx, dy, dz, h) for dx, dy, dz in rays.tolist()]
    return np.array(places).reshape(-1, 3)


def looking_down(lat: float, lon: float, height: float, heading: float, off_nadir: float = 0.0) -> tuple[F64, F64]:
    """A camera over a place: position (3,) [m] and dcm_CE (3, 3).

    Args:
        lat: geodetic latitude of the camera [rad].
        lon: its longitude [rad].
        height: above the ellipsoid [m].
        heading: azimuth of the top of the image, from north by east [rad].
        off_nadir: angle from the vertical to the boresight, towards the top of the image [rad].
    """
    sp, cp, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    east, north = np.array([-sl, cl, 0.0]), np.array([-sp * cl, -sp * sl, cp])
    down = -np.array([cp * cl, cp * sl, sp])
    top = math.sin(heading) * east + math.cos(heading) * north
    right = np.cross(top, -down)
    boresight = math.cos(off_nadir) * down + math.sin(off_nadir) * top
    return np.array(ecef_from_geodetic(lat, lon, height)), np.vstack([right, np.cross(boresight, right), boresight])


def angles(r_CE_E: F64, dcm_CE: F64) -> tuple[float, float, float, float, float]:
    """Latitude, longitude [rad], height [m], off-nadir angle and heading [rad] of a camera; see `looking_down`."""
    lat, lon, height = geodetic_from_ecef(*(float(c) for c in r_CE_E))
    sp, cp, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    up = np.array([cp * cl, cp * sl, sp])
    east, north = np.array([-sl, cl, 0.0]), np.array([-sp * cl, -sp * sl, cp])
    top = -dcm_CE[1]
    off = math.atan2(float(np.linalg.norm(np.cross(dcm_CE[2], -up))), float(-up @ dcm_CE[2]))
    return lat, lon, height, off, math.atan2(float(top @ east), float(top @ north)) % (2.0 * math.pi)
