"""Chips as a camera would see them, and their fine matching with a covariance, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fsw.math.camera import undistort_point
from fsw.math.compiled import compiled
from fsw.math.geodesy import A, enu_dcm

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from messages.base import F64

ROUNDS = 8
"""Most steps of the fine matching."""
SETTLED_PX = 0.002
BLOCK = 8
"""Residuals this many pixels apart are taken as independent."""
OUT = 8
"""Numbers that `refine` gives."""


@compiled
def back_project(
    lens: F64,
    r_CE_E: F64,
    dcm_CE: F64,
    lat: F64,
    lon: F64,
    r_LE_E: F64,
    slope: F64,
    gsd: F64,
    centre: NDArray[np.int64],
    reach: int,
    middle: float,
    out: F64,
) -> None:
    """Which places of their chips nine pixels around each landmark see.

    The ray is cut with the ground near the landmark: its slope, and the fall of the Earth's curve.

    Args:
        lens: lens vector (11,).
        r_CE_E: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: maps Earth-fixed to camera components (3, 3).
        lat: latitude of the landmarks (n,) [rad].
        lon: longitude (n,) [rad].
        r_LE_E: Earth-fixed (n, 3) [m].
        slope: of the ground to east and north (n, 2).
        gsd: size of a pixel of the chips (n,) [m].
        centre: middle pixels (n, 2), column and row.
        reach: pixels from the middle to the outer ones.
        middle: column and row of the landmark in its chip.
        out: out, (n, 3, 3, 2), column and row in the chip, by row and column of the nine pixels; NaN if one sees no
            ground.
    """
    axes = np.empty((3, 3))
    for k in range(r_LE_E.shape[0]):
        enu_dcm(lat[k], lon[k], axes)
        dx, dy, dz = r_CE_E[0] - r_LE_E[k, 0], r_CE_E[1] - r_LE_E[k, 1], r_CE_E[2] - r_LE_E[k, 2]
        oe = axes[0, 0] * dx + axes[0, 1] * dy + axes[0, 2] * dz
        on = axes[1, 0] * dx + axes[1, 1] * dy + axes[1, 2] * dz
        ou = axes[2, 0] * dx + axes[2, 1] * dy + axes[2, 2] * dz
        for i in range(3):
            for j in range(3):
                x, y = undistort_point(lens, centre[k, 0] + reach * (j - 1.0), centre[k, 1] + reach * (i - 1.0))
                rx = dcm_CE[0, 0] * x + dcm_CE[1, 0] * y + dcm_CE[2, 0]
                ry = dcm_CE[0, 1] * x + dcm_CE[1, 1] * y + dcm_CE[2, 1]
                rz = dcm_CE[0, 2] * x + dcm_CE[1, 2] * y + dcm_CE[2, 2]
                re = axes[0, 0] * rx + axes[0, 1] * ry + axes[0, 2] * rz
                rn = axes[1, 0] * rx + axes[1, 1] * ry + axes[1, 2] * rz
                ru = axes[2, 0] * rx + axes[2, 1] * ry + axes[2, 2] * rz
                if not ru < 0.0:
                    out[k, i, j, 0], out[k, i, j, 1] = math.nan, math.nan
                    continue
                east, north, up = 0.0, 0.0, 0.0
                for _ in range(5):
                    t = (up - ou) / ru
                    east, north = oe + t * re, on + t * rn
                    up = slope[k, 0] * east + slope[k, 1] * north - (east * east + north * north) / (2.0 * A)
                out[k, i, j, 0] = middle + east / gsd[k]
                out[k, i, j, 1] = middle - north / gsd[k]


@compiled
def warp_chips(
    chips: NDArray[np.uint8], index: NDArray[np.int64], nodes: F64, reach: int, out: NDArray[np.uint8], whole: F64
) -> None:
    """Chips as seen, by a quadratic through the nine places of `back_project`, bilinear between pixels.

    Args:
        chips: of the catalogue (m, size, size).
        index: which of them (n,).
        nodes: (n, 3, 3, 2).
        reach: as in `back_project`.
        out: out, (n, 2 reach + 1, 2 reach + 1); pixels beyond the chip take the value at its edge.
        whole: out, (n,), share of the pixels that lie on the chip; 0 if nodes are NaN.
    """
    size = chips.shape[1]
    width = 2 * reach + 1
    base = np.empty((width, 3))
    for i in range(width):
        x = (i - reach) / reach
        base[i, 0], base[i, 1], base[i, 2] = 0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)
    for k in range(index.shape[0]):
        chip = chips[index[k]]
        known = True
        for i in range(3):
            for j in range(3):
                known = known and not math.isnan(nodes[k, i, j, 0])
        count = 0
        for i in range(width):
            p0, p1, p2 = 0.0, 0.0, 0.0
            q0, q1, q2 = 0.0, 0.0, 0.0
            for a in range(3):
                p0, p1, p2 = (
                    p0 + base[i, a] * nodes[k, a, 0, 0],
                    p1 + base[i, a] * nodes[k, a, 1, 0],
                    p2 + base[i, a] * nodes[k, a, 2, 0],
                )
                q0, q1, q2 = (
                    q0 + base[i, a] * nodes[k, a, 0, 1],
                    q1 + base[i, a] * nodes[k, a, 1, 1],
                    q2 + base[i, a] * nodes[k, a, 2, 1],
                )
            for j in range(width):
                if not known:
                    out[k, i, j] = 0
                    continue
                x = base[j, 0] * p0 + base[j, 1] * p1 + base[j, 2] * p2
                y = base[j, 0] * q0 + base[j, 1] * q1 + base[j, 2] * q2
                if -0.5 <= x <= size - 0.5 and -0.5 <= y <= size - 0.5:
                    count += 1
                x, y = min(max(x, 0.0), size - 1.0), min(max(y, 0.0), size - 1.0)
                c, r = min(int(x), size - 2), min(int(y), size - 2)
                a, b = x - c, y - r
                low = chip[r, c] * (1.0 - a) + chip[r, c + 1] * a
                high = chip[r + 1, c] * (1.0 - a) + chip[r + 1, c + 1] * a
                out[k, i, j] = int(low * (1.0 - b) + high * b + 0.5)
        whole[k] = count / (width * width)


@compiled
def cubic(t: float, out: F64) -> None:
    """Weights (4,) of the convolution by cubics (Keys 1981) for a place ``t`` past the second of four pixels."""
    s = t * t
    out[0] = 0.5 * (-t + 2.0 * s - s * t)
    out[1] = 0.5 * (2.0 - 5.0 * s + 3.0 * s * t)
    out[2] = 0.5 * (t + 4.0 * s - 3.0 * s * t)
    out[3] = 0.5 * (-s + s * t)


@compiled
def refine(
    photo: NDArray[np.float32],
    template: NDArray[np.float32],
    weight: F64,
    u: float,
    v: float,
    work: F64,
    out: F64,
) -> None:
    """Least-squares matching of one template: translation, gain and offset, by Gauss-Newton (Foerstner 1982).

    The template's gradient is used, so that the normal matrix stays (Baker and Matthews 2004, inverse compositional).
    The covariance is H^-1 M H^-1 with H the normal matrix and M the sum over blocks of BLOCK x BLOCK pixels of the
    outer product of the block's summed gradient times residual: residuals of another season or sensor are no
    white noise, and neighbouring ones go together (White 1980; Liang and Zeger 1986 for the blocks).

    Args:
        photo: (rows, columns).
        template: (2 h + 3, 2 h + 3), one pixel more on each side than is compared.
        weight: (2 h + 1, 2 h + 1).
        u: column at which the template's middle is expected, to a pixel or so.
        v: row likewise.
        work: scratch, (2 h + 1, 2 h + 1).
        out: out, OUT numbers: column, row [px]; covariance xx, xy, yy [px^2]; weighted normalised correlation; the same
            of the middle, a third as wide; gain. NaN if it does not settle within 2 px of the start.
    """
    half = weight.shape[0] // 2
    rows, columns = photo.shape
    for i in range(out.shape[0]):
        out[i] = math.nan
    normal, right, total = np.zeros((4, 4)), np.zeros(4), 0.0
    mean = 0.0
    for i in range(2 * half + 1):
        for j in range(2 * half + 1):
            total += weight[i, j]
            mean += weight[i, j] * template[i + 1, j + 1]
    mean /= total
    line = np.empty(4)
    for i in range(2 * half + 1):
        for j in range(2 * half + 1):
            line[0] = 0.5 * (template[i + 1, j + 2] - template[i + 1, j])
            line[1] = 0.5 * (template[i + 2, j + 1] - template[i, j + 1])
            line[2], line[3] = template[i + 1, j + 1] - mean, 1.0
            for a in range(4):
                for b in range(4):
                    normal[a, b] += weight[i, j] * line[a] * line[b]
    product = normal[0, 0] * normal[1, 1]
    if not (product - normal[0, 1] ** 2 > 1e-6 * product and normal[2, 2] > 0.0):
        return
    inverse: F64 = np.linalg.inv(normal)  # pyright: ignore[reportAssignmentType] (its stub is wider)
    x, y = u, v
    wx, wy, best = np.empty(4), np.empty(4), np.empty(4)
    settled, size = False, math.inf
    for _ in range(ROUNDS):
        left, top = math.floor(x), math.floor(y)
        if left - half - 1 < 0 or top - half - 1 < 0 or left + half + 2 >= columns or top + half + 2 >= rows:
            return
        cubic(x - left, wx)
        cubic(y - top, wy)
        for a in range(4):
            right[a] = 0.0
        for i in range(2 * half + 1):
            for j in range(2 * half + 1):
                value = 0.0
                r, c = top + i - half - 1, left + j - half - 1
                for a in range(4):
                    value += wy[a] * (
                        wx[0] * photo[r + a, c]
                        + wx[1] * photo[r + a, c + 1]
                        + wx[2] * photo[r + a, c + 2]
                        + wx[3] * photo[r + a, c + 3]
                    )
                work[i, j] = value
                w = weight[i, j] * value
                right[0] += w * 0.5 * (template[i + 1, j + 2] - template[i + 1, j])
                right[1] += w * 0.5 * (template[i + 2, j + 1] - template[i, j + 1])
                right[2] += w * (template[i + 1, j + 1] - mean)
                right[3] += w
        for a in range(4):
            best[a] = 0.0
            for b in range(4):
                best[a] += inverse[a, b] * right[b]
        if not best[2] > 0.0:
            return
        # The photo is the template moved by (step): gain * template(p + step) fits photo(p + place)
        dx, dy = best[0] / best[2], best[1] / best[2]
        size = math.hypot(dx, dy)
        limit = min(1.0, 0.7 / max(size, 1e-9))
        if size < SETTLED_PX:
            settled = True
            break
        x, y = x - limit * dx, y - limit * dy
        if math.fabs(x - u) > 2.0 or math.fabs(y - v) > 2.0:
            return
    if not settled and size > 0.05:
        return
    _judge(template, weight, work, inverse, best, mean, total, out)
    out[0], out[1] = x, y


@compiled
def _judge(
    template: NDArray[np.float32],
    weight: F64,
    work: F64,
    inverse: F64,
    best: F64,
    mean: float,
    total: float,
    out: F64,
) -> None:
    """Covariance, correlations and gain of a settled match, into ``out``."""
    half = weight.shape[0] // 2
    blocks = -(-weight.shape[0] // BLOCK)
    sums = np.zeros((blocks * blocks, 4))
    photo_mean = 0.0
    for i in range(2 * half + 1):
        for j in range(2 * half + 1):
            photo_mean += weight[i, j] * work[i, j] / total
    pp, tt, pt = 0.0, 0.0, 0.0
    third = (2 * half + 1) // 6
    n, sp, st, spp, stt, spt = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(2 * half + 1):
        for j in range(2 * half + 1):
            gx = 0.5 * (template[i + 1, j + 2] - template[i + 1, j])
            gy = 0.5 * (template[i + 2, j + 1] - template[i, j + 1])
            t, p, w = template[i + 1, j + 1] - mean, work[i, j], weight[i, j]
            residual = w * (p - best[0] * gx - best[1] * gy - best[2] * t - best[3])
            k = (i // BLOCK) * blocks + j // BLOCK
            sums[k, 0] += residual * gx
            sums[k, 1] += residual * gy
            sums[k, 2] += residual * t
            sums[k, 3] += residual
            pp += w * (p - photo_mean) ** 2
            tt += w * t * t
            pt += w * (p - photo_mean) * t
            if abs(i - half) <= third and abs(j - half) <= third:
                n, sp, st = n + 1, sp + p, st + t
                spp, stt, spt = spp + p * p, stt + t * t, spt + p * t
    grow = blocks * blocks / (blocks * blocks - 4.0) / (best[2] * best[2])
    for a in range(2):
        for b in range(a, 2):
            value = 0.0
            for k in range(blocks * blocks):
                left, right = 0.0, 0.0
                for c in range(4):
                    left += inverse[a, c] * sums[k, c]
                    right += inverse[b, c] * sums[k, c]
                value += left * right
            out[2 + a + b] = grow * value
    out[5] = pt / math.sqrt(max(pp * tt, 1e-12))
    spread = (spp - sp * sp / n) * (stt - st * st / n)
    out[6] = (spt - sp * st / n) / math.sqrt(max(spread, 1e-12))
    out[7] = best[2]


@compiled
def refine_all(
    photo: NDArray[np.float32], templates: NDArray[np.float32], weight: F64, start: F64, first: int, step: int, out: F64
) -> None:
    """`refine` for every ``step``-th template from ``first`` on, from the places ``start`` (n, 2), into (n, OUT)."""
    work = np.empty(weight.shape)
    for k in range(first, templates.shape[0], step):
        refine(photo, templates[k], weight, start[k, 0], start[k, 1], work, out[k])
