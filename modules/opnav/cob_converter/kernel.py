"""Where the light of a sphere has its centre in the image, and the direction for which it is the one seen."""

from __future__ import annotations

import math

from fsw.math.camera import distort_slopes, undistort_point
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, axpy, dot, norm, scale, sub, unit
from messages.base import F64
from modules.opnav.relative import NO_SOLUTION, OUTSIDE_LENS, TOO_UNSURE, VALID

NONE, LAMBERT, UNIFORM = 0, 1, 2


@compiled
def phase_shift(law: int, phase: float) -> float:
    """Distance of the centre of brightness from the disk's centre, towards the Sun, in radii; small disk.

    Lambert's law: Bhaskaran, Riedel and Synnott (1996), "Autonomous optical navigation for interplanetary missions".
    A uniform lit part: centroid of a half disk and half an ellipse.

    Args:
        law: LAMBERT, UNIFORM, or NONE for 0.
        phase: angle Sun, body, camera [rad], below pi.
    """
    c = math.cos(phase)
    if law == LAMBERT:
        s = math.sin(phase)
        return 3.0 * math.pi / 16.0 * (1.0 + c) * s / (s + (math.pi - phase) * c) if phase > 0.0 else 0.0
    if law == UNIFORM:
        return 4.0 / (3.0 * math.pi) * (1.0 - c)
    return 0.0


@compiled
def phase_of(u_C: V3, sun_C: V3) -> float:
    """Angle Sun, body, camera [rad], for the direction u_C of a body from the camera."""
    return math.atan2(norm(axpy(-dot(u_C, sun_C), u_C, sun_C)), -dot(u_C, sun_C))


@compiled
def light_center(u_C: V3, sin_rho: float, law: int, sun_C: V3) -> tuple[float, float, float, float]:
    """Tangents of the centre of brightness of a sphere, and its shift by the phase.

    The limb is an ellipse whose centre is further off axis than the sphere's: tangents u_x u_z / (u_z^2 - sin^2 rho).
    The shift is that of a far sphere, stretched as the ellipse is.

    Args:
        u_C: direction of the sphere's centre from the camera.
        sin_rho: sine of its angular radius.
        law: see `phase_shift`.
        sun_C: direction of the Sun.

    Returns:
        x, y of the centre of brightness, and the part of them that is the shift; NaN if the limb is not all in front.
    """
    k = u_C[2] * u_C[2] - sin_rho * sin_rho
    cos_rho = math.sqrt(max(0.0, 1.0 - sin_rho * sin_rho))
    across = axpy(-dot(u_C, sun_C), u_C, sun_C)
    if not (u_C[2] > 0.0 and k > 0.0):
        return math.nan, math.nan, math.nan, math.nan
    x, y, dx, dy = u_C[0] * u_C[2] / k, u_C[1] * u_C[2] / k, 0.0, 0.0
    if norm(across) > 1e-12 and law != NONE:
        side = scale(sin_rho, unit(across))
        near, away = axpy(cos_rho, u_C, side), sub(scale(cos_rho, u_C), side)
        size = 0.5 * phase_shift(law, phase_of(u_C, sun_C))
        dx = size * (near[0] / near[2] - away[0] / away[2])
        dy = size * (near[1] / near[2] - away[1] / away[2])
    return x + dx, y + dy, dx, dy


@compiled
def sine_of_radius(lens: F64, u_C: V3, area_px: float, sun_C: V3) -> float:
    """Sine of a sphere's angular radius from the area of its lit part, which is (1 + cos phase) / 2 of the disk."""
    solid = area_px / (lens[0] * lens[1]) * u_C[2] ** 3
    return math.sqrt(2.0 * solid / (math.pi * (1.0 + math.cos(phase_of(u_C, sun_C)))))


@compiled
def direction_of_light(
    lens: F64, u: float, v: float, law: int, sun_C: V3, sin_rho: float, area_px: float, max_phase: float
) -> tuple[int, V3, float, float]:
    """Direction of the sphere whose centre of brightness is a pixel.

    Args:
        lens: lens vector (11,).
        u: column [px].
        v: row [px].
        law: see `phase_shift`.
        sun_C: direction of the Sun; not used without a law.
        sin_rho: sine of the angular radius, or 0 to take it from the area.
        area_px: area of the lit part [px^2].
        max_phase: beyond this phase nothing is said [rad].

    Returns:
        Status of `modules.opnav.relative`, unit vector from the camera to the sphere's centre in C, and the shift by
        the phase in tangents.
    """
    x0, y0 = undistort_point(lens, u, v)
    x, y, dx, dy = x0, y0, 0.0, 0.0
    ex, ey = math.inf, math.inf
    if math.isnan(x0):
        return OUTSIDE_LENS, (x0, y0, 1.0), dx, dy
    for _ in range(50):
        u_C = unit((x, y, 1.0))
        if law != NONE and not phase_of(u_C, sun_C) <= max_phase:
            return TOO_UNSURE, u_C, dx, dy
        size = sin_rho
        if size == 0.0 and law != NONE:
            size = sine_of_radius(lens, u_C, area_px, sun_C)
        cx, cy, dx, dy = light_center(u_C, size, law, sun_C)
        if not (size < 1.0 and math.isfinite(cx + cy)):
            return NO_SOLUTION, u_C, dx, dy
        ex, ey = x0 - cx, y0 - cy
        x, y = x + ex, y + ey
        if math.fabs(ex) + math.fabs(ey) < 1e-14:
            return VALID, unit((x, y, 1.0)), dx, dy
    if math.fabs(ex) + math.fabs(ey) < 1e-10:
        return VALID, unit((x, y, 1.0)), dx, dy
    return NO_SOLUTION, unit((x, y, 1.0)), dx, dy


@compiled
def direction_covariance(lens: F64, u_C: V3, P_px: F64, sx: float, sy: float, P: F64) -> None:
    """Covariance of the unit vector.

    Args:
        lens: lens vector (11,).
        u_C: unit vector.
        P_px: covariance of the pixel (2, 2) [px^2].
        sx: one standard deviation of the shift by the phase, x [tangents].
        sy: y.
        P: out, (3, 3).
    """
    x, y = u_C[0] / u_C[2], u_C[1] / u_C[2]
    xx, xy, yx, yy = distort_slopes(lens, x, y)
    a, b = lens[0] * xx + lens[4] * yx, lens[0] * xy + lens[4] * yy
    c, d = lens[1] * yx, lens[1] * yy
    det = a * d - b * c
    g0, g1, g2, g3 = d / det, -b / det, -c / det, a / det
    p, q, r = P_px[0, 0], P_px[0, 1], P_px[1, 1]
    txx = g0 * g0 * p + 2.0 * g0 * g1 * q + g1 * g1 * r + sx * sx
    txy = g0 * g2 * p + (g0 * g3 + g1 * g2) * q + g1 * g3 * r + sx * sy
    tyy = g2 * g2 * p + 2.0 * g2 * g3 * q + g3 * g3 * r + sy * sy
    ex = scale(u_C[2], axpy(-u_C[0], u_C, (1.0, 0.0, 0.0)))
    ey = scale(u_C[2], axpy(-u_C[1], u_C, (0.0, 1.0, 0.0)))
    for i in range(3):
        for j in range(3):
            P[i, j] = txx * ex[i] * ex[j] + txy * (ex[i] * ey[j] + ey[i] * ex[j]) + tyy * ey[i] * ey[j]
