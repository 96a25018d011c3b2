"""The map as a camera would see it from a given pose."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.imaging.maps import SEA_LEVEL, GeoMap, HeightGrid, MapError
from fsw.imaging.rasters import Raster
from fsw.math.camera import S_MAX
from messages.base import F64
from modules.opnav.landmark_finder.kernel import ground_at, ground_grid, spread

STEP = 4
"""The ground is computed for every STEP-th pixel of rows and columns, and is interpolated between."""
MAX_PATCH = 16384
"""Widest window of a map that is read: remapping takes 32767; views across longitude 180 reach it."""
CV: Any = cv2


class View(NamedTuple):
    """A rendered view. All arrays are in the pixels of the camera."""

    image: NDArray[np.uint8]
    """(rows, columns) grey, or (rows, columns, 3) red, green, blue."""
    mask: NDArray[np.bool_]
    """(rows, columns): False where the map says nothing."""
    lat: F64
    """Geodetic latitude [rad] of the ground at every STEP-th pixel; NaN off the Earth."""
    lon: F64
    """Longitude [rad], likewise."""
    h: F64
    """Height [m], likewise."""
    sharpness: float
    """Pixels of the map to one of the camera in the middle of the view; below 1 the map is the coarser one."""

    def ground(self, pixel: F64) -> F64:
        """Earth-fixed ground (n, 3) [m] at pixels (n, 2) (column, row); NaN off the Earth."""
        out = np.empty((len(pixel), 3))
        ground_at(self.lat, self.lon, self.h, STEP, np.ascontiguousarray(pixel, float), out)
        return out


def scaled_lens(lens: F64, factor: float) -> F64:
    """The lens of the same camera with pixels ``factor`` times as large; pixel centres stay at integers."""
    out = lens.copy()
    out[[0, 1, 4]] /= factor
    out[2:4] = (lens[2:4] + 0.5) / factor - 0.5
    return out


def pinhole(focal_px: float, shape: tuple[int, int]) -> F64:
    """Lens vector (11,) of an ideal camera with (rows, columns) pixels."""
    rows, columns = shape
    centre = [(columns - 1) / 2.0, (rows - 1) / 2.0]
    lens = np.array([focal_px, focal_px, *centre, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    lens[S_MAX] = 1e12
    return lens


def _ground(lens: F64, shape: tuple[int, int], r_CE_E: F64, dcm_CE: F64, grid: HeightGrid) -> tuple[F64, F64, F64]:
    nodes = tuple((n - 1) // STEP + 2 for n in shape)
    lat, lon, h = np.empty(nodes), np.empty(nodes), np.empty(nodes)
    ground_grid(lens, r_CE_E, dcm_CE, STEP, *grid, lat, lon, h)
    return lat, lon, h


def render_view(
    geo_map: GeoMap, lens: F64, shape: tuple[int, int], r_CE_E: F64, dcm_CE: F64, *, colour: bool = False
) -> View:
    """Render the map into a camera.

    Args:
        geo_map: map and heights.
        lens: lens vector of `fsw.math.camera` (11,).
        shape: rows and columns of the camera [px].
        r_CE_E: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: maps Earth-fixed to camera components (3, 3).
        colour: three channels instead of grey.

    Raises:
        MapError: if the map or the heights cover nothing of the view.
    """
    r_CE_E, dcm_CE = np.ascontiguousarray(r_CE_E, float), np.ascontiguousarray(dcm_CE, float)
    lat, lon, h = _ground(lens, shape, r_CE_E, dcm_CE, SEA_LEVEL)
    grid = geo_map.height_grid(lat, lon)
    if grid is None:
        raise MapError("the height file covers nothing of the view; use one that does, or none")
    if geo_map.terrain is not None:
        lat, lon, h = _ground(lens, shape, r_CE_E, dcm_CE, grid)
    image, mask, sharpness = sample_map(geo_map, lat, lon, shape)
    if not mask.any():
        raise MapError("the map covers nothing of the view; use map files of the region that the camera looks at")
    if not colour:
        image = cast("NDArray[np.uint8]", CV.cvtColor(image, cv2.COLOR_RGB2GRAY))
    return View(image, mask, lat, lon, h, sharpness)


def sample_map(
    geo_map: GeoMap, lat: F64, lon: F64, shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], float]:
    """Colours of the map on any grid of places.

    Args:
        geo_map: the map.
        lat: latitude [rad] of every STEP-th pixel of rows and columns, as in `View`; NaN where there is no ground.
        lon: longitude [rad], likewise.
        shape: rows and columns wanted.

    Returns:
        Colours (rows, columns, 3), where the map has data (rows, columns), and the sharpness as in `View`.
    """
    image = np.zeros((*shape, 3), np.uint8)
    mask = np.zeros(shape, np.bool_)
    sharpness = 0.0
    for layer in geo_map.layers:
        pixels, known, ratio = _sample(layer, lat, lon, shape)
        fresh = known & ~mask
        image[fresh] = pixels[fresh]
        mask |= fresh
        sharpness = max(sharpness, ratio if fresh.any() else 0.0)
        if mask.all():
            break
    return image, mask, sharpness


def _sample(
    layer: Raster, lat: F64, lon: F64, shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], float]:
    """One map file in the view: colours, where it has data, and its pixels to one of the camera."""
    column, row = layer.locate(lat, lon)
    ratio = _ratio(column, row)
    factor = 2 ** max(0, math.floor(math.log2(max(ratio, 1.0)) + 0.3))
    on_map = layer.inside(column, row)
    while on_map.any() and max(np.ptp(column[on_map]), np.ptp(row[on_map])) > MAX_PATCH * factor:
        factor *= 2
    patch = layer.patch(column, row, factor)
    if patch is None:
        return np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.bool_), 0.0
    x, y = np.empty(shape), np.empty(shape)
    spread((column - patch.column + 0.5) / factor - 0.5, STEP, x)
    spread((row - patch.row + 0.5) / factor - 0.5, STEP, y)
    rows, columns = patch.mask.shape
    on = (x >= 0.0) & (x <= columns - 1.0) & (y >= 0.0) & (y <= rows - 1.0)  # false where NaN
    x32, y32 = np.where(on, x, -9.0).astype(np.float32), np.where(on, y, -9.0).astype(np.float32)
    pixels = CV.remap(patch.image, x32, y32, cv2.INTER_LINEAR)
    whole = CV.remap(patch.mask, x32, y32, cv2.INTER_LINEAR) == 255
    return pixels, on & whole, ratio / factor


def _ratio(column: F64, row: F64) -> float:
    """Pixels of the map to one of the camera, where the middle of the view's ground is (median)."""
    du = np.hypot(np.diff(column, axis=1)[:-1], np.diff(row, axis=1)[:-1])
    dv = np.hypot(np.diff(column, axis=0)[:, :-1], np.diff(row, axis=0)[:, :-1])
    area = (du * dv)[np.isfinite(du * dv)]
    return float(np.sqrt(np.median(area))) / STEP if area.size else 0.0
