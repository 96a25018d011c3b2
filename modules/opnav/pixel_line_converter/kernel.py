"""The circle that the disk of an ellipsoid looks like, by its limb, and the position for which it is the one seen."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.camera import project_point, undistort_point
from fsw.math.compiled import compiled
from fsw.math.vectors import (
    M3,
    V3,
    add,
    axpy,
    cross,
    determinant,
    dot,
    inverse,
    mat_t_vec,
    matvec,
    norm,
    scale,
    sub,
    unit,
)
from messages.base import F64
from modules.opnav.basilisk import basilisk_radii
from modules.opnav.relative import NO_SOLUTION, OUTSIDE_LENS, VALID, sandwich

POINTS = 96
"""Points of the limb: the circle through half of it is then good to 1e-5 of the radius, through all far better."""


@compiled
def limb_circle(lens: F64, axes: V3, dcm_EC: M3, r_C: V3, sun_C: V3, limb: F64) -> tuple[bool, V3]:
    """Least squares circle through the limb of an ellipsoid in the image, all parts of the limb weighing the same.

    In coordinates in which the body is a unit sphere the limb is a circle in the plane u . q = 1, q the camera.

    Args:
        lens: lens vector (11,).
        axes: semi-axes along x, y, z of E [m].
        dcm_EC: maps C to E components, E being fixed to the body.
        r_C: camera relative to the body's centre [m].
        sun_C: direction of the Sun, for the lit part of the limb; zero for the whole limb.
        limb: work (POINTS + 4, 2).

    Returns:
        Whether all points lie inside the lens, and column, row and radius [px].
    """
    nothing = (math.nan, math.nan, math.nan)
    r_E = matvec(dcm_EC, r_C)
    q = (r_E[0] / axes[0], r_E[1] / axes[1], r_E[2] / axes[2])
    far = norm(q)
    if not far > 1.0:
        return False, nothing
    m = scale(1.0 / far, q)
    low, high = 1.0 / far, math.sqrt(1.0 - 1.0 / (far * far))
    # towards the Sun, in coordinates in which a surface normal u has the light u . s
    s_E = matvec(dcm_EC, sun_C)
    s = (s_E[0] / axes[0], s_E[1] / axes[1], s_E[2] / axes[2])
    across = axpy(-dot(s, m), m, s)
    half = math.pi
    if norm(across) > 1e-12 * norm(s):
        e1 = unit(across)
        level = -low * dot(s, m) / (high * norm(across))
        if level >= 1.0:
            return False, nothing
        if level > -1.0:
            half = math.acos(level)
    else:
        e1 = unit(cross((1.0, 0.0, 0.0) if math.fabs(m[0]) < 0.7 else (0.0, 1.0, 0.0), m))
    e2 = cross(m, e1)
    # two points more at each end, for the length of the limb that a point stands for
    for i in range(POINTS + 4):
        angle = half * ((2 * i - 3) / POINTS - 1.0)
        u = add(scale(low, m), add(scale(high * math.cos(angle), e1), scale(high * math.sin(angle), e2)))
        p = sub(mat_t_vec(dcm_EC, (axes[0] * u[0], axes[1] * u[1], axes[2] * u[2])), r_C)
        limb[i, 0], limb[i, 1] = project_point(lens, p[0], p[1], p[2])
        if math.isnan(limb[i, 0]):
            return False, nothing
    return True, circle_through(limb)


@compiled
def share(limb: F64, i: int) -> float:
    """Length of a chain of points that point ``i`` stands for, by differences of fourth order [px]."""
    dx = 8.0 * (limb[i + 1, 0] - limb[i - 1, 0]) - (limb[i + 2, 0] - limb[i - 2, 0])
    dy = 8.0 * (limb[i + 1, 1] - limb[i - 1, 1]) - (limb[i + 2, 1] - limb[i - 2, 1])
    return math.sqrt(dx * dx + dy * dy) / 12.0


@compiled
def circle_through(limb: F64) -> V3:
    """Column, row and radius of the circle with the least squares of distances from a chain of points.

    Gauss-Newton; each inner point weighs as much as the length it stands for. limb: (n + 4, 2) [px].
    """
    n = limb.shape[0] - 4
    total, cx, cy, rho = 0.0, 0.0, 0.0, 0.0
    for i in range(2, n + 2):
        w = share(limb, i)
        total, cx, cy = total + w, cx + w * limb[i, 0], cy + w * limb[i, 1]
    cx, cy = cx / total, cy / total
    for _ in range(30):
        a = b = c = d = e = rho = 0.0  # sums of cos, sin, cos^2, cos sin, sin^2, and distance
        f = g = 0.0
        for i in range(2, n + 2):
            w = share(limb, i) / total
            dx, dy = limb[i, 0] - cx, limb[i, 1] - cy
            far = math.sqrt(dx * dx + dy * dy)
            x, y = dx / far, dy / far
            a, b, c, d, e = a + w * x, b + w * y, c + w * x * x, d + w * x * y, e + w * y * y
            rho, f, g = rho + w * far, f + w * x * far, g + w * y * far
        # the radius is eliminated: its best value is the mean distance
        c, d, e, f, g = c - a * a, d - a * b, e - b * b, f - a * rho, g - b * rho
        det = c * e - d * d
        dx, dy = (e * f - d * g) / det, (c * g - d * f) / det
        cx, cy, rho = cx + dx, cy + dy, rho - a * dx - b * dy
        if math.fabs(dx) + math.fabs(dy) < 1e-11 * rho:
            break
    return (cx, cy, rho)


@compiled
def slopes(lens: F64, axes: V3, dcm_EC: M3, r_C: V3, sun_C: V3, limb: F64) -> tuple[bool, M3]:
    """Derivatives of the circle (rows: column, row, radius) by the position [px/m], by central differences."""
    h = 1e-4 * (norm(r_C) - min(axes[0], axes[1], axes[2]))
    good, columns = True, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(3):
        step = (h if k == 0 else 0.0, h if k == 1 else 0.0, h if k == 2 else 0.0)
        up, high = limb_circle(lens, axes, dcm_EC, add(r_C, step), sun_C, limb)
        down, low = limb_circle(lens, axes, dcm_EC, sub(r_C, step), sun_C, limb)
        good = good and up and down
        slope = scale(0.5 / h, sub(high, low))
        if k == 0:
            columns = (slope, columns[1], columns[2])
        elif k == 1:
            columns = (columns[0], slope, columns[2])
        else:
            columns = (columns[0], columns[1], slope)
    return good, (
        (columns[0][0], columns[1][0], columns[2][0]),
        (columns[0][1], columns[1][1], columns[2][1]),
        (columns[0][2], columns[1][2], columns[2][2]),
    )


@compiled
def first_guess(lens: F64, radius: float, circle: V3) -> V3:
    """Position as if the circle were a cone about its centre's ray; NaN where the lens sees nothing of it."""
    x, y = undistort_point(lens, circle[0], circle[1])
    axis = unit((x, y, 1.0))
    angle, seen = 0.0, 0
    for k in range(4):
        dx = circle[2] if k == 0 else (-circle[2] if k == 1 else 0.0)
        dy = circle[2] if k == 2 else (-circle[2] if k == 3 else 0.0)
        x, y = undistort_point(lens, circle[0] + dx, circle[1] + dy)
        if not math.isnan(x):
            edge = unit((x, y, 1.0))
            angle += math.atan2(norm(cross(axis, edge)), dot(axis, edge))
            seen += 1
    if seen == 0:
        return (math.nan, math.nan, math.nan)
    return scale(-radius / math.sin(angle / seen), axis)


