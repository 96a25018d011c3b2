"""The circle that the disk of an ellipsoid looks like, as in the pixel and line converter, but made for whole limbs.

The model is the same: the circle with the least sum of squared distances from the limb in the image, all parts of it
weighing the same. A whole limb is periodic, so sums over evenly spaced points converge faster than any power of their
number if the length that each stands for is exact; it comes from derivatives here, and 32 points are enough.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.camera import distort, distort_slopes
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, cross, mat_t_vec, matvec, norm, scale, sub, unit
from messages.base import F64

POINTS = 32
"""Points of the limb."""
_ANGLE = (2.0 * np.pi / POINTS) * np.arange(POINTS)
TURN = np.column_stack([np.cos(_ANGLE), np.sin(_ANGLE)])
"""Cosine and sine of the points' places."""


@compiled
def whole_limb(lens: F64, axes: V3, dcm_EC: M3, r_C: V3, limb: F64) -> bool:
    """Points of the limb and the lengths they stand for.

    Args:
        lens: lens vector (11,).
        axes: semi-axes along x, y, z of E [m].
        dcm_EC: maps C to E components, E being fixed to the body.
        r_C: camera relative to the body's centre [m].
        limb: out (POINTS, 3): column, row [px], and the share of the whole length.

    Returns:
        Whether the camera is outside the body and all points lie inside the lens.
    """
    r_E = matvec(dcm_EC, r_C)
    q = (r_E[0] / axes[0], r_E[1] / axes[1], r_E[2] / axes[2])
    far = norm(q)
    if not far > 1.0:
        return False
    # where the body is a unit sphere, the limb is a circle about m
    m = scale(1.0 / far, q)
    low, high = 1.0 / far, math.sqrt(1.0 - 1.0 / (far * far))
    e1 = unit(cross((1.0, 0.0, 0.0) if math.fabs(m[0]) < 0.7 else (0.0, 1.0, 0.0), m))
    e2 = cross(m, e1)
    middle = sub(mat_t_vec(dcm_EC, (low * axes[0] * m[0], low * axes[1] * m[1], low * axes[2] * m[2])), r_C)
    a = mat_t_vec(dcm_EC, (high * axes[0] * e1[0], high * axes[1] * e1[1], high * axes[2] * e1[2]))
    b = mat_t_vec(dcm_EC, (high * axes[0] * e2[0], high * axes[1] * e2[1], high * axes[2] * e2[2]))
    bent = lens[5] != 0.0 or lens[6] != 0.0 or lens[7] != 0.0 or lens[8] != 0.0 or lens[9] != 0.0
    total = 0.0
    for i in range(POINTS):
        c, s = TURN[i, 0], TURN[i, 1]
        z = middle[2] + c * a[2] + s * b[2]
        if not z > 0.0:
            return False
        x, y = (middle[0] + c * a[0] + s * b[0]) / z, (middle[1] + c * a[1] + s * b[1]) / z
        dz = c * b[2] - s * a[2]
        dx, dy = (c * b[0] - s * a[0] - x * dz) / z, (c * b[1] - s * a[1] - y * dz) / z
        if x * x + y * y > lens[10]:
            return False
        if bent:
            xx, xy, yx, yy = distort_slopes(lens, x, y)
            dx, dy = xx * dx + xy * dy, yx * dx + yy * dy
            x, y = distort(lens, x, y)
        dx, dy = lens[0] * dx + lens[4] * dy, lens[1] * dy
        limb[i, 0], limb[i, 1] = lens[0] * x + lens[4] * y + lens[2], lens[1] * y + lens[3]
        limb[i, 2] = math.sqrt(dx * dx + dy * dy)
        total += limb[i, 2]
    for i in range(POINTS):
        limb[i, 2] /= total
    return True


@compiled
def circle_of_limb(limb: F64) -> V3:
    """Column, row and radius of the circle with the least weighted squares of distances from points (n, 3) [px].

    Gauss-Newton, in which the radius is eliminated: its best value is the mean distance.
    """
    n = limb.shape[0]
    cx, cy, rho = 0.0, 0.0, 0.0
    for i in range(n):
        cx, cy = cx + limb[i, 2] * limb[i, 0], cy + limb[i, 2] * limb[i, 1]
    for _ in range(30):
        a = b = c = d = e = f = g = rho = 0.0
        for i in range(n):
            w, dx, dy = limb[i, 2], limb[i, 0] - cx, limb[i, 1] - cy
            far = math.sqrt(dx * dx + dy * dy)
            part = 1.0 / far
            x, y = part * dx, part * dy
            a, b, c, d, e = a + w * x, b + w * y, c + w * x * x, d + w * x * y, e + w * y * y
            rho, f, g = rho + w * far, f + w * dx, g + w * dy
        c, d, e, f, g = c - a * a, d - a * b, e - b * b, f - a * rho, g - b * rho
        det = c * e - d * d
        dx, dy = (e * f - d * g) / det, (c * g - d * f) / det
        cx, cy, rho = cx + dx, cy + dy, rho - a * dx - b * dy
        if math.fabs(dx) + math.fabs(dy) < 1e-7 * rho:  # each step is 20 to 1000 times smaller than the last
            break
    return (cx, cy, rho)


@compiled
def limb_circle(lens: F64, axes: V3, dcm_EC: M3, r_C: V3, limb: F64) -> tuple[bool, V3]:
    """Circle through the whole limb [px], and whether there is one; arguments of `whole_limb`, ``limb`` is work."""
    if not whole_limb(lens, axes, dcm_EC, r_C, limb):
        return False, (math.nan, math.nan, math.nan)
    return True, circle_of_limb(limb)
