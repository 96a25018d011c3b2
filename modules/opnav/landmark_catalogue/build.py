"""A catalogue from a map: where chips would match well, evenly spread, at several sizes."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rasterio import warp

from fsw.imaging.maps import SEA_LEVEL, GeoMap, HeightGrid
from fsw.imaging.rasters import Raster, apply
from fsw.math.geodesy import A, ecef_from_geodetic
from messages.base import F64
from modules.opnav.features import DETECTORS, detect
from modules.opnav.landmark_catalogue.catalogue import CHIP, Catalogue, CatalogueError, Landmarks, MapFeatures
from modules.opnav.landmark_catalogue.kernel import plane_nodes
from modules.opnav.landmark_finder.kernel import ground_at, height_at
from modules.opnav.landmark_finder.render import STEP, sample_map

CV: Any = cv2
WARP: Any = warp
TILE = 512
"""The map is gone through in squares of this many pixels."""
MARGIN = CHIP // 2 + 16
"""Pixels around a square that are looked at too: chips reach over its edge, and squares of latitude are no squares."""
WINDOW = 33
"""The texture of a place is summed over this many rows and columns: those that a tracker will match."""
BLUR_PX = 1.0
MIDDLE = 11
"""The innermost part of that, which must have texture of its own: a place at sea may have a coast near by."""
WORST_SIGMA = 0.04
"""Largest Cramer-Rao bound in the worst direction, pixels per grey level of noise: 5 levels are 0.2 px. What
compression leaves of the open sea is above it."""
MIDDLE_SIGMA = 0.05
"""Largest bound of the middle, both directions together."""
FEATURES_PER_CELL = 4


class Region(NamedTuple):
    """Part of the Earth between two parallels and two meridians [rad]; ``east`` is below ``west`` across 180."""

    south: float
    west: float
    north: float
    east: float


class _Cell(NamedTuple):
    """A square of the map: its region and the picture around its middle."""

    region: Region
    lat: F64
    lon: F64
    h: F64
    grid: HeightGrid
    grey: NDArray[np.uint8]
    mask: NDArray[np.bool_]


def region_of(raster: Raster) -> Region:
    """The region that a raster lies in."""
    rows, columns = raster.shape
    x = np.concatenate([np.linspace(0, columns, 33), np.linspace(0, columns, 33), np.zeros(33), np.full(33, columns)])
    y = np.concatenate([np.zeros(33), np.full(33, rows), np.linspace(0, rows, 33), np.linspace(0, rows, 33)])
    xs, ys = apply(~raster.inverse, x, y)
    lon, lat = (np.array(v) for v in WARP.transform(raster.crs, "EPSG:4326", xs.tolist(), ys.tolist())[:2])
    known = np.isfinite(lon) & np.isfinite(lat)
    lon = raster.middle_lon_deg + np.remainder(lon - raster.middle_lon_deg + 180.0, 360.0) - 180.0
    if raster.epsg == 4326:
        lon = xs  # an edge on both sides of longitude 180 is not one meridian
    if not known.any():
        raise CatalogueError(f"map file {raster.path}: its edges have no place on the Earth; name a region")
    west, east = float(lon[known].min()), float(lon[known].max())
    return Region(*np.radians([float(lat[known].min()), west, float(lat[known].max()), east]).tolist())


def map_gsd(raster: Raster, region: Region) -> float:
    """Size of a raster's pixel on the ground in the middle of a region [m]."""
    lat, width = 0.5 * (region.south + region.north), _width(region)
    step = 1e-5
    lats = np.array([lat, lat + step, lat])
    lons = region.west + 0.5 * width + np.array([0.0, 0.0, step / max(math.cos(lat), 1e-3)])
    column, row = raster.locate(lats, lons)
    north = (column[1] - column[0], row[1] - row[0])
    east = (column[2] - column[0], row[2] - row[0])
    area = abs(float(north[0] * east[1] - north[1] * east[0]))
    if not area > 0.0:
        raise CatalogueError(f"map file {raster.path} has no pixels in the middle of the region; name another region")
    return step * A / math.sqrt(area)


