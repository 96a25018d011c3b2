"""The circle that the disk of an ellipsoid looks like, as in the pixel and line converter, but made for whole limbs.

The model is the same: the circle with the least sum of squared distances from the limb in the image, all parts of it
weighing the same. A whole limb is periodic, so sums over evenly spaced points converge faster than any power of their
number if the length that each stands for is exact; it comes from derivatives here. 20 points are enough (to 1e-7 px) if
the limb is within 45 degrees of the axis, and 32 else.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.camera import distort, distort_slopes
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, cross, mat_t_vec, matvec, norm, scale, sub, unit
from messages.base import F64

POINTS = 32
"""Most points of a limb."""
FEW = 20
"""Points of a limb near the axis."""
WORK = 6
"""Rows of the work space for them."""


def _turn(n: int) -> F64:
    """Cosine and sine of n places (2, n)."""
    angle = (2.0 * np.pi / n) * np.arange(n)
    return np.stack([np.cos(angle), np.sin(angle)])


TURN, TURN_FEW = _turn(POINTS), _turn(FEW)


@compiled
def whole_limb(lens: F64, axes: V3, dcm_EC: M3, r_C: V3, limb: F64) -> int:
    """Points of the limb and the lengths they stand for.

    Args:
        lens: lens vector (11,).
        axes: semi-axes along x, y, z of E [m].
        dcm_EC: maps C to E components, E being fixed to the body.
        r_C: camera relative to the body's centre [m].
        limb: out (WORK, POINTS): column, row [px], and the share of the whole length; the rest is work.

    Returns:
        How many points; 0 if the camera is inside the body, or a part of the limb outside the lens.
    """
    r_E = matvec(dcm_EC, r_C)
    q = (r_E[0] / axes[0], r_E[1] / axes[1], r_E[2] / axes[2])
    far = norm(q)
    if not far > 1.0:
        return 0
    # where the body is a unit sphere, the limb is a circle about m
    m = scale(1.0 / far, q)
    low, high = 1.0 / far, math.sqrt(1.0 - 1.0 / (far * far))
    e1 = unit(cross((1.0, 0.0, 0.0) if math.fabs(m[0]) < 0.7 else (0.0, 1.0, 0.0), m))
    e2 = cross(m, e1)
    middle = sub(mat_t_vec(dcm_EC, (low * axes[0] * m[0], low * axes[1] * m[1], low * axes[2] * m[2])), r_C)
    a = mat_t_vec(dcm_EC, (high * axes[0] * e1[0], high * axes[1] * e1[1], high * axes[2] * e1[2]))
    b = mat_t_vec(dcm_EC, (high * axes[0] * e2[0], high * axes[1] * e2[1], high * axes[2] * e2[2]))
    near = middle[2] - math.sqrt(a[2] * a[2] + b[2] * b[2])
    if not near > 1e-6 * norm(middle):
        return 0
    wide = math.sqrt(middle[0] ** 2 + middle[1] ** 2) + math.sqrt(a[0] ** 2 + a[1] ** 2 + b[0] ** 2 + b[1] ** 2)
    n, turn = (FEW, TURN_FEW) if wide < near else (POINTS, TURN)
    # loops without a way out, each number by itself: the compiler then takes several points at once
    for i in range(n):
        c, s = turn[0, i], turn[1, i]
        part = 1.0 / (middle[2] + c * a[2] + s * b[2])
        x, y = part * (middle[0] + c * a[0] + s * b[0]), part * (middle[1] + c * a[1] + s * b[1])
        dz = c * b[2] - s * a[2]
        limb[0, i], limb[1, i] = x, y
        limb[2, i], limb[3, i] = part * (c * b[0] - s * a[0] - x * dz), part * (c * b[1] - s * a[1] - y * dz)
    if lens[5] != 0.0 or lens[6] != 0.0 or lens[7] != 0.0 or lens[8] != 0.0 or lens[9] != 0.0:
        for i in range(n):
            x, y, dx, dy = limb[0, i], limb[1, i], limb[2, i], limb[3, i]
            if x * x + y * y > lens[10]:
                return 0
            xx, xy, yx, yy = distort_slopes(lens, x, y)
            limb[2, i], limb[3, i] = xx * dx + xy * dy, yx * dx + yy * dy
            limb[0, i], limb[1, i] = distort(lens, x, y)
    fx, fy, cx, cy, skew = lens[0], lens[1], lens[2], lens[3], lens[4]
    for i in range(n):
        dx, dy = fx * limb[2, i] + skew * limb[3, i], fy * limb[3, i]
        limb[0, i], limb[1, i] = fx * limb[0, i] + skew * limb[1, i] + cx, fy * limb[1, i] + cy
        limb[2, i] = math.sqrt(dx * dx + dy * dy)
    total = 0.0
    for i in range(n):
        total += limb[2, i]
    part = 1.0 / total
    for i in range(n):
        limb[2, i] *= part
    return n


@compiled
def circle_of_limb(limb: F64, n: int, start: F64) -> V3:
    """Column, row and radius of the circle with the least weighted squares of distances from points [px].

    Gauss-Newton, in which the radius is eliminated: its best value is the mean distance.

    Args:
        limb: points and their shares (WORK, POINTS), work in the last three rows.
        n: how many.
        start: in and out (2,), where the centre lies relative to the points' mean; that of a limb nearby saves a round.
    """
    mx, my, rho = 0.0, 0.0, 0.0
    for i in range(n):
        mx, my = mx + limb[2, i] * limb[0, i], my + limb[2, i] * limb[1, i]
    cx, cy = mx + start[0], my + start[1]
    for _ in range(30):
        for i in range(n):
            dx, dy = limb[0, i] - cx, limb[1, i] - cy
            far = math.sqrt(dx * dx + dy * dy)
            limb[3, i], limb[4, i], limb[5, i] = dx / far, dy / far, far
        a = b = c = d = e = f = g = rho = 0.0
        for i in range(n):
            w, x, y, far = limb[2, i], limb[3, i], limb[4, i], limb[5, i]
            wx, wy = w * x, w * y
            a, b, c, d, e = a + wx, b + wy, c + wx * x, d + wx * y, e + wy * y
            rho, f, g = rho + w * far, f + wx * far, g + wy * far
        c, d, e, f, g = c - a * a, d - a * b, e - b * b, f - a * rho, g - b * rho
        det = c * e - d * d
        dx, dy = (e * f - d * g) / det, (c * g - d * f) / det
        cx, cy, rho = cx + dx, cy + dy, rho - a * dx - b * dy
        if math.fabs(dx) + math.fabs(dy) < 1e-7 * rho:  # each step is 20 to 1000 times smaller than the last
            break
    start[0], start[1] = cx - mx, cy - my
    return (cx, cy, rho)


@compiled
def limb_circle(lens: F64, axes: V3, dcm_EC: M3, r_C: V3, limb: F64, start: F64) -> tuple[bool, V3]:
    """Circle through the whole limb [px], and whether there is one.

    Arguments of `whole_limb`, where ``limb`` is work, and of `circle_of_limb`.
    """
    n = whole_limb(lens, axes, dcm_EC, r_C, limb)
    if n == 0:
        return False, (math.nan, math.nan, math.nan)
    return True, circle_of_limb(limb, n, start)
