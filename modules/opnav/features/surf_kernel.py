"""Box filters of SURF on an integral image, compiled. Grey levels count from 0 to 255 and are scaled to 0 to 1.

An integral image ``total`` (rows + 1, columns + 1) holds at (i, j) the sum of all pixels above row i and left of
column j, as `cv2.integral` gives it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fsw.math.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from messages.base import F64

WORD = 64
"""Numbers of a descriptor."""
SECTOR = math.pi / 3.0
"""Opening of the window in which Haar responses are summed for the orientation."""
MOST = 128
"""Haar responses in a circle of 6 scales: 109 grid points, rounded up."""


@compiled
def box(total: F64, top: int, left: int, height: int, width: int) -> float:
    """Sum of the pixels of a rectangle, cut at the edge of the image."""
    rows, columns = total.shape[0] - 1, total.shape[1] - 1
    i0, j0 = min(max(top, 0), rows), min(max(left, 0), columns)
    i1, j1 = min(max(top + height, 0), rows), min(max(left + width, 0), columns)
    return total[i1, j1] - total[i0, j1] - total[i1, j0] + total[i0, j0]


@compiled
def hessian(total: F64, side: int, step: int, first: int, last: int, out: NDArray[np.float32]) -> None:
    """Determinant of the Hessian by boxes, at every ``step``-th pixel, into the rows ``first`` to ``last`` of ``out``.

    Where the filter leaves the image the determinant is 0.
    """
    lobe, half = side // 3, (side - 1) // 2
    scale = 1.0 / (255.0 * side * side)
    rows, columns = total.shape[0] - 1, total.shape[1] - 1
    for i in range(first, last):
        r = i * step
        for j in range(out.shape[1]):
            c = j * step
            if r < half or c < half or r + half >= rows or c + half >= columns:
                out[i, j] = 0.0
                continue
            t, m = r - lobe + 1, r + lobe
            h, k = c - half, c + half + 1
            p, q = c - lobe // 2, c - lobe // 2 + lobe
            whole = total[m, k] - total[t, k] - total[m, h] + total[t, h]
            centre = total[m, q] - total[t, q] - total[m, p] + total[t, p]
            xx = whole - 3.0 * centre
            t, m = r - half, r + half + 1
            h, k = c - lobe + 1, c + lobe
            p, q = r - lobe // 2, r - lobe // 2 + lobe
            whole = total[m, k] - total[t, k] - total[m, h] + total[t, h]
            centre = total[q, k] - total[p, k] - total[q, h] + total[p, h]
            yy = whole - 3.0 * centre
            a, b, d = r - lobe, r + 1, r + 1 + lobe
            e, f, g = c - lobe, c + 1, c + 1 + lobe
            upper_left = total[r, c] - total[a, c] - total[r, e] + total[a, e]
            upper_right = total[r, g] - total[a, g] - total[r, f] + total[a, f]
            lower_left = total[d, c] - total[b, c] - total[d, e] + total[b, e]
            lower_right = total[d, g] - total[b, g] - total[d, f] + total[b, f]
            xy = upper_right + lower_left - upper_left - lower_right
            xx, yy, xy = scale * xx, scale * yy, 0.9 * scale * xy
            out[i, j] = xx * yy - xy * xy


@compiled
def maxima(
    low: NDArray[np.float32],
    middle: NDArray[np.float32],
    high: NDArray[np.float32],
    side: int,
    side_step: int,
    step: int,
    threshold: float,
    out: F64,
) -> int:
    """Local maxima of the middle layer over place and scale, refined by a parabola through the neighbours.

    Args:
        low: determinants of the next smaller filter.
        middle: those of the filter of ``side``.
        high: those of the next larger one.
        side: of the middle filter [px].
        side_step: difference of the sides [px].
        step: pixels between samples.
        threshold: least determinant.
        out: (n, 4) column, row [px], side of the filter [px], determinant.

    Returns:
        How many rows of ``out`` were written.
    """
    rows, columns = middle.shape
    n = 0
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            here = middle[i, j]
            if here < threshold or not _highest(low, middle, high, i, j):
                continue
            x, y, z = _vertex(low, middle, high, i, j)
            if math.fabs(x) > 0.7 or math.fabs(y) > 0.7 or math.fabs(z) > 0.7 or n >= out.shape[0]:
                continue
            out[n, 0], out[n, 1] = (j + x) * step, (i + y) * step
            out[n, 2], out[n, 3] = side + z * side_step, here
            n += 1
    return n


@compiled
def _highest(low: NDArray[np.float32], middle: NDArray[np.float32], high: NDArray[np.float32], i: int, j: int) -> bool:
    """Whether all 26 neighbours are lower."""
    here = middle[i, j]
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            if low[a, b] >= here or high[a, b] >= here:
                return False
            if (a != i or b != j) and middle[a, b] >= here:
                return False
    return True


@compiled
def _vertex(
    low: NDArray[np.float32], middle: NDArray[np.float32], high: NDArray[np.float32], i: int, j: int
) -> tuple[float, float, float]:
    """Offset of the maximum from a sample (Brown and Lowe 2002), in samples (x, y, layer); NaN if none."""
    v = float(middle[i, j])
    gx = 0.5 * (middle[i, j + 1] - middle[i, j - 1])
    gy = 0.5 * (middle[i + 1, j] - middle[i - 1, j])
    gz = 0.5 * (high[i, j] - low[i, j])
    xx = middle[i, j + 1] + middle[i, j - 1] - 2.0 * v
    yy = middle[i + 1, j] + middle[i - 1, j] - 2.0 * v
    zz = high[i, j] + low[i, j] - 2.0 * v
    xy = 0.25 * (middle[i + 1, j + 1] - middle[i + 1, j - 1] - middle[i - 1, j + 1] + middle[i - 1, j - 1])
    xz = 0.25 * (high[i, j + 1] - high[i, j - 1] - low[i, j + 1] + low[i, j - 1])
    yz = 0.25 * (high[i + 1, j] - high[i - 1, j] - low[i + 1, j] + low[i - 1, j])
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * a + xy * b + xz * c
    if det == 0.0:
        return math.nan, math.nan, math.nan
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    x, y, z = a * gx + b * gy + c * gz, b * gx + d * gy + e * gz, c * gx + e * gy + f * gz
    return -x / det, -y / det, -z / det


@compiled
def haar(total: F64, row: int, column: int, half: int) -> tuple[float, float]:
    """Haar responses dx (right less left), dy (lower less upper) of a square of side 2 ``half`` about a corner."""
    left = box(total, row - half, column - half, 2 * half, half)
    right = box(total, row - half, column, 2 * half, half)
    upper = box(total, row - half, column - half, half, 2 * half)
    lower = box(total, row, column - half, half, 2 * half)
    return right - left, lower - upper


@compiled
def orient(total: F64, x: float, y: float, size: float) -> float:
    """Orientation [rad] of a feature at column ``x`` and row ``y`` of ``size`` [px]: Haar responses within 6 sizes."""
    dx, dy, angle = np.empty(MOST), np.empty(MOST), np.empty(MOST)
    half = max(1, int(2.0 * size + 0.5))
    n = 0
    for i in range(-6, 7):
        for j in range(-6, 7):
            distance = i * i + j * j
            if distance > 36:
                continue
            a, b = haar(total, int(y + i * size + 1.0), int(x + j * size + 1.0), half)
            weight = math.exp(-distance / 8.0)
            dx[n], dy[n] = weight * a, weight * b
            angle[n] = math.atan2(dy[n], dx[n])
            n += 1
    best, best_x, best_y = -1.0, 1.0, 0.0
    for start in range(n):
        sum_x, sum_y = 0.0, 0.0
        for k in range(n):
            beyond = angle[k] - angle[start]
            if beyond < 0.0:
                beyond += 2.0 * math.pi
            if beyond < SECTOR:
                sum_x += dx[k]
                sum_y += dy[k]
        length = sum_x * sum_x + sum_y * sum_y
        if length > best:
            best, best_x, best_y = length, sum_x, sum_y
    return math.atan2(best_y, best_x)


@compiled
def describe(total: F64, x: float, y: float, size: float, angle: float, out: NDArray[np.float32]) -> None:
    """The descriptor, of unit length, into ``out`` (64,): 4 x 4 regions of 5 x 5 samples, one size apart."""
    c, s = math.cos(angle), math.sin(angle)
    half = max(1, int(size + 0.5))
    for k in range(WORD):
        out[k] = 0.0
    for i in range(20):
        v = (i - 9.5) * size
        for j in range(20):
            u = (j - 9.5) * size
            column, row = x + c * u - s * v, y + s * u + c * v
            a, b = haar(total, math.floor(row + 1.0), math.floor(column + 1.0), half)
            weight = math.exp(-((i - 9.5) ** 2 + (j - 9.5) ** 2) / (2.0 * 3.3 * 3.3))
            along, across = weight * (c * a + s * b), weight * (c * b - s * a)
            k = 4 * (4 * (i // 5) + j // 5)
            out[k] += along
            out[k + 1] += across
            out[k + 2] += math.fabs(along)
            out[k + 3] += math.fabs(across)
    square = 0.0
    for k in range(WORD):
        square += out[k] * out[k]
    if square > 0.0:
        scale = 1.0 / math.sqrt(square)
        for k in range(WORD):
            out[k] *= scale
