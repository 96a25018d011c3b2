"""Sampling a pyramid of a map at geodetic places. Compiled, one band of rows a call."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from messages.base import F64, I64
from sim.camera.earth_camera.kernel import F32, FULL, U8, U16, Number

TURN = 2.0 * math.pi
ONE = np.uint64(1)
MAX_TAPS = 8
"""Samples along the long axis of a stretched footprint."""
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
            prints[i, j, 0] = math.log2(max(long / taps, short))
            prints[i, j, 1] = taps
            prints[i, j, 2], prints[i, j, 3] = 0.0, 0.0
            if taps > 1.0:
                angle = 0.5 * math.atan2(2.0 * (a * b + c * d), a * a + c * c - b * b - d * d)
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
def _row_nodes(n: int, m: int, frame: F64, lat: F64, lon: F64, u: F64, v: F64, node: I64) -> None:
    """For a row of places: the node of the table above and left of each, and where it is from there in cells."""
    lat0, per_lat, lon0, per_lon, middle = frame[0], frame[1], frame[2], frame[3], frame[4]
    last_y, last_x, row = n - 2.0, m - 2.0, float(m)
    for j in range(lat.shape[0]):
        turn = lon[j] - middle
        turn = turn - TURN if turn > math.pi else turn
        turn = turn + TURN if turn < -math.pi else turn
        y, x = (lat[j] - lat0) * per_lat, (turn - lon0) * per_lon
        low_y, low_x = max(0.0, y), max(0.0, x)
        low_y, low_x = min(last_y, low_y), min(last_x, low_x)
        i, k = np.floor(low_y), np.floor(low_x)
        v[j], u[j] = y - i, x - k
        node[j] = np.int64(i * row + k)


@compiled
def _row_between(plane: F64, m: int, u: F64, v: F64, node: I64, zero: float, out: F32) -> None:
    """Bilinear values of a row, less ``zero``. Indices are unsigned, so that numba looks for no negative ones."""
    down = np.uint64(m)
    for j in range(out.shape[0]):
        a = np.uint64(node[j])
        b = a + down
        upper, lower = plane[a], plane[b]
        upper += u[j] * (plane[a + ONE] - upper)
        lower += u[j] * (plane[b + ONE] - lower)
        out[j] = upper + v[j] * (lower - upper) - zero


@compiled
def map_places(
    planes: F64, n: int, m: int, frame: F64, x0: float, y0: float, lat: F64, lon: F64, x: F32, y: F32
) -> None:
    """`table_at` for a band of places (rows, columns), relative to a pixel nearby, where single precision is enough.

    Args:
        planes: the table's columns of the map, and its rows of the map, one row of nodes after the other (2, n * m).
        n: rows of nodes.
        m: columns of nodes.
        frame: as of `locate_nodes`.
        x0: column of the map that is 0 in x.
        y0: row that is 0 in y.
        lat: latitudes.
        lon: longitudes.
        x: out.
        y: out.
    """
    u, v, node = np.empty(lat.shape[1]), np.empty(lat.shape[1]), np.zeros(lat.shape[1], np.int64)
    for i in range(lat.shape[0]):
        _row_nodes(n, m, frame, lat[i], lon[i], u, v, node)
        _row_between(planes[0], m, u, v, node, x0, x[i])
        _row_between(planes[1], m, u, v, node, y0, y[i])


@compiled
def sample_band(
    x: F32, y: F32, x0: int, y0: int, top: int, left: int, step: int, prints: F32, pixels: U16, levels: I64,
    seen: U16, want: U8,
) -> None:  # fmt: skip
    """Reflectance of one map in a band of pixels, wherever it is wanted still.

    Args:
        x: as of `map_places`; y, x0, y0 likewise.
        y: see there.
        x0: see there.
        y0: see there.
        top: row of the camera that the first row of the band is.
        left: column of the camera that the first column is, a multiple of ``step``.
        step: pixels of the camera to a cell of ``prints``.
        prints: as of `footprints`.
        pixels: the pyramid, as of `fetch`.
        levels: (n, 3), one row a level.
        seen: out (rows, columns, 4), reflectance and coverage, 0 to FULL.
        want: (rows, columns): 1 where a map is wanted; set to 0 where this one has data.
    """
    right, bottom = levels[0, 2] - 0.5, levels[0, 1] - 0.5
    for i in range(x.shape[0]):
        asked = 0
        for j in range(want.shape[1]):
            asked += want[i, j]
        if asked == 0:
            continue
        n = (top + i) // step
        for m in range((x.shape[1] + step - 1) // step):
            c = left // step + m
            k, blend = level_of(prints[n, c, 0], levels.shape[0] - 1)
            taps, along_x, along_y = int(prints[n, c, 1]), prints[n, c, 2], prints[n, c, 3]
            for j in range(m * step, min((m + 1) * step, x.shape[1])):
                u, v = float(x[i, j]) + x0, float(y[i, j]) + y0
                if want[i, j] == 0 or not (u >= -0.5 and u <= right and v >= -0.5 and v <= bottom):
                    continue
                red, green, blue, cover = sample(pixels, levels, k, blend, taps, along_x, along_y, u, v)
                if cover >= 0.5 * FULL:
                    want[i, j] = 0
                    per = FULL / cover
                    seen[i, j, 0], seen[i, j, 1] = np.uint16(red * per + 0.5), np.uint16(green * per + 0.5)
                    seen[i, j, 2], seen[i, j, 3] = np.uint16(blue * per + 0.5), np.uint16(FULL)
