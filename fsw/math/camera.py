"""The pinhole camera with Brown-Conrady distortion: projection, its inverse and its derivatives, compiled.

A lens is an array of 11 numbers, made by `lens_vector`: fx, fy, cx, cy, skew [px], k1, k2, p1, p2, k3, and s_max, the
largest squared tangent of the angle off axis up to which the radial distortion grows with the angle. Beyond it one
pixel has two directions, so points there are refused (NaN), as are points behind the camera.

Source: Brown (1971), "Close-range camera calibration"; the order of coefficients is OpenCV's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fsw.math.compiled import compiled

if TYPE_CHECKING:
    from messages.base import F64
    from messages.opnav import CameraConfigMsg

LENS_SIZE = 11
S_MAX = 10
UNLIMITED = 1e12
"""s_max of a lens whose distortion is monotonic everywhere: 89.99994 degrees off axis."""


def lens_vector(camera: CameraConfigMsg) -> F64:
    """The 11 numbers that the compiled functions take, from a camera message.

    Returns:
        fx, fy, cx, cy, skew [px], k1, k2, p1, p2, k3, s_max [-], shape (11,).
    """
    head = [*camera.focal_px, *camera.center_px, camera.skew_px, *camera.distortion]
    k1, k2, k3 = camera.distortion[0], camera.distortion[1], camera.distortion[4]
    return np.array([*head, monotonic_limit(float(k1), float(k2), float(k3))])


def channel_lens(camera: CameraConfigMsg, channel: int) -> F64:
    """The lens of one colour, 0 red, 1 green, 2 blue: lateral chromatic aberration moves its image along the radius.

    Focal lengths and skew are scaled by ``chromatic``, which scales the image about the principal point, and k1 grows
    by ``chromatic_k1``.

    Returns:
        As `lens_vector`, shape (11,).
    """
    lens = lens_vector(camera)
    scale, k1 = float(camera.chromatic[channel]), float(lens[5] + camera.chromatic_k1[channel])
    lens[[0, 1, 4]] *= scale
    lens[5], lens[S_MAX] = k1, monotonic_limit(k1, float(lens[6]), float(lens[9]))
    return lens


def monotonic_limit(k1: float, k2: float, k3: float) -> float:
    """Largest squared tangent s up to which r (1 + k1 s + k2 s^2 + k3 s^3), s = r^2, grows with r.

    The smallest positive root of 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3.
    """
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    real = [float(z.real) for z in roots if abs(z.imag) <= 1e-9 * abs(z) and z.real > 0.0]
    return min(real, default=UNLIMITED)


@compiled
def distort(lens: F64, x: float, y: float) -> tuple[float, float]:
    """Distorted tangents from the tangents x/z, y/z; valid within s_max."""
    s = x * x + y * y
    radial = 1.0 + s * (lens[5] + s * (lens[6] + s * lens[9]))
    p1, p2 = lens[7], lens[8]
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
        y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


@compiled
def distort_slopes(lens: F64, x: float, y: float) -> tuple[float, float, float, float]:
    """Derivatives of `distort`: dxd/dx, dxd/dy, dyd/dx, dyd/dy. The second and third are equal."""
    s = x * x + y * y
    radial = 1.0 + s * (lens[5] + s * (lens[6] + s * lens[9]))
    slope = 2.0 * (lens[5] + s * (2.0 * lens[6] + s * 3.0 * lens[9]))
    p1, p2 = lens[7], lens[8]
    cross = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return (
        radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@compiled
def project_point(lens: F64, x: float, y: float, z: float) -> tuple[float, float]:
    """Pixel (column, row) of a point in camera components (any unit); NaN behind the camera or beyond s_max."""
    if not z > 0.0:
        return math.nan, math.nan
    a, b = x / z, y / z
    if not a * a + b * b < lens[S_MAX]:
        return math.nan, math.nan
    xd, yd = distort(lens, a, b)
    return lens[0] * xd + lens[4] * yd + lens[2], lens[1] * yd + lens[3]


@compiled
def project(lens: F64, r_C: F64, out: F64) -> None:
    """`project_point` for points (n, 3) in camera components, into ``out`` (n, 2) [px]."""
    for i in range(r_C.shape[0]):
        out[i, 0], out[i, 1] = project_point(lens, r_C[i, 0], r_C[i, 1], r_C[i, 2])


@compiled
def project_derivatives(lens: F64, x: float, y: float, z: float, d_point: F64, d_lens: F64) -> tuple[float, float]:
    """`project_point` and its derivatives.

    Args:
        lens: lens vector (11,).
        x: first camera component of the point; y, z: the others, same unit.
        y: second component.
        z: third component.
        d_point: out, (2, 3), derivatives of the pixel by x, y, z [px per unit of the point].
        d_lens: out, (2, 10), derivatives of the pixel by the first ten numbers of the lens.

    Returns:
        Column and row [px]. If they are NaN, the derivatives are not written.
    """
    u, v = project_point(lens, x, y, z)
    if math.isnan(u):
        return u, v
    a, b = x / z, y / z
    s = a * a + b * b
    xx, xy, yx, yy = distort_slopes(lens, a, b)
    xd, yd = distort(lens, a, b)
    fx, fy, skew = lens[0], lens[1], lens[4]
    ua, ub = fx * xx + skew * yx, fx * xy + skew * yy
    va, vb = fy * yx, fy * yy
    d_point[0, 0], d_point[0, 1], d_point[0, 2] = ua / z, ub / z, -(ua * a + ub * b) / z
    d_point[1, 0], d_point[1, 1], d_point[1, 2] = va / z, vb / z, -(va * a + vb * b) / z
    d_lens[0, 0], d_lens[0, 1], d_lens[0, 2], d_lens[0, 3], d_lens[0, 4] = xd, 0.0, 1.0, 0.0, yd
    d_lens[1, 0], d_lens[1, 1], d_lens[1, 2], d_lens[1, 3], d_lens[1, 4] = 0.0, yd, 0.0, 1.0, 0.0
    _set_by_distorted(lens, d_lens, 5, a * s, b * s)
    _set_by_distorted(lens, d_lens, 6, a * s * s, b * s * s)
    _set_by_distorted(lens, d_lens, 7, 2.0 * a * b, s + 2.0 * b * b)
    _set_by_distorted(lens, d_lens, 8, s + 2.0 * a * a, 2.0 * a * b)
    _set_by_distorted(lens, d_lens, 9, a * s * s * s, b * s * s * s)
    return u, v


@compiled
def _set_by_distorted(lens: F64, d_lens: F64, column: int, dx: float, dy: float) -> None:
    """A column of ``d_lens`` from the derivatives of the distorted tangents."""
    d_lens[0, column] = lens[0] * dx + lens[4] * dy
    d_lens[1, column] = lens[1] * dy


@compiled
def undistort_point(lens: F64, u: float, v: float) -> tuple[float, float]:
    """Tangents x/z, y/z of the direction that a pixel sees, by Newton's method; NaN if none within s_max.

    The pixel of the result differs from (u, v) by less than 1e-10 px.
    """
    yd = (v - lens[3]) / lens[1]
    xd = (u - lens[2] - lens[4] * yd) / lens[0]
    x, y = xd, yd
    s = x * x + y * y
    if not s < lens[S_MAX]:  # start inside; the distorted tangent may lie outside
        shrink = 0.7 * math.sqrt(lens[S_MAX] / s)
        x, y = x * shrink, y * shrink
    for _ in range(50):
        fx, fy = distort(lens, x, y)
        ex, ey = xd - fx, yd - fy
        if math.fabs(ex) * lens[0] < 2e-12 and math.fabs(ey) * lens[1] < 2e-12:
            return x, y
        xx, xy, yx, yy = distort_slopes(lens, x, y)
        det = xx * yy - xy * yx
        dx, dy = (yy * ex - xy * ey) / det, (xx * ey - yx * ex) / det
        scale = 1.0
        while not (x + scale * dx) ** 2 + (y + scale * dy) ** 2 < lens[S_MAX]:
            scale *= 0.5
            if scale < 1e-3:
                return math.nan, math.nan
        x, y = x + scale * dx, y + scale * dy
    fx, fy = distort(lens, x, y)
    if math.fabs(xd - fx) * lens[0] < 1e-10 and math.fabs(yd - fy) * lens[1] < 1e-10:
        return x, y
    return math.nan, math.nan


@compiled
def undistort(lens: F64, pixel: F64, out: F64) -> None:
    """`undistort_point` for pixels (n, 2), into tangents ``out`` (n, 2)."""
    for i in range(pixel.shape[0]):
        out[i, 0], out[i, 1] = undistort_point(lens, pixel[i, 0], pixel[i, 1])