@compiled
def position_of_circle(lens: F64, axes: V3, dcm_EC: M3, sun_C: V3, circle: V3) -> tuple[int, V3, M3]:
    """The position for which `limb_circle` gives a circle, by Newton's method.

    Returns:
        Status of `modules.opnav.relative`, position of the camera relative to the body's centre in C [m], and the
        derivatives of the circle by it [px/m].
    """
    limb = np.zeros((POINTS + 4, 2))
    zero = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    r = first_guess(lens, (axes[0] + axes[1] + axes[2]) / 3.0, circle)
    good, seen = limb_circle(lens, axes, dcm_EC, r, sun_C, limb)
    if not good:
        return OUTSIDE_LENS, r, zero
    J = zero
    for _ in range(20):
        good, J = slopes(lens, axes, dcm_EC, r, sun_C, limb)
        if not good or determinant(J) == 0.0:
            return NO_SOLUTION, r, J
        off = sub(circle, seen)
        if norm(off) < 1e-9:
            return VALID, r, J
        step = matvec(inverse(J), off)
        for _ in range(8):
            good, seen = limb_circle(lens, axes, dcm_EC, add(r, step), sun_C, limb)
            if good and norm(sub(circle, seen)) < norm(off):
                break
            step = scale(0.5, step)
        if not (good and norm(sub(circle, seen)) < norm(off)):
            # as near as rounding lets it come
            return (VALID if norm(off) < 1e-6 else NO_SOLUTION), r, J
        r = add(r, step)
    return NO_SOLUTION, r, J


@compiled
def basilisk_line(body_id: int, width: int, height: int, fx: float, fy: float, circle: V3, U: M3) -> tuple[V3, M3]:
    """Basilisk's pixelLineConverter: position [m] and covariance [m^2] in C; NaN for a body it does not know.

    Args:
        body_id: NAIF identifier.
        width: columns.
        height: rows.
        fx: focal length along columns [px].
        fy: along rows [px].
        circle: column, row, radius [px].
        U: their covariance [px^2].
    """
    X, Y = 1.0 / fx, 1.0 / fy
    a, _ = basilisk_radii(body_id)
    x, y, rho = (circle[0] - width // 2 + 0.5) * X, (circle[1] - height // 2 + 0.5) * Y, circle[2]
    far = a / math.sin(math.atan(X * rho))
    root = math.sqrt(1.0 + (rho * X) ** 2)
    M = ((far * X, 0.0, 0.0), (0.0, far * Y, 0.0), (0.0, 0.0, a * (X / root - root / (X * rho * rho))))
    return scale(-far, unit((x, y, 1.0))), sandwich(M, U)


@compiled
def covariance(J: M3, U: M3) -> M3:
    """Covariance of the position from that of the circle: J^-1 U J^-1'."""
    inv = inverse(J)
    return sandwich(inv, U)
