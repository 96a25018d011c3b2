"""Sampling a pyramid of a map at geodetic places. Compiled, one band of rows a call."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from messages.base import F64, I64
from sim.camera.earth_camera.kernel import F32, U8, decay

U16 = NDArray[np.uint16]
TURN = 2.0 * math.pi
ONE = np.uint64(1)
FULL = 65535.0
"""Reflectance 1, and a pixel with data, in a pyramid."""
MAX_TAPS = 8
"""Samples along the long axis of a stretched footprint."""
COARSEST = -1.6
"""Octave of the map below which cells are not interpolated: OpenCV rounds places to 1/32 px of the map."""
Number: TypeAlias = Any
"""A number of the width that its caller chose."""
FOUR: TypeAlias = tuple[float, float, float, float]


@compiled
def table_at(
    table: F64, lat0: float, per_lat: float, lon0: float, per_lon: float, middle: float, lat: float, lon: float
) -> tuple[float, float]:
    """Column and row of a map window at a place: bilinear in a table (n, m, 2), and linear beyond it.

    Args:
        table: column and row at nodes of latitude and longitude.
        lat0: latitude of node 0.
        per_lat: nodes per radian.
        lon0: longitude of node 0, relative to the middle.
        per_lon: nodes per radian.
        middle: longitude of the middle.
        lat: latitude [rad].
        lon: longitude [rad], -pi to pi.
    """
    turn = lon - middle
    turn = turn - TURN if turn > math.pi else turn + TURN if turn < -math.pi else turn
    y, x = (lat - lat0) * per_lat, (turn - lon0) * per_lon
    if math.isnan(y):
        return math.nan, math.nan
    i, j = cell_of(y, table.shape[0] - 2), cell_of(x, table.shape[1] - 2)
    y, x = y - i, x - j
    # unsigned, so that numba need not look for negative indices
    n, m = np.uint64(i), np.uint64(j)
    a, b, c, d = table[n, m], table[n, m + ONE], table[n + ONE, m], table[n + ONE, m + ONE]
    wd = x * y
    wb, wc = x - wd, y - wd
    wa = 1.0 - x - wc
    return wa * a[0] + wb * b[0] + wc * c[0] + wd * d[0], wa * a[1] + wb * b[1] + wc * c[1] + wd * d[1]


@compiled
def cell_of(x: float, last: int) -> int:
    """The whole number below x, from 0 to ``last``."""
    i = int(x)
    i = min(last, i)
    return max(0, i)


@compiled
def locate_nodes(table: F64, frame: F64, lat: F64, lon: F64, at: F64) -> None:
    """`table_at` for all nodes, into ``at`` (n, m, 2); ``frame`` holds its five numbers."""
    lat0, per_lat, lon0, per_lon, middle = frame[0], frame[1], frame[2], frame[3], frame[4]
    for i in range(lat.shape[0]):
        for j in range(lat.shape[1]):
            at[i, j, 0], at[i, j, 1] = table_at(table, lat0, per_lat, lon0, per_lon, middle, lat[i, j], lon[i, j])


@compiled
def footprints(at: F64, step: int, prints: F32) -> None:
    """How a pixel of the camera lies on the map, for each cell of the nodes.

    Args:
        at: column and row of the map at the nodes (n, m, 2); NaN where there is no ground.
        step: pixels of the camera from node to node.
        prints: out (n - 1, m - 1, 4): level of the pyramid [octaves], number of samples, and the step from sample to
            sample (column, row). Cells without ground take the coarsest of their neighbours.
    """
    rows, columns = prints.shape[0], prints.shape[1]
    for i in range(rows):
        for j in range(columns):
            a = 0.5 * (at[i, j + 1, 0] - at[i, j, 0] + at[i + 1, j + 1, 0] - at[i + 1, j, 0]) / step
            b = 0.5 * (at[i, j + 1, 1] - at[i, j, 1] + at[i + 1, j + 1, 1] - at[i + 1, j, 1]) / step
            c = 0.5 * (at[i + 1, j, 0] - at[i, j, 0] + at[i + 1, j + 1, 0] - at[i, j + 1, 0]) / step
            d = 0.5 * (at[i + 1, j, 1] - at[i, j, 1] + at[i + 1, j + 1, 1] - at[i, j + 1, 1]) / step
            # axes of the ellipse that a round pixel is mapped to: singular values of the matrix ((a, c), (b, d))
            half, off = 0.5 * (a * a + c * c + b * b + d * d), a * d - b * c
            root = math.sqrt(max(half * half - off * off, 0.0))
            long, short = math.sqrt(half + root), math.sqrt(max(half - root, 0.0))
            if not half > 0.0:
                prints[i, j, 0] = math.nan
                continue
            # one sample is good for a footprint that is up to 1.5 times as long as wide
            taps = min(max(math.floor(long / max(short, 0.7, 1e-3 * long) + 0.5), 1.0), MAX_TAPS)
            angle = 0.5 * math.atan2(2.0 * (a * b + c * d), a * a + c * c - b * b - d * d)
            prints[i, j, 0] = math.log2(max(long / taps, short))
            prints[i, j, 1] = taps
            prints[i, j, 2] = long / taps * math.cos(angle)
            prints[i, j, 3] = long / taps * math.sin(angle)
    for _ in range(2):
        for i in range(rows):
            for j in range(columns):
                if math.isnan(prints[i, j, 0]):
                    _fill(prints, i, j)
    for i in range(rows):
        for j in range(columns):
            if math.isnan(prints[i, j, 0]):
                prints[i, j, 0], prints[i, j, 1], prints[i, j, 2], prints[i, j, 3] = 3.0, 1.0, 0.0, 0.0


@compiled
def _fill(prints: F32, i: int, j: int) -> None:
    best = -math.inf
    for k in range(max(i - 1, 0), min(i + 2, prints.shape[0])):
        for m in range(max(j - 1, 0), min(j + 2, prints.shape[1])):
            if prints[k, m, 0] > best:
                best = prints[k, m, 0]
                for c in range(4):
                    prints[i, j, c] = prints[k, m, c]


@compiled
def fetch(pixels: U16, start: int, rows: int, columns: int, x: float, y: float) -> FOUR:
    """Bilinear red, green, blue (times coverage) and coverage at a place of one level; 0 to FULL.

    Args:
        pixels: all levels one after the other (n, 4).
        start: first pixel of the level.
        rows: of the level.
        columns: of the level.
        x: column in its pixels.
        y: row in its pixels.
    """
    x, y = max(0.0, x), max(0.0, y)
    x, y = min(columns - 1.0, x), min(rows - 1.0, y)
    j, i = int(x), int(y)
    u, v = np.float32(x - j), np.float32(y - i)
    a = np.uint64(start + i * columns + j)
    b = a + np.uint64(1 if j + 1 < columns else 0)
    down = np.uint64(columns if i + 1 < rows else 0)
    return weighed(pixels, a, b, a + down, b + down, u, v)


@compiled
def fetch_inside(pixels: U16, start: int, columns: int, x: float, y: float) -> FOUR:
    """`fetch` where all four neighbours are on the level."""
    j, i = int(x), int(y)
    a = np.uint64(start + i * columns + j)
    below = a + np.uint64(columns)
    return weighed(pixels, a, a + ONE, below, below + ONE, np.float32(x - j), np.float32(y - i))


@compiled
def weighed(pixels: U16, a: Number, b: Number, c: Number, d: Number, u: Number, v: Number) -> Any:
    """The bilinear mean of four pixels; they are unsigned, so that numba need not look for negative indices."""
    wd = u * v
    wb, wc = u - wd, v - wd
    wa = np.float32(1.0) - u - wc
    p, q, r, s = pixels[a], pixels[b], pixels[c], pixels[d]
    return (
        wa * np.float32(p[0]) + wb * np.float32(q[0]) + wc * np.float32(r[0]) + wd * np.float32(s[0]),
        wa * np.float32(p[1]) + wb * np.float32(q[1]) + wc * np.float32(r[1]) + wd * np.float32(s[1]),
        wa * np.float32(p[2]) + wb * np.float32(q[2]) + wc * np.float32(r[2]) + wd * np.float32(s[2]),
        wa * np.float32(p[3]) + wb * np.float32(q[3]) + wc * np.float32(r[3]) + wd * np.float32(s[3]),
    )


@compiled
def level_of(octave: float, top: int) -> tuple[int, float]:
    """The level for a footprint, and how much of the next one: none or all of it, but in a narrow band."""
    k = max(min(int(octave), top), 0)
    blend = min(max((octave - k - 0.4) * 5.0, 0.0), 1.0) if k < top else 0.0
    return (k + 1, 0.0) if blend == 1.0 else (k, blend)


@compiled
def sample(
    pixels: U16, levels: I64, k: int, blend: float, taps: int, along_x: float, along_y: float, x: float, y: float
) -> FOUR:
    """The mean of samples along the long axis of a footprint, from one level or between two.

    Args:
        pixels: the pyramid.
        levels: its index.
        k: as of `level_of`.
        blend: likewise.
        taps: number of samples.
        along_x: from sample to sample.
        along_y: likewise.
        x: middle, column of level 0.
        y: middle, row.
    """
    red, green, blue, cover = 0.0, 0.0, 0.0, 0.0
    total = 0.0
    for high in range(2):
        weight = blend if high == 1 else 1.0 - blend
        if weight == 0.0:
            continue
        start, rows, columns, size = levels[k + high, 0], levels[k + high, 1], levels[k + high, 2], 0.5 ** (k + high)
        for n in range(taps):
            off = n - 0.5 * (taps - 1)
            u, v = x + off * along_x, y + off * along_y
            one = fetch(pixels, start, rows, columns, (u + 0.5) * size - 0.5, (v + 0.5) * size - 0.5)
            red, green, blue = red + weight * one[0], green + weight * one[1], blue + weight * one[2]
            cover, total = cover + weight * one[3], total + weight
    return red / total, green / total, blue / total, cover / total


@compiled
def _row_places(
    columns: F64, rows: F64, n: int, m: int, lat0: float, per_lat: float, lon0: float, per_lon: float, middle: float,
    lat: F64, lon: F64, x: F64, y: F64,
) -> None:  # fmt: skip
    """`table_at` for a row of places, into x and y. Without branches, so that a compiler can do several at once.

    Args:
        columns: the table's columns of the map, its rows one after the other.
        rows: likewise its rows of the map.
        n: rows of the table.
        m: columns of the table.
        lat0: as of `table_at`; the others likewise.
        per_lat: see there.
        lon0: see there.
        per_lon: see there.
        middle: see there.
        lat: latitudes.
        lon: longitudes.
        x: out.
        y: out.
    """
    last_v, last_u = n - 2.0, m - 2.0
    for j in range(lat.shape[0]):
        turn = lon[j] - middle
        turn = turn - TURN if turn > math.pi else turn
        turn = turn + TURN if turn < -math.pi else turn
        v, u = (lat[j] - lat0) * per_lat, (turn - lon0) * per_lon
        low_v, low_u = max(0.0, v), max(0.0, u)
        low_v, low_u = min(last_v, low_v), min(last_u, low_u)
        i, k = int(low_v), int(low_u)
        v, u = v - i, u - k
        a = i * m + k
        wd = u * v
        wb, wc = u - wd, v - wd
        wa = 1.0 - u - wc
        x[j] = wa * columns[a] + wb * columns[a + 1] + wc * columns[a + m] + wd * columns[a + m + 1]
        y[j] = wa * rows[a] + wb * rows[a + 1] + wc * rows[a + m] + wd * rows[a + m + 1]


@compiled
def sample_band(
    lat: F64, lon: F64, top: int, left: int, step: int, table: F64, planes: F64, frame: F64, prints: F32,
    pixels: U16, levels: I64, image: F32, want: U8,
) -> None:  # fmt: skip
    """Reflectance of one map in a band of pixels, wherever no finer map had any.

    Args:
        lat: latitude [rad] (rows, columns); NaN where there is no ground.
        lon: longitude [rad].
        top: row of the camera that the first row of the band is.
        left: column of the camera that the first column is, a multiple of ``step``.
        step: pixels of the camera to a cell of ``prints``.
        table: as of `table_at`.
        planes: its columns, and its rows, one after the other (2, n * m).
        frame: as of `locate_nodes`.
        prints: as of `footprints`.
        pixels: the pyramid, as of `fetch`.
        levels: (n, 3), one row a level.
        image: out (rows, columns, 3), reflectance.
        want: (rows, columns): 1 where a map is wanted; set to 0 where this one has data.
    """
    lat0, per_lat, lon0, per_lon, middle = frame[0], frame[1], frame[2], frame[3], frame[4]
    right, bottom = levels[0, 2] - 0.5, levels[0, 1] - 0.5
    unit, most = np.float32(1.0 / FULL), np.float32(0.999999 * FULL)
    xs, ys = np.empty(lat.shape[1]), np.empty(lat.shape[1])
    for i in range(lat.shape[0]):
        asked = False
        for j in range(want.shape[1]):
            asked |= want[i, j] != 0
        if not asked:
            continue
        _row_places(
            planes[0], planes[1], table.shape[0], table.shape[1], lat0, per_lat, lon0, per_lon, middle,
            lat[i], lon[i], xs, ys,
        )  # fmt: skip
        n = (top + i) // step
        for m in range((lat.shape[1] + step - 1) // step):
            c = left // step + m
            k, blend = level_of(prints[n, c, 0], levels.shape[0] - 1)
            taps, along_x, along_y = int(prints[n, c, 1]), prints[n, c, 2], prints[n, c, 3]
            simple = taps == 1 and blend == 0.0
            start, rows, columns, size = levels[k, 0], levels[k, 1], levels[k, 2], 0.5**k
            for j in range(m * step, min((m + 1) * step, lat.shape[1])):
                if want[i, j] == 0:
                    continue
                x, y = xs[j], ys[j]
                if not (x >= -0.5 and x <= right and y >= -0.5 and y <= bottom):
                    continue
                if simple:
                    u, v = (x + 0.5) * size - 0.5, (y + 0.5) * size - 0.5
                    if u >= 0.0 and u < columns - 1 and v >= 0.0 and v < rows - 1:
                        red, green, blue, cover = fetch_inside(pixels, start, columns, u, v)
                    else:
                        red, green, blue, cover = fetch(pixels, start, rows, columns, u, v)
                else:
                    red, green, blue, cover = sample(pixels, levels, k, blend, taps, along_x, along_y, x, y)
                if cover >= 0.5 * FULL:
                    want[i, j] = 0
                    per = unit if cover > most else 1.0 / cover
                    image[i, j, 0], image[i, j, 1], image[i, j, 2] = red * per, green * per, blue * per


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
            fine = bent <= most * 2.0**octave and octave >= COARSEST and prints[i, j, 1] == 1.0
            use[i, j] = 1 if free[i, j] == 1 and known and inside and fine else 0
            away = high_x < -1.0 or low_x > columns or high_y < -1.0 or low_y > rows
            if not (known and away):
                free[i, j] = 0


@compiled
def node_colours(light: F32, mass: F32, path: F32, depth: F64, gain: float, colour: F32) -> None:
    """Factor on the map and added light of each channel at the nodes, into ``colour`` (n, m, 6)."""
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            for c in range(3):
                through = decay(mass[i, j] * depth[c])
                colour[i, j, c] = gain * light[i, j] * through
                colour[i, j, c + 3] = gain * path[i, j] * (1.0 - through)


@compiled
def spread_rows(values: F64, first: int, step: int, left: int, out: F32) -> None:
    """Bilinear interpolation between nodes (n, m) at the pixels of rows of cells, into ``out`` (rows, columns).

    Args:
        values: at the nodes.
        first: row of cells.
        step: pixels to a cell.
        left: first column of cells.
        out: as many rows and columns as are wanted, at most those of the cells.
    """
    per = 1.0 / step
    for i in range(out.shape[0]):
        n = first + i // step
        q = (i % step) * per
        for m in range((out.shape[1] + step - 1) // step):
            a = values[n, left + m] + q * (values[n + 1, left + m] - values[n, left + m])
            b = values[n, left + m + 1] + q * (values[n + 1, left + m + 1] - values[n, left + m + 1])
            slope = (b - a) * per
            run = out[i, m * step : min((m + 1) * step, out.shape[1])]
            for j in range(run.shape[0]):
                run[j] = a + j * slope


@compiled
def light_cells(
    low: U16, high: U16, first: int, step: int, left: int, level: int, use: U8, top_level: int, prints: F32,
    colour: F32, image: F32, todo: U8,
) -> None:  # fmt: skip
    """Radiance of the cells of one level in rows of cells, where the map was sampled already.

    Args:
        low: samples of the level (rows, columns, 4), 0 to FULL.
        high: of the next one.
        first: first row of cells.
        step: pixels to a cell.
        left: first column of cells.
        level: cells of other levels are left.
        use: (n - 1, m - 1), 1 for the cells to be drawn.
        top_level: the last of the pyramid.
        prints: as of `footprints`.
        colour: as of `node_colours`.
        image: out, the whole image (rows, columns, 3).
        todo: out (rows, columns), set to 0 for the pixels that were drawn.
    """
    per, unit = np.float32(1.0 / step), np.float32(1.0 / FULL)
    most = np.float32(0.999 * FULL)
    for i in range(low.shape[0]):
        n = first + i // step
        q = np.float32(i % step) * per
        for m in range((low.shape[1] + step - 1) // step):
            k, mix = level_of(prints[n, left + m, 0], top_level)
            if use[n, left + m] == 0 or k != level:
                continue
            blend = np.float32(mix)
            c = left + m
            f0, e0 = _edge(colour, n, c, 0, q, per)
            f1, e1 = _edge(colour, n, c, 1, q, per)
            f2, e2 = _edge(colour, n, c, 2, q, per)
            a0, b0 = _edge(colour, n, c, 3, q, per)
            a1, b1 = _edge(colour, n, c, 4, q, per)
            a2, b2 = _edge(colour, n, c, 5, q, per)
            f0, e0, f1, e1, f2, e2 = f0 * unit, e0 * unit, f1 * unit, e1 * unit, f2 * unit, e2 * unit
            start, stop = m * step, min((m + 1) * step, low.shape[1])
            row, shift = first * step + i, left * step
            for j in range(start, stop):
                at = low[i, j]
                red, green, blue = np.float32(at[0]), np.float32(at[1]), np.float32(at[2])
                cover = np.float32(at[3])
                if blend > 0.0:
                    other = high[i, j]
                    red += blend * (np.float32(other[0]) - red)
                    green += blend * (np.float32(other[1]) - green)
                    blue += blend * (np.float32(other[2]) - blue)
                    cover += blend * (np.float32(other[3]) - cover)
                if cover > most:
                    u = np.float32(j - start)
                    out = image[row, shift + j]
                    out[0] = (f0 + u * e0) * red + (a0 + u * b0)
                    out[1] = (f1 + u * e1) * green + (a1 + u * b1)
                    out[2] = (f2 + u * e2) * blue + (a2 + u * b2)
                    todo[row, shift + j] = 0


@compiled
def _edge(colour: F32, n: int, m: int, k: int, q: Number, per: Number) -> tuple[float, float]:
    """A number of `node_colours` at the left edge of a cell, q below its top, and its slope to the right."""
    left = colour[n, m, k] + q * (colour[n + 1, m, k] - colour[n, m, k])
    right = colour[n, m + 1, k] + q * (colour[n + 1, m + 1, k] - colour[n, m + 1, k])
    return left, (right - left) * per
