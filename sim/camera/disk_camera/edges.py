"""Blur of sharp edges: light near a limb is kept where it falls, on a grid of half pixels, until optics has spread it.

Light that is summed over pixels first and blurred then puts the limb up to a few hundredths of a pixel from its place.
A ray is shared between the four nearest cells (convolution with a triangle, variance 1/24 px^2 each way); any other
pixel is spread over itself with the slope that its neighbours give; the Gaussian that follows is narrower by the
variance of the triangle.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from messages.base import F64

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
TILE = 32
"""Rows and columns that are blurred at a time."""
_TRIANGLE = 1.0 / 24.0
_EVENLY = (0.0625, 0.4375, 0.4375, 0.0625)
"""Parts of an evenly lit pixel in the four cells around its middle, each way, by the triangle."""
_RAMP = (-5.0 / 192.0, -17.0 / 192.0, 17.0 / 192.0, 5.0 / 192.0)
"""What light that grows by 1 in a pixel adds to them."""
_STEEPEST = 1.2
"""Growth, each way, to the light of the pixel: 2 * 1.2 * 5 / 192 = 0.0625."""


def weights(sigma_px: float) -> F64:
    """Parts of the light of the cells that a pixel gets, one way, (n,): cells 2 q - n/2 + 1 to 2 q + n/2 of pixel q.

    A Gaussian of ``sigma_px`` less the triangle, integrated over the pixel.
    """
    sigma = math.sqrt(max(sigma_px * sigma_px - _TRIANGLE, 1e-6))
    reach = math.ceil(10.0 * sigma) + 2
    away = (np.arange(1 - reach, reach + 1) - 0.5) / 2.0
    root = sigma * math.sqrt(2.0)
    part = np.array([0.5 * (math.erf((d + 0.5) / root) - math.erf((d - 0.5) / root)) for d in away.tolist()])
    return part * (2.0 / part.sum())


@compiled
def spread(
    rays: F64,
    count: int,
    swapped: bool,
    factor: float,
    covered: float,
    i: int,
    j: int,
    out: F32,
    fine: F32,
    edge: U8,
    four: F64,
) -> None:
    """Share the light of a pixel between cells, or forget what a body behind it has put there.

    Args:
        rays: (n, 3), places in the pixel along and across, and light. count: of rays; 0 for a pixel without a limb.
        swapped: whether along is down. factor: on the light. covered: part of what is behind that is hidden.
        i: row of the pixel. j: its column. out: (H, W), light so far, read only. fine: (2 H + 2, 2 W + 2), cells; a
            pixel has rows 2 i + 1 and 2 i + 2. edge: (H, W), whether the light of a pixel is in ``fine``.
        four: (16,) zeros, for work.
    """
    if count == 0:
        if edge[i, j] != 0 and covered == 1.0:
            edge[i, j] = 0
            fine[2 * i + 1 : 2 * i + 3, 2 * j + 1 : 2 * j + 3] = 0.0
        return
    left = np.float32(1.0 - covered)
    if edge[i, j] != 0:
        fine[2 * i + 1 : 2 * i + 3, 2 * j + 1 : 2 * j + 3] *= left
    elif out[i, j] > 0.0:
        for a in range(4):
            for b in range(4):
                fine[2 * i + a, 2 * j + b] += np.float32(_EVENLY[a] * _EVENLY[b]) * left * out[i, j]
    edge[i, j] = 1
    first, second = (1, 0) if swapped else (0, 1)
    for k in range(count):
        u, v, light = rays[k, first], rays[k, second], factor * rays[k, 2]
        x, y = 2.0 * u + 1.5, 2.0 * v + 1.5  # in cells from the middle of the first of four
        b, a = int(x), int(y)
        x, y = x - b, y - a
        n = 4 * a + b
        four[n] += (1.0 - y) * (1.0 - x) * light
        four[n + 1] += (1.0 - y) * x * light
        four[n + 4] += y * (1.0 - x) * light
        four[n + 5] += y * x * light
    for a in range(4):
        for b in range(4):
            fine[2 * i + a, 2 * j + b] += np.float32(four[4 * a + b])
            four[4 * a + b] = 0.0


@compiled
def _slope(light: F32, edge: U8, i: int, j: int, down: int, right: int) -> np.float32:
    """Growth of the light from pixel to pixel, from those neighbours that have no limb.

    Not more than leaves light in every cell: beside a star a straight line would run below zero.
    """
    total, count = np.float32(0.0), 0
    for sign in (-1, 1):
        a, b = i + sign * down, j + sign * right
        if 0 <= a < light.shape[0] and 0 <= b < light.shape[1] and edge[a, b] == 0:
            total += np.float32(sign) * (light[a, b] - light[i, j])
            count += 1
    most = np.float32(_STEEPEST) * light[i, j]
    return min(max(total / np.float32(max(count, 1)), -most), most)


@compiled
def blur_tile(top: int, left: int, light: F32, fine: F32, edge: U8, weight: F32, out: F32) -> None:
    """Blur the pixels of a tile into ``out`` (H, W).

    Args:
        top: first row of the tile. left: its first column. light: (H, W) of all pixels; beyond the border it goes on as
            at the border. fine, edge: as in `spread`. weight: of `weights`, (n,).
    """
    height, width = light.shape
    half = weight.shape[0] // 2
    margin = half // 2 + 1  # pixels around the tile
    rows, columns = min(TILE, height - top), min(TILE, width - left)
    cells = np.zeros((2 * (rows + 2 * margin) + 2, 2 * (columns + 2 * margin) + 2), np.float32)
    for m in range(rows + 2 * margin):
        i = top - margin + m
        inside = 0 <= i < height
        i = min(max(i, 0), height - 1)
        for n in range(columns + 2 * margin):
            j = left - margin + n
            within = inside and 0 <= j < width
            j = min(max(j, 0), width - 1)
            if within and edge[i, j] != 0:
                continue
            value = light[i, j]
            if value != 0.0:
                right = np.float32(_slope(light, edge, i, j, 0, 1) if within else 0.0)
                down = np.float32(_slope(light, edge, i, j, 1, 0) if within else 0.0)
                for a in range(4):
                    even = np.float32(_EVENLY[a])
                    part = even * value + np.float32(_RAMP[a]) * down
                    for b in range(4):
                        cells[2 * m + a, 2 * n + b] += (
                            np.float32(_EVENLY[b]) * part + np.float32(_RAMP[b]) * even * right
                        )
    first, leftmost = 2 * (top - margin), 2 * (left - margin)
    for m in range(max(-first, 0), min(cells.shape[0], fine.shape[0] - first)):
        for n in range(max(-leftmost, 0), min(cells.shape[1], fine.shape[1] - leftmost)):
            cells[m, n] += fine[first + m, leftmost + n]
    down = np.zeros((rows, cells.shape[1]), np.float32)
    start = 2 * margin + 2 - half  # cell of the first weight of the first pixel
    for i in range(rows):
        for k in range(weight.shape[0]):
            w, line, total = weight[k], cells[start + 2 * i + k], down[i]
            for n in range(line.shape[0]):
                total[n] += w * line[n]
    for i in range(rows):
        line, total = down[i], out[top + i]
        for j in range(columns):
            total[left + j] = 0.0
        for k in range(weight.shape[0]):
            for j in range(columns):
                total[left + j] += weight[k] * line[start + 2 * j + k]
        for j in range(columns):
            total[left + j] = max(total[left + j], np.float32(0.0))  # rounding


@compiled
def mark(edge: U8, reach: int, near: U8) -> None:
    """Mark the tiles (n, m) that a pixel of ``edge`` (H, W) is in, or up to ``reach`` pixels away from."""
    height, width = edge.shape
    for i in range(height):
        a, b = max(i - reach, 0) // TILE, min(i + reach, height - 1) // TILE
        for j in range(width):
            if edge[i, j] != 0:
                c, d = max(j - reach, 0) // TILE, min(j + reach, width - 1) // TILE
                near[a : b + 1, c : d + 1] = 1
