"""A georeferenced map of the ground with its heights: what landmarks are looked up in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fsw.imaging.rasters import MapError, Raster, apply
from messages.base import F64

__all__ = ["GeoMap", "HeightGrid", "MapError"]

MAX_HEIGHT_PIXELS = 1536
"""Heights finer than this many rows or columns over a view are averaged: relief below a few pixels does not show."""


class HeightGrid(NamedTuple):
    """Heights on a regular grid of latitude and longitude, for compiled code."""

    heights: F64
    """(rows, columns) [m]."""
    lat0: float
    """Latitude of row 0 [rad]."""
    lon0: float
    """Longitude of column 0 [rad]."""
    dlat: float
    """Latitude from row to row [rad], usually negative."""
    dlon: float
    """Longitude from column to column [rad]."""


SEA_LEVEL = HeightGrid(np.zeros((2, 2)), -2.0, -8.0, 4.0, 16.0)
"""Height 0 everywhere."""


class GeoMap:
    """Map files, fine to coarse, and heights. Where a finer file has no data, a coarser one is used.

    Attributes:
        layers: the map files.
        terrain: the height file, or None for height 0 everywhere.
    """

    def __init__(self, layers: Sequence[Raster], terrain: Raster | None) -> None:
        """Use `open` instead."""
        self.layers, self.terrain = tuple(layers), terrain

    @classmethod
    def open(cls, files: Sequence[str | Path], dem: str | Path | None = None) -> GeoMap:
        """Open map files and a height file.

        Args:
            files: pictures of the ground, fine to coarse; any raster with a georeference that rasterio opens.
            dem: heights above the ellipsoid or the sea [m], one band (the file's own scale and offset are applied);
                pixels without data count as sea level. None: height 0 everywhere.

        Raises:
            MapError: if there is no file, or one cannot be read, is not georeferenced, or does not fit.
        """
        if isinstance(files, (str, Path)):
            files = [files]
        if not files:
            raise MapError("no map file was given; name one or more georeferenced rasters")
        terrain = None if dem is None else Raster(dem, heights=True)
        if terrain is not None and (terrain.inverse.b != 0.0 or terrain.inverse.d != 0.0):
            raise MapError(f"height file {dem} has rotated pixel axes; make it north-up with gdalwarp")
        return cls([Raster(f) for f in files], terrain)

    def covers(self, lat: float, lon: float) -> bool:
        """Whether a place [rad] lies on a map file and, if there is one, on the height file."""
        at = np.array([lat]), np.array([lon])
        mapped = any(bool(layer.inside(*layer.locate(*at))[0]) for layer in self.layers)
        return mapped and (self.terrain is None or bool(self.terrain.inside(*self.terrain.locate(*at))[0]))

    def height_grid(self, lat: F64, lon: F64) -> HeightGrid | None:
        """Heights around places [rad] (NaN ignored), or None if the height file covers none of them."""
        if self.terrain is None:
            return SEA_LEVEL
        column, row = self.terrain.locate(lat, lon)
        on = self.terrain.inside(column, row)
        if not on.any():
            return None
        spread = max(float(np.ptp(column[on])), float(np.ptp(row[on])))
        factor = 2 ** max(0, math.ceil(math.log2(max(1.0, spread / MAX_HEIGHT_PIXELS))))
        patch = self.terrain.patch(column, row, factor)
        if patch is None:
            return None
        to_world = ~self.terrain.inverse
        lon0, lat0 = apply(to_world, patch.column + 0.5 * factor, patch.row + 0.5 * factor)
        lon1, lat1 = apply(to_world, patch.column + 1.5 * factor, patch.row + 1.5 * factor)
        grid = np.ascontiguousarray(patch.image)
        return HeightGrid(grid, *np.radians([lat0, lon0, lat1 - lat0, lon1 - lon0]).tolist())
