"""How a camera sees an ellipsoid: its limb as an ellipse, points of it, and where a ray meets the surface. Compiled.

A body is a sphere, spheroid or triaxial ellipsoid: semi-axes (a, b, c) along the axes of its frame P, whose origin is
its centre. The limb of an ellipsoid in an image without distortion is an ellipse; its centre is not the image of the
body's centre. Where there is no such ellipse (the camera inside the body, or part of the body beside or behind the
camera), the numbers are NaN. Source: Hartley and Zisserman (2004), "Multiple View Geometry", sec. 8.3, the dual conic
of a quadric; written out here so that nothing cancels when the body is small and far.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fsw.math.camera import project
from fsw.math.compiled import compiled
from fsw.math.vectors import V3

if TYPE_CHECKING:
    from messages.base import F64


class ImageEllipse(NamedTuple):
    """An ellipse in the image, without distortion; pixels."""

    center_px: F64
    """Its centre (2,)."""
    semi_major_px: float
    semi_minor_px: float
    angle: float
    """From the x axis (right) to the major axis, positive towards y (down), within -pi/2 to pi/2 [rad]."""
    area_px: float
    """Square pixels."""
    conic: F64
    """(3, 3), symmetric: (u, v, 1) conic (u, v, 1)' is negative inside, 0 on the ellipse, -1 at its centre."""


def ellipsoid_in_image(lens: F64, axes: F64, dcm_CP: F64, r_PC_C: F64) -> ImageEllipse:
    """The limb of an ellipsoid, as a camera without distortion would see it.

    Args:
        lens: as `fsw.math.camera.lens_vector` makes it; its distortion is not applied.
        axes: semi-axes (3,) [m].
        dcm_CP: attitude of the camera relative to the body, (3, 3).
        r_PC_C: position of the body's centre relative to the camera, camera components (3,) [m].
    """
    cx, cy, xx, xy, yy = limb_ellipse(lens, axes, dcm_CP, r_PC_C)
    major, minor, angle = ellipse_axes(xx, xy, yy)
    inverse = np.array([[yy, -xy], [-xy, xx]]) / (xx * yy - xy * xy)
    center = np.array([cx, cy])
    conic = np.empty((3, 3))
    conic[:2, :2], conic[:2, 2], conic[2, :2] = inverse, -inverse @ center, -inverse @ center
    conic[2, 2] = center @ inverse @ center - 1.0
    return ImageEllipse(center, major, minor, angle, math.pi * major * minor, conic)


@compiled
def limb_ellipse(lens: F64, axes: F64, dcm_CP: F64, r_PC_C: F64) -> tuple[float, float, float, float, float]:
    """Centre and shape of the limb without distortion; see `ellipsoid_in_image`.

    Returns:
        Column and row of the centre [px]; xx, xy and yy of the matrix S [px^2] with which the ellipse is
        (p - centre)' S^-1 (p - centre) = 1.
    """
    rx, ry, rz = r_PC_C[0], r_PC_C[1], r_PC_C[2]
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # of the matrix of the squared axes in C components
    for i in range(3):
        square = axes[i] * axes[i]
        x, y, z = dcm_CP[0, i], dcm_CP[1, i], dcm_CP[2, i]
        xx, xy, xz = xx + square * x * x, xy + square * x * y, xz + square * x * z
        yy, yz, zz = yy + square * y * y, yz + square * y * z, zz + square * z * z
    q = rz * rz - zz
    if not (rz > 0.0 and q > 0.0 and rx - rx == 0.0 and ry - ry == 0.0):  # NaN and infinity too
        return math.nan, math.nan, math.nan, math.nan, math.nan
    cx, cy = (rx * rz - xz) / q, (ry * rz - yz) / q
    # c c' - (r r' - S) / q, times q^2, without the terms in r^4, which cancel
    sxx = xz * xz - xx * zz + rx * rx * zz - 2.0 * rz * rx * xz + xx * rz * rz
    sxy = xz * yz - xy * zz + rx * ry * zz - rz * (rx * yz + ry * xz) + xy * rz * rz
    syy = yz * yz - yy * zz + ry * ry * zz - 2.0 * rz * ry * yz + yy * rz * rz
    fx, fy, skew = lens[0] / q, lens[1] / q, lens[4] / q
    return (
        lens[0] * cx + lens[4] * cy + lens[2],
        lens[1] * cy + lens[3],
        fx * fx * sxx + 2.0 * fx * skew * sxy + skew * skew * syy,
        fy * (fx * sxy + skew * syy),
        fy * fy * syy,
    )


