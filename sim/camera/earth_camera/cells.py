"""Pictures of 16 x 16 pixels, the cells between nodes: which may be drawn at once, and how. Compiled.

Rows of pixels are one after the other as four numbers a pixel (red, green, blue, coverage), so that loops are long and
even, which a compiler can vectorise.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from messages.base import F64
from sim.camera.earth_camera.kernel import F32, FULL, U8, U16, Number, decay
from sim.camera.earth_camera.sampler import level_of

COVERED = int(0.999 * FULL)
"""Coverage that counts as whole."""
SIDE = 16
"""Pixels along a cell."""


@compiled
def smooth_cells(at: F64, prints: F32, rows: int, columns: int, most: float, free: U8, use: U8) -> None:
    """Choose the cells in which columns and rows of the map may be interpolated between the nodes.

    Args:
        at: column and row of the map at the nodes (n, m, 2).
        prints: as of `footprints`.
        rows: of the map window.
        columns: of the map window.
        most: largest error of the interpolation, from second differences [px of the camera].
        free: in and out (n - 1, m - 1): 1 for cells that no finer map touches.
        use: out, 1 for the cells to be interpolated.
    """
    last_i, last_j = at.shape[0] - 1, at.shape[1] - 1
    for i in range(use.shape[0]):
        for j in range(use.shape[1]):
            bent, low_x, high_x, low_y, high_y = 0.0, math.inf, -math.inf, math.inf, -math.inf
            known = True
            for k in range(i, i + 2):
                for m in range(j, j + 2):
                    x, y = at[k, m, 0], at[k, m, 1]
                    known = known and not math.isnan(x)
                    low_x, high_x = min(low_x, x), max(high_x, x)
                    low_y, high_y = min(low_y, y), max(high_y, y)
                    r, c = min(max(k, 1), last_i - 1), min(max(m, 1), last_j - 1)
                    for n in range(2):
                        down = at[r - 1, m, n] - 2.0 * at[r, m, n] + at[r + 1, m, n]
                        across = at[k, c - 1, n] - 2.0 * at[k, c, n] + at[k, c + 1, n]
                        error = 0.125 * (math.fabs(down) + math.fabs(across))
                        bent = error if not error <= bent else bent
            inside = low_x >= 0.0 and high_x <= columns - 1.0 and low_y >= 0.0 and high_y <= rows - 1.0
            octave = prints[i, j, 0]
            fine = bent <= most * 2.0**octave and prints[i, j, 1] == 1.0
            use[i, j] = 1 if free[i, j] == 1 and known and inside and fine else 0
            away = high_x < -1.0 or low_x > columns or high_y < -1.0 or low_y > rows
            if not (known and away):
                free[i, j] = 0


@compiled
def node_colours(light: F32, mass: F32, path: F32, depth: F64, gain: float, colour: F32) -> None:
    """Factor on the map and added light of each channel at the nodes, into ``colour`` (n, m, 8).

    Numbers 3 and 7 mean nothing. The map's values are 0 to FULL.
    """
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            colour[i, j, 3], colour[i, j, 7] = 0.0, 0.0
            for c in range(3):
                through = decay(mass[i, j] * depth[c])
                colour[i, j, c] = gain / FULL * light[i, j] * through
                colour[i, j, c + 4] = gain * path[i, j] * (1.0 - through)


@compiled
def nearest_corner(at: F64, first: int, last: int, raster: int, rows: int, columns: int) -> tuple[int, int]:
    """The pixel (column, row) of a map before all that some rows of cells see of it, on a coarse raster.

    Args:
        at: columns and rows of the map at the nodes (n, m, 2); NaN where there is no ground.
        first: row of cells.
        last: the row after the last one.
        raster: columns and rows of the pixel are multiples of it.
        rows: of the map.
        columns: of the map.

    Returns:
        -1, -1 if they see no ground.
    """
    x, y = math.inf, math.inf
    for i in range(first, last + 1):
        for j in range(at.shape[1]):
            x = min(x, at[i, j, 0])
            y = min(y, at[i, j, 1])
    if x == math.inf:
        return -1, -1
    left, top = min(max(x, 0.0), columns - 1.0), min(max(y, 0.0), rows - 1.0)
    return int(left) // raster * raster, int(top) // raster * raster


@compiled
def _spread(a: Number, slope: Number, run: F32) -> None:
    for k in range(run.shape[0]):
        run[k] = a + np.float32(k) * slope


@compiled
def spread_places(at: F64, first: int, left: int, x0: float, y0: float, x: F32, y: F32) -> None:
    """Places on the map at the pixels of rows of cells, bilinear between the nodes.

    Args:
        at: columns and rows of the map at the nodes (n, m, 2).
        first: row of cells.
        left: first column of cells.
        x0: column of the map that is 0 in x.
        y0: row that is 0 in y.
        x: out, (rows, columns) of pixels.
        y: out.
    """
    per = 1.0 / SIDE
    for i in range(x.shape[0]):
        n, q = first + i // SIDE, (i % SIDE) * per
        for m in range((x.shape[1] + SIDE - 1) // SIDE):
            a, b, c, d = at[n, left + m], at[n, left + m + 1], at[n + 1, left + m], at[n + 1, left + m + 1]
            start, stop = m * SIDE, min((m + 1) * SIDE, x.shape[1])
            begin, end = a[0] + q * (c[0] - a[0]), b[0] + q * (d[0] - b[0])
            _spread(np.float32(begin - x0), np.float32((end - begin) * per), x[i, start:stop])
            begin, end = a[1] + q * (c[1] - a[1]), b[1] + q * (d[1] - b[1])
            _spread(np.float32(begin - y0), np.float32((end - begin) * per), y[i, start:stop])


@compiled
def _all_inside(x: F32, y: F32, want: U8, right: float, bottom: float) -> int:
    count = 0
    for k in range(x.shape[0]):
        within = (x[k] >= 0.0) & (x[k] <= right) & (y[k] >= 0.0) & (y[k] <= bottom) & (want[k] == 1)
        count += 1 if within else 0
    return 1 if count == x.shape[0] else 0


@compiled
def easy_cells(
    x: F32, y: F32, right: float, bottom: float, want: U8, first: int, left: int, prints: F32, use: U8
) -> int:
    """Choose the cells of a band that are on a map as a whole, and need one sample a pixel.

    Args:
        x: columns of the map (rows, columns).
        y: rows of the map.
        right: last column.
        bottom: last row.
        want: (rows, columns): 1 where a map is wanted.
        first: row of cells that the band begins with.
        left: column of cells, likewise.
        prints: as of `sampler.footprints`.
        use: out (rows, columns) of cells, 1 for those.

    Returns:
        How many they are.
    """
    count = 0
    for n in range(use.shape[0]):
        for m in range(use.shape[1]):
            use[n, m] = 1 if prints[first + n, left + m, 1] == 1.0 else 0
    for i in range(x.shape[0]):
        n = i // SIDE
        for m in range(use.shape[1]):
            if use[n, m] == 1:
                run = slice(m * SIDE, min((m + 1) * SIDE, x.shape[1]))
                use[n, m] = _all_inside(x[i, run], y[i, run], want[i, run], right, bottom)
    for n in range(use.shape[0]):
        for m in range(use.shape[1]):
            count += use[n, m]
    return count


@compiled
def cell_levels(prints: F32, first: int, left: int, top: int, use: U8, weight: F32, wanted: U8) -> None:
    """How much each level of a pyramid counts in each cell, mixed one after the other from fine to coarse.

    Args:
        prints: as of `sampler.footprints`.
        first: row of cells.
        left: column of cells.
        top: the coarsest level.
        use: (rows, columns) of cells, 1 for those that count.
        weight: out (top + 1, rows, columns).
        wanted: out (top + 1,): 1 for levels that count anywhere.
    """
    weight[:] = 0.0
    wanted[:] = 0
    for n in range(use.shape[0]):
        for m in range(use.shape[1]):
            if use[n, m] == 1:
                k, blend = level_of(prints[first + n, left + m, 0], top)
                weight[k, n, m] = 1.0
                wanted[k] = 1
                if blend > 0.0:
                    weight[k + 1, n, m] = blend
                    wanted[k + 1] = 1


@compiled
def _mix(one: U16, weight: Number, seen: U16) -> None:
    half = np.float32(0.5)
    for k in range(seen.shape[0]):
        before = np.float32(seen[k])
        seen[k] = np.uint16(before + weight * (np.float32(one[k]) - before) + half)


@compiled
def _copy(one: U16, seen: U16) -> None:
    for k in range(seen.shape[0]):
        seen[k] = one[k]


@compiled
def mix_cells(one: U16, weight: F32, seen: U16) -> None:
    """Mix the samples of a level into those of finer ones.

    Args:
        one: samples (rows, 4 * columns).
        weight: of this level in each cell.
        seen: in and out, likewise.
    """
    for i in range(one.shape[0]):
        n = i // SIDE
        for m in range(weight.shape[1]):
            w = weight[n, m]
            run = slice(4 * SIDE * m, min(4 * SIDE * (m + 1), one.shape[1]))
            if w == 1.0:
                _copy(one[i, run], seen[i, run])
            elif w > 0.0:
                _mix(one[i, run], w, seen[i, run])


@compiled
def _least(one: U16, least: U16) -> None:
    for k in range(one.shape[0]):
        least[k] = min(one[k], least[k])


@compiled
def keep_covered(seen: U16, use: U8, want: U8) -> None:
    """Leave out the cells in which a map has gaps, and strike out the pixels of the others.

    Args:
        seen: samples (rows, 4 * columns).
        use: in and out, (rows, columns) of cells.
        want: (rows, columns) of pixels; set to 0 in the cells that stay.
    """
    least = np.empty(seen.shape[1], np.uint16)
    for n in range(use.shape[0]):
        low, high = n * SIDE, min((n + 1) * SIDE, seen.shape[0])
        least[:] = 65535
        for i in range(low, high):
            _least(seen[i], least)
        for m in range(use.shape[1]):
            start, stop = m * SIDE, min((m + 1) * SIDE, want.shape[1])
            for j in range(start, stop):
                if least[4 * j + 3] < COVERED:
                    use[n, m] = 0
            if use[n, m] == 1:
                for i in range(low, high):
                    want[i, start:stop] = 0


@compiled
def _light(base: F32, down: F32, add: F32, add_down: F32, q: Number, seen: U16, out: F32) -> None:
    for k in range(out.shape[0]):
        out[k] = (base[k] + q * down[k]) * np.float32(seen[k]) + (add[k] + q * add_down[k])


@compiled
def light_cells(seen: U16, first: int, left: int, colour: F32, out: F32) -> None:
    """Radiance of rows of cells, with light and air bilinear between the nodes.

    Args:
        seen: samples (rows, 4 * columns), 0 to FULL.
        first: row of cells.
        left: first column of cells.
        colour: as of `node_colours`.
        out: radiance, of the shape of ``seen``; every fourth number means nothing.
    """
    per = np.float32(1.0 / SIDE)
    cells = (seen.shape[1] // 4 + SIDE - 1) // SIDE
    edge = np.empty((4, 4 * SIDE * cells), np.float32)
    wide = seen.shape[1]
    for i in range(seen.shape[0]):
        n = first + i // SIDE
        if i % SIDE == 0:  # the upper edge of each cell, and how much more there is at the lower one
            for m in range(cells):
                for k in range(8):
                    a, c = colour[n, left + m, k], colour[n + 1, left + m, k]
                    b = (colour[n, left + m + 1, k] - a) * per
                    d = (colour[n + 1, left + m + 1, k] - c) * per - b
                    upper, lower = edge[k // 4 * 2], edge[k // 4 * 2 + 1]
                    for j in range(SIDE):
                        upper[4 * (SIDE * m + j) + k % 4] = a + np.float32(j) * b
                        lower[4 * (SIDE * m + j) + k % 4] = c - a + np.float32(j) * d
        q = np.float32(i % SIDE) * per
        _light(edge[0, :wide], edge[1, :wide], edge[2, :wide], edge[3, :wide], q, seen[i], out[i])