def _width(region: Region) -> float:
    width = math.remainder(region.east - region.west, 2.0 * math.pi)
    return width if width > 0.0 else width + 2.0 * math.pi


def build_catalogue(
    geo_map: GeoMap,
    region: Region | None = None,
    gsd: float | None = None,
    *,
    levels: int = 4,
    spacing: int = 40,
    detector: str | None = "sift",
    tick: Callable[[float], None] = lambda share: None,
) -> Catalogue:
    """Make a catalogue.

    Args:
        geo_map: map and heights.
        region: part of the Earth; the finest map file's if left out.
        gsd: size of a pixel of the finest chips [m]; the finest map's if left out.
        levels: sizes of chips; each level's pixels are twice as large as those of the last.
        spacing: pixels of a chip from landmark to landmark.
        detector: of the features for the cold start, a name in `modules.opnav.features.DETECTORS`; None for no
            features, which takes half the time.
        tick: called with the share that is done.

    Raises:
        CatalogueError: if an argument does not fit or the map has no landmarks in the region.
        MapError: if a map cannot be read.
    """
    if detector is not None and detector not in DETECTORS:
        raise CatalogueError(f"detector: expected one of {', '.join(DETECTORS)}, got {detector!r}")
    if not (1 <= levels <= 8 and 16 <= spacing <= TILE):
        raise CatalogueError(f"expected levels from 1 to 8 and spacing from 16 to {TILE}, got {levels} and {spacing}")
    region = region_of(geo_map.layers[0]) if region is None else region
    if not (-math.pi / 2 <= region.south < region.north <= math.pi / 2 and np.isfinite(region).all()):
        raise CatalogueError(f"region: expected a southern and a northern latitude in radians, got {tuple(region)}")
    gsd = map_gsd(geo_map.layers[0], region) if gsd is None else gsd
    if not gsd > 0.0:
        raise CatalogueError(f"gsd: expected metres above 0, got {gsd}")
    marks: list[Landmarks] = []
    features: list[MapFeatures] = []
    sizes = [gsd * 2**level for level in range(levels)]
    squares = [(size, square) for size in sizes for square in _squares(region, size)]
    for done, (size, square) in enumerate(squares):
        cell = _picture(geo_map, square, size)
        if cell is not None:
            # a view has few pixels of the coarser levels, so their landmarks are closer
            marks += _landmarks(geo_map, cell, size, spacing if size == gsd else 2 * spacing // 3)
            features.append(_features(cell, size, spacing, detector))
        tick((done + 1) / len(squares))
    if not marks:
        raise CatalogueError("the map has no texture in the region, or does not cover it; name another region or map")
    names = tuple(r.path.name for r in (*geo_map.layers, *([geo_map.terrain] if geo_map.terrain else [])))
    joined = Landmarks(*(np.concatenate(parts) for parts in zip(*marks, strict=True)))
    return Catalogue(
        names, gsd, detector or "none", joined, MapFeatures(*(np.concatenate(p) for p in zip(*features, strict=True)))
    )


def _squares(region: Region, size: float) -> Generator[Region]:
    """Parts of a region of about TILE pixels of ``size``; each as wide as its side nearer the equator needs."""
    span, width = TILE * size / A, _width(region)
    rows = max(1, math.ceil((region.north - region.south) / span))
    for i in range(rows):
        south = region.south + (region.north - region.south) * i / rows
        north = region.south + (region.north - region.south) * (i + 1) / rows
        widest = 1.0 if south <= 0.0 <= north else math.cos(min(abs(south), abs(north)))
        columns = max(1, math.ceil(width * widest / span))
        if widest * width < 1e-9:
            continue
        for j in range(columns):
            yield Region(south, region.west + width * j / columns, north, region.west + width * (j + 1) / columns)


def _picture(geo_map: GeoMap, square: Region, size: float) -> _Cell | None:
    """The map in the plane that touches the Earth in the middle of a square; None where it has nothing."""
    side = TILE + 2 * MARGIN
    shape = side, side
    nodes = (side - 1) // STEP + 2, (side - 1) // STEP + 2
    lat, lon = np.empty(nodes), np.empty(nodes)
    lat0, lon0 = 0.5 * (square.south + square.north), 0.5 * (square.west + square.east)
    plane_nodes(lat0, lon0, 0.0, size, 0.5 * (shape[0] - 1.0), STEP, lat, lon)
    colour, mask, _ = sample_map(geo_map, lat, lon, shape)
    if not mask.any():
        return None
    grid = geo_map.height_grid(lat, lon) or SEA_LEVEL
    h = _heights(grid, lat.ravel(), lon.ravel()).reshape(nodes)
    return _Cell(square, lat, lon, h, grid, CV.cvtColor(colour, cv2.COLOR_RGB2GRAY), mask)


def _heights(grid: HeightGrid, lat: F64, lon: F64) -> F64:
    """Heights (n,) [m]; 0 beyond the grid, as for the map's pixels without data."""
    return np.nan_to_num([height_at(*grid, a, b) for a, b in zip(lat.tolist(), lon.tolist(), strict=True)], nan=0.0)


def texture(grey: NDArray[np.uint8]) -> tuple[F64, F64, F64]:
    """Cramer-Rao bounds of a match in its best and its worst direction, pixels per grey level of white noise.

    The inverse square roots of the eigenvalues of the sum of the gradient's products over a window of WINDOW pixels
    (Foerstner 1982; as a measure of corners, Shi and Tomasi 1994). The third is that of their trace over MIDDLE pixels.
    """
    smooth = CV.GaussianBlur(grey.astype(np.float32), (0, 0), BLUR_PX)
    dx, dy = CV.Sobel(smooth, -1, 1, 0, scale=0.125), CV.Sobel(smooth, -1, 0, 1, scale=0.125)
    xx, xy, yy = (CV.boxFilter(p, cv2.CV_64F, (WINDOW, WINDOW), normalize=False) for p in (dx * dx, dx * dy, dy * dy))
    mean, spread = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    inner: F64 = CV.boxFilter(dx * dx + dy * dy, cv2.CV_64F, (MIDDLE, MIDDLE), normalize=False)
    best, worst = mean + spread, np.maximum(mean - spread, 0.0)
    return 1.0 / np.sqrt(best + 1e-9), 1.0 / np.sqrt(worst + 1e-9), 1.0 / np.sqrt(inner + 1e-9)


def _within(square: Region, lat: F64, lon: F64) -> NDArray[np.bool_]:
    """Whether places belong to a square; each place of a region belongs to one."""
    turn = np.remainder(lon - square.west, 2.0 * math.pi)
    return (lat >= square.south) & (lat < square.north) & (turn < square.east - square.west)


def _landmarks(geo_map: GeoMap, cell: _Cell, size: float, spacing: int) -> list[Landmarks]:
    """The place with the best bound in each small cell, with its chip."""
    best, worst, middle = texture(cell.grey)
    worst[middle > MIDDLE_SIGMA] = np.inf
    whole = CV.erode(cell.mask.astype(np.uint8), np.ones((CHIP + 1, CHIP + 1), np.uint8))
    worst[whole == 0] = np.inf
    count = -(-TILE // spacing)
    rows = _argmin_cells(worst, spacing, count)
    rows = rows[worst[rows[:, 1], rows[:, 0]] <= WORST_SIGMA]
    lat, lon, _ = _places(cell, rows.astype(float))
    h = _heights(cell.grid, lat, lon)
    slope = _slopes(cell, rows.astype(float), size)
    own = np.flatnonzero(_within(cell.region, lat, lon))
    found: list[Landmarks] = []
    for k in own.tolist():
        a, b, c = float(lat[k]), float(lon[k]), float(h[k])
        chip = _chip(geo_map, a, b, c, size)
        if chip is not None:
            column, row = rows[k]
            bounds = np.array([[best[row, column], worst[row, column]]])
            known = np.array([size]), np.array([a]), np.array([b]), np.array([c])
            place = np.array([ecef_from_geodetic(a, b, c)])
            found.append(Landmarks(chip[None], known[0], known[1], known[2], known[3], slope[k : k + 1], place, bounds))
    return found


def _argmin_cells(value: F64, spacing: int, count: int) -> NDArray[np.int64]:
    """Column and row (count^2, 2) of the least value in each cell of a grid in the middle of a picture."""
    rows = np.empty((count * count, 2), np.int64)
    start = (value.shape[0] - spacing * count) // 2
    for k in range(count * count):
        i, j = start + spacing * (k // count), start + spacing * (k % count)
        part = value[i : i + spacing, j : j + spacing]
        y, x = np.unravel_index(int(part.argmin()), part.shape)
        rows[k] = j + x, i + y
    return rows


def _places(cell: _Cell, pixel: F64) -> tuple[F64, F64, F64]:
    """Latitude, longitude [rad] and height [m] at pixels of a square's picture; bilinear between nodes."""
    x, y = pixel[:, 0] / STEP, pixel[:, 1] / STEP
    j, i = x.astype(np.int64), y.astype(np.int64)
    b, a = x - j, y - i

    def at(nodes: F64) -> F64:
        low = nodes[i, j] * (1.0 - b) + nodes[i, j + 1] * b
        return low * (1.0 - a) + (nodes[i + 1, j] * (1.0 - b) + nodes[i + 1, j + 1] * b) * a

    lon0 = cell.lon[0, 0]
    unwrapped = lon0 + np.remainder(cell.lon - lon0 + math.pi, 2.0 * math.pi) - math.pi
    return at(cell.lat), np.remainder(at(unwrapped) + math.pi, 2.0 * math.pi) - math.pi, at(cell.h)


def _slopes(cell: _Cell, pixel: F64, size: float) -> F64:
    """Rise of the ground to east and north (n, 2), over a chip's width around pixels (n, 2) of a square's picture."""
    reach, last = 0.4 * CHIP, cell.grey.shape[0] - 1.001

    def height(dx: float, dy: float) -> F64:
        return _places(cell, np.clip(pixel + np.array([dx, dy]), 0.0, last))[2]

    rise = np.column_stack([height(reach, 0.0) - height(-reach, 0.0), height(0.0, -reach) - height(0.0, reach)])
    return rise / (2.0 * reach * size)


def _chip(geo_map: GeoMap, lat: float, lon: float, h: float, size: float) -> NDArray[np.uint8] | None:
    """Chip (CHIP, CHIP) of a place, or None where the map does not fill it."""
    nodes = (CHIP - 1) // STEP + 2
    lats, lons = np.empty((nodes, nodes)), np.empty((nodes, nodes))
    plane_nodes(lat, lon, h, size, 0.5 * (CHIP - 1), STEP, lats, lons)
    colour, mask, _ = sample_map(geo_map, lats, lons, (CHIP, CHIP))
    return CV.cvtColor(colour, cv2.COLOR_RGB2GRAY) if mask.all() else None


def _features(cell: _Cell, size: float, spacing: int, detector: str | None) -> MapFeatures:
    """The strongest features of each small cell of a square."""
    if detector is None:
        return MapFeatures(np.empty((0, 3)), np.empty(0), np.empty((0, 1), np.float32))
    clear = CV.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(cell.grey)
    inner = CV.erode(cell.mask.astype(np.uint8), np.ones((17, 17), np.uint8))
    count = -(-TILE // spacing)
    found = detect(detector, clear, inner > 0, 4 * FEATURES_PER_CELL * count * count)
    lat, lon, _ = _places(cell, np.clip(found.place_px, 0.0, cell.grey.shape[0] - 1.001))
    keep = _within(cell.region, lat, lon)
    found, lat, lon = found.pick(keep), lat[keep], lon[keep]
    number = (found.place_px // spacing).astype(np.int64) @ np.array([1, 10000])
    order = np.lexsort((-found.response, number))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(number[order], number[order])
    chosen = np.flatnonzero(rank < FEATURES_PER_CELL)
    places = np.empty((len(chosen), 3))
    ground_at(cell.lat, cell.lon, cell.h, STEP, np.ascontiguousarray(found.place_px[chosen]), places)
    known = np.isfinite(places).all(axis=1)
    return MapFeatures(places[known], np.full(int(known.sum()), size), found.words[chosen][known])