@compiled
def ellipse_axes(xx: float, xy: float, yy: float) -> tuple[float, float, float]:
    """Semi-axes, the larger first, and the angle from x to the larger [rad], of p' S^-1 p = 1."""
    spread = math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy)
    large = 0.5 * (xx + yy + spread)
    return math.sqrt(large), math.sqrt((xx * yy - xy * xy) / large), 0.5 * math.atan2(2.0 * xy, xx - yy)


@compiled
def sphere_center_offset(focal_px: float, off_axis: float, radius: float) -> float:
    """How far outward the centre of a sphere's ellipse lies from the image of the sphere's centre [px].

    Args:
        focal_px: focal length.
        off_axis: angle from the boresight to the sphere's centre [rad].
        radius: angular radius of the sphere [rad]; the sum of both angles is below a right angle.
    """
    sin2, cos = math.sin(radius) ** 2, math.cos(off_axis)
    return focal_px * math.tan(off_axis) * sin2 / (cos * cos - sin2)


@compiled
def limb_points(axes: F64, dcm_CP: F64, r_PC_C: F64, out: F64) -> None:
    """Points of the limb, evenly in the angle on the unit sphere that the body is stretched to; NaN from inside.

    Args:
        axes: semi-axes (3,) [m].
        dcm_CP: attitude of the camera relative to the body, (3, 3).
        r_PC_C: position of the body's centre relative to the camera, camera components (3,) [m].
        out: (n, 3), positions relative to the camera, camera components [m].
    """
    # the camera as seen from the centre, in units of the axes: there the limb is a circle
    ox, oy, oz = 0.0, 0.0, 0.0
    for k in range(3):
        ox -= dcm_CP[k, 0] * r_PC_C[k] / axes[0]
        oy -= dcm_CP[k, 1] * r_PC_C[k] / axes[1]
        oz -= dcm_CP[k, 2] * r_PC_C[k] / axes[2]
    square = ox * ox + oy * oy + oz * oz
    radius = math.sqrt(1.0 - 1.0 / square) if square > 1.0 else math.nan
    r = math.sqrt(square)
    ux, uy, uz = ox / r, oy / r, oz / r
    # two unit vectors across (Duff et al. 2017, J. Comput. Graph. Tech. 6(1))
    sign = 1.0 if uz >= 0.0 else -1.0
    h = -1.0 / (sign + uz)
    m = ux * uy * h
    for i in range(out.shape[0]):
        angle = 2.0 * math.pi * i / out.shape[0]
        c, s = radius * math.cos(angle), radius * math.sin(angle)
        x = axes[0] * (ox / square - ox + c * (1.0 + sign * ux * ux * h) + s * m)
        y = axes[1] * (oy / square - oy + c * sign * m + s * (sign + uy * uy * h))
        z = axes[2] * (oz / square - oz - c * sign * ux - s * uy)
        for k in range(3):
            out[i, k] = dcm_CP[k, 0] * x + dcm_CP[k, 1] * y + dcm_CP[k, 2] * z


def limb_pixels(lens: F64, axes: F64, dcm_CP: F64, r_PC_C: F64, count: int) -> F64:
    """Pixels (count, 2) of points of the limb, distortion included; NaN for those that the lens cannot see."""
    points, pixels = np.empty((count, 3)), np.empty((count, 2))
    limb_points(axes, dcm_CP, r_PC_C, points)
    project(lens, points, pixels)
    return pixels


@compiled
def ray_to_ellipsoid(r: V3, d: V3, axes: V3) -> float:
    """Distance to where a ray first meets an ellipsoid; NaN if it misses, leads away or starts inside.

    Args:
        r: start of the ray relative to the centre, body-fixed components [m].
        d: its direction, body-fixed, unit length.
        axes: semi-axes [m].
    """
    x, y, z = r[0] / axes[0], r[1] / axes[1], r[2] / axes[2]
    dx, dy, dz = d[0] / axes[0], d[1] / axes[1], d[2] / axes[2]
    dd = dx * dx + dy * dy + dz * dz
    t = -(x * dx + y * dy + z * dz) / dd  # to the closest point of the line: nothing cancels far away
    px, py, pz = x + t * dx, y + t * dy, z + t * dz
    room = (1.0 - (px * px + py * py + pz * pz)) / dd
    if not (room >= 0.0 and t > 0.0 and x * x + y * y + z * z >= 1.0):
        return math.nan
    return t - math.sqrt(room)
