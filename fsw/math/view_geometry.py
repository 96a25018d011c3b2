"""What a camera sees of the Earth: field of view, size of a pixel on the ground, footprint. Compiled where it counts.

Angles in rad, lengths in m, pixels as everywhere: the middle of the first one is (0, 0), so the image ends half a pixel
farther out. Lenses are those of `fsw.math.camera`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fsw.math.camera import distort_slopes, lens_vector, undistort_point
from fsw.math.compiled import compiled
from fsw.math.geodesy import ray_to_height
from fsw.math.vectors import M3, V3, axpy, dot, mat_t_vec, scale

if TYPE_CHECKING:
    from messages.base import F64
    from messages.opnav import CameraConfigMsg


@compiled
def pixel_ray(lens: F64, u: float, v: float) -> V3:
    """Unit vector, camera components, of what a pixel (column, row) sees; NaN if the lens has no direction for it."""
    x, y = undistort_point(lens, u, v)
    norm = math.sqrt(x * x + y * y + 1.0)
    return x / norm, y / norm, 1.0 / norm


def field_of_view(camera: CameraConfigMsg) -> tuple[float, float, float]:
    """Angles between opposite edges of the image, distortion included.

    Returns:
        From the left edge to the right one (in the middle row), from the top to the bottom (in the middle column), and
        from corner to corner (top left to bottom right) [rad]; NaN where the lens has no direction for an end.
    """
    lens = lens_vector(camera)
    right, bottom = camera.width_px - 0.5, camera.height_px - 0.5
    x, y = (camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0
    return (
        _angle(pixel_ray(lens, -0.5, y), pixel_ray(lens, right, y)),
        _angle(pixel_ray(lens, x, -0.5), pixel_ray(lens, x, bottom)),
        _angle(pixel_ray(lens, -0.5, -0.5), pixel_ray(lens, right, bottom)),
    )


def _angle(a: V3, b: V3) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


@compiled
def north_up(lat: float, lon: float) -> M3:
    """dcm_CE of a camera that looks down the vertical at a geodetic place, north up, hence east right."""
    sp, cp, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    return (-sl, cl, 0.0), (sp * cl, sp * sl, -cp), (-cp * cl, -cp * sl, -sp)


@compiled
def ground_sample(lens: F64, r_CE_E: V3, dcm_CE: M3, u: float, v: float, h: float) -> tuple[float, float, float, float]:
    """Size of a pixel on the ground, by the derivative of the place that it sees.

    In the middle of the image of a camera with square pixels and without distortion these are ``p d / (f cos i)`` and
    ``p d / f`` with the pitch p, the focal length f, the distance d and the angle of incidence i.

    Args:
        lens: lens vector (11,).
        r_CE_E: position of the camera, Earth-fixed [m].
        dcm_CE: its attitude relative to E.
        u: column of the pixel.
        v: its row.
        h: height of the ground above the ellipsoid [m].

    Returns:
        Along: in the direction in which a step of one pixel is longest on the ground, m/px; across: in that where it is
        shortest; distance to the ground [m]; angle of incidence, 0 at nadir [rad]. NaN if the pixel sees no ground.
    """
    ray = pixel_ray(lens, u, v)
    d = mat_t_vec(dcm_CE, ray)
    lat, lon, distance = ray_to_height(r_CE_E[0], r_CE_E[1], r_CE_E[2], d[0], d[1], d[2], h)
    n = (math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat))
    x, y = ray[0] / ray[2], ray[1] / ray[2]
    xx, xy, yx, yy = distort_slopes(lens, x, y)
    ux, uy, vx, vy = lens[0] * xx + lens[4] * yx, lens[0] * xy + lens[4] * yy, lens[1] * yx, lens[1] * yy
    det = ux * vy - uy * vx
    a = _step(ray, d, mat_t_vec(dcm_CE, (vy / det, -vx / det, 0.0)), n, distance)
    b = _step(ray, d, mat_t_vec(dcm_CE, (-uy / det, ux / det, 0.0)), n, distance)
    aa, ab, bb = dot(a, a), dot(a, b), dot(b, b)
    spread = math.sqrt((aa - bb) * (aa - bb) + 4.0 * ab * ab)
    large = 0.5 * (aa + bb + spread)
    small = (aa * bb - ab * ab) / large
    return math.sqrt(large), math.sqrt(max(small, 0.0)), distance, math.acos(min(-dot(n, d), 1.0))


@compiled
def _step(ray: V3, d: V3, dw: V3, n: V3, distance: float) -> V3:
    """How far a point of the ground (normal ``n``) moves when the tangents of its direction ``d`` change by ``dw``."""
    across = scale(distance * ray[2], axpy(-dot(dw, d), d, dw))
    return axpy(-dot(n, across) / dot(n, d), d, across)


def footprint(camera: CameraConfigMsg, r_CE_E: F64, dcm_CE: F64, per_edge: int = 8, h: float = 0.0) -> F64:
    """The polygon on the ground that the edges of the image see.

    Args:
        camera: lens and size of the image.
        r_CE_E: position of the camera (3,), Earth-fixed [m].
        dcm_CE: attitude of the camera relative to E, (3, 3).
        per_edge: points on each edge; 1 gives the four corners alone.
        h: height above the ellipsoid [m].

    Returns:
        Latitude and longitude [rad], (4 per_edge, 2), from the top left corner around by the top right one; NaN where
        the edge looks past the limb, or the lens has no direction.

    Raises:
        ValueError: if ``per_edge`` is below 1.
    """
    if per_edge < 1:
        raise ValueError(f"footprint: per_edge: expected at least 1, got {per_edge}")
    lens, part = lens_vector(camera), np.arange(per_edge) / per_edge
    w, h_px, zero = float(camera.width_px), float(camera.height_px), np.zeros(per_edge)
    columns = np.concatenate([w * part, zero + w, w * (1.0 - part), zero]) - 0.5
    rows = np.concatenate([zero, h_px * part, zero + h_px, h_px * (1.0 - part)]) - 0.5
    places = np.empty((4 * per_edge, 2))
    x, y, z = (float(c) for c in r_CE_E)
    for i, (u, v) in enumerate(zip(columns.tolist(), rows.tolist(), strict=True)):
        dx, dy, dz = (float(c) for c in np.asarray(pixel_ray(lens, u, v)) @ dcm_CE)
        places[i] = ray_to_height(x, y, z, dx, dy, dz, h)[:2]
    return places
