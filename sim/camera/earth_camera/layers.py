"""Maps in memory: a window of a raster as a pyramid, and a table from places to its pixels."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rasterio import warp
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.windows import Window as RasterWindow

from fsw.imaging.rasters import MapError, Raster, apply, opened
from messages.base import F64, I64
from sim.camera.earth_camera.kernel import F32, U16
from sim.camera.earth_camera.sampler import footprints, locate_nodes

CV: Any = cv2
WARP: Any = warp
MAX_PIXELS = 24_000_000
"""A window has no more pixels; a wider one is read from a coarser level. With its pyramid it takes 11 bytes a pixel."""
MAX_SIDE = 32000
"""Nor has it more rows or columns: OpenCV remaps 32767."""
TABLE_ERROR = 2e-3
"""Error of the table that is aimed at [px of the window]."""
MAX_TABLE = 513
"""Most nodes of the table in either direction."""
MARGIN = 0.25
"""A window is this much larger than the view on each side, so that it serves a camera that moves on."""
SPARSE = 4
"""Every SPARSE-th node is enough to choose a window."""


class Window(NamedTuple):
    """A part of a raster in memory. Coordinates x, y are pixels of level 0, centres at integers."""

    left: int
    top: int
    factor: int
    """Column, row of the raster where it begins, and pixels of the raster to one of level 0."""
    whole: bool
    """It is the whole raster."""
    exact: bool
    """It could not be finer: the raster has no finer pixels, or the window would be too large."""
    pixels: U16
    levels: I64
    """The pyramid, see `sampler.fetch`."""
    table: F64
    planes: F64
    frame: F64
    """From places to x, y, see `sampler.table_at`."""
    box: tuple[float, float, float, float]
    """Latitudes and longitudes (relative to frame[4]) that the table covers [rad]."""


class View(NamedTuple):
    """A window as seen by a camera, at nodes of its pixels."""

    window: Window
    at: F64
    """x, y at the nodes (n, m, 2)."""
    prints: F32
    """See `sampler.footprints`, (n - 1, m - 1, 4)."""


class MapLayer:
    """One raster of which the window in view is kept in memory."""

    def __init__(self, raster: Raster) -> None:
        """Nothing is read before the first view."""
        self.raster = raster
        self._around = _around(raster)
        self._window: Window | None = None

    def view(self, lat: F64, lon: F64, step: int) -> View | None:
        """The map in a view.

        Args:
            lat: latitude [rad] at every ``step``-th pixel of the camera (n, m); NaN where there is no ground.
            lon: longitude [rad], likewise.
            step: pixels from node to node.

        Returns:
            None if no part of the map is in view.

        Raises:
            MapError: if the file cannot be read.
        """
        if not np.isfinite(lat).any():
            return None
        if self._window is not None:
            seen = _seen(self._window, lat, lon, step)
            if _serves(self._window, self.raster, self._around, seen, lat, lon):
                return seen
        self._window = self._load(lat[::SPARSE, ::SPARSE], lon[::SPARSE, ::SPARSE], step * SPARSE)
        return None if self._window is None else _seen(self._window, lat, lon, step)

    def _load(self, lat: F64, lon: F64, step: int) -> Window | None:
        column, row = self.raster.locate(lat, lon)
        known = np.isfinite(column) & np.isfinite(row)
        if not known.any():
            return None
        rows, columns = self.raster.shape
        around, middle = self._around, 0.0
        if around is not None:  # the edges of the map meet: count on beyond them, from the middle of the view
            middle = _middle(column[known], around)
            column = _near(column, middle, around)
        across = np.concatenate([_lengths(column, row, axis).ravel() for axis in (0, 1)])
        across = across[np.isfinite(across) & (across > 0.0)]
        finest = float(np.percentile(across, 2)) / step if across.size else 1.0
        reach = float(np.percentile(across, 90)) if across.size else 0.0
        spans: list[tuple[int, int]] = []
        for at, size, closed in ((column[known], columns, around is not None), (row[known], rows, False)):
            margin = MARGIN * float(np.ptp(at)) + reach + 16.0
            low, high = float(at.min()) - margin, float(at.max()) + margin
            if closed:
                low, high = max(low, middle - 0.5 * size), min(high, middle + 0.5 * size)
            else:
                low, high = max(0.0, low), min(float(size), high)
            if low >= high:
                return None
            spans.append((math.floor(low), math.ceil(high)))
        factor = wanted = 2 ** max(0, math.floor(math.log2(max(finest, 1.0)) + 0.3))
        area = math.prod(high - low for low, high in spans)
        while area / factor**2 > MAX_PIXELS or max(high - low for low, high in spans) / factor > MAX_SIDE:
            factor *= 2
        while factor > 1 and factor > min(high - low for low, high in spans):
            factor //= 2
        if around is not None:
            left = math.floor(spans[0][0] / factor) * factor
            right = min(spans[0][1], left + columns)
            shift = -columns if right > columns else columns if right <= 0 else 0
            spans[0] = left + shift, right + shift
        return self._read(spans, factor, exact=factor == 1 or factor > wanted)

    def _read(self, spans: list[tuple[int, int]], factor: int, *, exact: bool) -> Window:
        (left, right), (top, bottom) = spans
        size = (right - left) // factor, (bottom - top) // factor
        pixels = read_pixels(self.raster, left, top, size, factor)
        table, frame, box = _table(self.raster, self._around, left, top, size, factor)
        planes = np.ascontiguousarray(np.moveaxis(table, 2, 0)).reshape(2, -1)
        whole = (left, top) == (0, 0) and (bottom, right) == self.raster.shape
        return Window(left, top, factor, whole, exact, *pyramid(pixels), table, planes, frame, box)


def _around(raster: Raster) -> float | None:
    """Columns of a full turn of longitude if the map goes once around the Earth and its edges meet, or None."""
    middle = raster.middle_lon_deg
    lon = np.radians([middle - 180.0, middle, middle + 180.0 - 1e-9])
    column, _ = raster.locate(np.zeros(3), lon)
    turn = float(column[2] - column[0])
    even = abs(0.5 * (column[0] + column[2]) - column[1]) < 0.01
    return float(raster.shape[1]) if even and abs(turn - raster.shape[1]) < 0.01 else None


def _middle(column: F64, around: float) -> float:
    """The mean of columns that are angles."""
    return float(np.angle(np.exp(2j * np.pi / around * column).mean()) * around / (2.0 * np.pi))


def _near(column: F64, middle: float, around: float) -> F64:
    """Columns less than half a turn from a middle."""
    return middle + np.remainder(column - middle + 0.5 * around, around) - 0.5 * around


def _lengths(column: F64, row: F64, axis: int) -> F64:
    return np.hypot(np.diff(column, axis=axis), np.diff(row, axis=axis))


def _seen(window: Window, lat: F64, lon: F64, step: int) -> View:
    at = np.empty((*lat.shape, 2))
    prints = np.empty((lat.shape[0] - 1, lat.shape[1] - 1, 4), np.float32)
    locate_nodes(window.table, window.frame, lat, lon, at)
    footprints(at, step, prints)
    return View(window, at, prints)


def _serves(window: Window, raster: Raster, around: float | None, seen: View, lat: F64, lon: F64) -> bool:
    """Whether a window holds all that a view needs, as fine as it needs it."""
    known = np.isfinite(seen.at[..., 0])
    x, y = seen.at[..., 0][known], seen.at[..., 1][known]
    if not known.any():
        return False
    rows, columns = window.levels[0, 1:]
    if not window.whole:
        turn = np.remainder(lon[known] - window.frame[4] + np.pi, 2.0 * np.pi) - np.pi
        low_lat, high_lat, low_lon, high_lon = window.box
        at = lat[known]
        tall, wide = high_lat - low_lat, high_lon - low_lon  # farther out the table, which is linear there, is no guide
        if at.min() < low_lat - tall or at.max() > high_lat + tall:
            return False
        if turn.min() < low_lon - wide or turn.max() > high_lon + wide:
            return False
        begin_x = window.left <= 0
        end_x = window.left + columns * window.factor + window.factor > raster.shape[1]
        if around is not None:
            begin_x = end_x = columns * window.factor + window.factor > raster.shape[1]
        end_y = window.top + rows * window.factor + window.factor > raster.shape[0]
        if (x.min() < 0.0 and not begin_x) or (y.min() < 0.0 and window.top > 0):
            return False
        if (x.max() > columns - 1.0 and not end_x) or (y.max() > rows - 1.0 and not end_y):
            return False
    if around is not None and columns * window.factor + window.factor > raster.shape[1]:
        turn = around / window.factor
        if abs(float(_near(np.array(_middle(x, turn)), 0.5 * columns, turn)) - 0.5 * columns) > 0.25 * turn:
            return False  # the edges of the window are in view
    return window.exact or float(np.percentile(seen.prints[..., 0], 2)) > -0.8


def read_pixels(raster: Raster, left: int, top: int, size: tuple[int, int], factor: int) -> U16:
    """Red, green, blue times coverage, and coverage, (rows, columns, 4), 0 to 65535.

    Bytes stand for reflectance 0 to 1; other numbers are stretched as `Raster` does. Pixels without data have
    coverage 0.

    Args:
        raster: the file.
        left: first column, a negative multiple of ``factor`` to begin at the other side of the map.
        top: first row.
        size: columns and rows of the result.
        factor: pixels of the file to one of the result.

    Raises:
        MapError: if the file cannot be read.
    """
    width, height = size
    if left < 0:  # across the edge of a map that goes around the Earth
        split = -left // factor
        west = read_pixels(raster, raster.shape[1] + left, top, (split, height), factor)
        return np.concatenate([west, read_pixels(raster, 0, top, (width - split, height), factor)], axis=1)
    window = RasterWindow(left, top, width * factor, height * factor)  # pyright: ignore[reportCallIssue]
    average = factor > 1 and raster.palette is None
    how = Resampling.average if average else Resampling.nearest
    options: dict[str, Any] = {"window": window, "out_shape": (height, width), "resampling": how}
    try:
        with opened(raster.path) as data:
            bands = [data.read(b, **options) for b in raster.bands]
            cover = data.dataset_mask(**options).astype(np.float32) / 255.0
    except RasterioError as error:
        raise MapError(f"map file {raster.path} cannot be read ({error})") from error
    out = np.empty((height, width, 4), np.uint16)
    for band in bands:
        if band.dtype.kind == "f":
            cover = np.where(np.isfinite(band), cover, np.float32(0.0))
    for c in range(3):
        if raster.palette is not None:
            level = raster.palette[bands[0]][..., c] / np.float32(255.0)
        else:
            level = _level(bands[min(c, len(bands) - 1)], raster.stretch)
        out[..., c] = np.rint(level * cover * np.float32(65535.0))
    out[..., 3] = np.rint(cover * np.float32(65535.0))
    return out


def _level(band: NDArray[Any], stretch: tuple[float, float] | None) -> F32:
    if stretch is None:
        return band.astype(np.float32) / np.float32(255.0)
    low, high = stretch
    scaled = (np.nan_to_num(band.astype(np.float64), nan=low, posinf=high, neginf=low) - low) / (high - low)
    return np.clip(scaled, 0.0, 1.0).astype(np.float32)


def pyramid(pixels: U16) -> tuple[U16, I64]:
    """Levels, each the mean of 2 x 2 pixels of the one before, one after the other (n, 4), and their index (k, 3)."""
    parts, index, start = [pixels], [[0, *pixels.shape[:2]]], 0
    while min(pixels.shape[:2]) > 1 and len(index) < 12:
        start += pixels.shape[0] * pixels.shape[1]
        rows, columns = pixels.shape[:2]
        # an odd edge is filled up with nothing, so that all pixels stay where they are
        even = np.pad(pixels, ((0, rows % 2), (0, columns % 2), (0, 0)))
        pixels = CV.resize(even, (even.shape[1] // 2, even.shape[0] // 2), interpolation=cv2.INTER_AREA)
        index.append([start, *pixels.shape[:2]])
        parts.append(pixels)
    return np.concatenate([p.reshape(-1, 4) for p in parts]), np.array(index, np.int64)


def _table(
    raster: Raster, around: float | None, left: int, top: int, size: tuple[int, int], factor: int
) -> tuple[F64, F64, tuple[float, float, float, float]]:
    """The table from places to pixels of a window, its frame, and what it covers."""
    width, height = size
    x, y = np.meshgrid(np.linspace(0.5, width - 0.5, 33), np.linspace(0.5, height - 0.5, 33))
    world = apply(~raster.inverse, left + x.ravel() * factor, top + y.ravel() * factor)
    try:
        lon_deg, lat_deg = (np.array(a) for a in WARP.transform(raster.crs, "EPSG:4326", *world)[:2])
    except RasterioError as error:
        text = f"its coordinate system cannot be related to WGS84 ({error})"
        raise MapError(f"map file {raster.path}: {text}") from error
    known = np.isfinite(lat_deg) & np.isfinite(lon_deg)
    if not known.any():
        raise MapError(f"map file {raster.path}: no place of its window has a latitude and longitude")
    middle = float(np.radians(lon_deg[known][known.sum() // 2]))
    turn = np.remainder(np.radians(lon_deg[known]) - middle + np.pi, 2.0 * np.pi) - np.pi
    lat = np.radians(lat_deg[known])
    low, high = [float(lat.min()), float(turn.min())], [float(lat.max()), float(turn.max())]
    if high[1] - low[1] > 6.1 and raster.epsg not in (3857, 4326):  # all around a pole
        low[0], high[0] = (low[0], 0.5 * math.pi) if high[0] > 0.0 else (-0.5 * math.pi, high[0])
        low[1], high[1] = -math.pi, math.pi
    centre = left + 0.5 * (width - 1) * factor

    def located(nodes: list[F64]) -> F64:
        at = _located(raster, nodes, middle, left, top, factor)
        if around is not None:
            at[..., 0] = _near(at[..., 0], (centre - left + 0.5) / factor - 0.5, around / factor)
        return at

    counts = [2, 2]
    while True:
        nodes = [np.linspace(a, max(b, a + 1e-9), n) for a, b, n in zip(low, high, counts, strict=True)]
        table = located(nodes)
        halves = [0.5 * (a[1:] + a[:-1]) for a in nodes]
        errors = [
            np.abs(located([halves[0], nodes[1]]) - 0.5 * (table[1:] + table[:-1])),
            np.abs(located([nodes[0], halves[1]]) - 0.5 * (table[:, 1:] + table[:, :-1])),
        ]
        again = False
        for k, error in enumerate(errors):
            worst = float(np.nanmax(error)) if np.isfinite(error).any() else 0.0
            if worst > TABLE_ERROR and 2 * counts[k] - 1 <= MAX_TABLE:
                counts[k], again = 2 * counts[k] - 1, True
        if not again:
            break
    per = [(n - 1) / (a[-1] - a[0]) for n, a in zip(counts, nodes, strict=True)]
    frame = np.array([low[0], per[0], low[1], per[1], middle])
    return table, frame, (low[0], high[0], low[1], high[1])


def _located(raster: Raster, nodes: list[F64], middle: float, left: int, top: int, factor: int) -> F64:
    """x, y (n, m, 2) of a window at nodes of latitude and of longitude relative to the middle [rad]."""
    lat, lon = np.meshgrid(*nodes, indexing="ij")
    column, row = raster.locate(lat, lon + middle)
    return np.stack([(column - left + 0.5) / factor - 0.5, (row - top + 0.5) / factor - 0.5], axis=-1)
