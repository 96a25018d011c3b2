"""The height of a place in a height file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from fsw.imaging.maps import GeoMap, MapError
from fsw.imaging.rasters import Raster
from fsw.math.compiled import plain
from modules.opnav.landmark_finder.kernel import height_at


def ground_height(dem: str | Path, lat: float, lon: float) -> float:
    """Height (m) at a latitude and longitude (rad), bilinear, above what the file's heights are above.

    Args:
        dem: heights in m, one band with a georeference. lat: rad. lon: rad, east positive.

    Raises:
        MapError: if the file cannot be read, or has no height there.
    """
    grid = GeoMap([], Raster(dem, heights=True)).height_grid(np.array([lat]), np.array([lon]))
    height = math.nan if grid is None else float(plain(height_at)(*grid, lat, lon))
    if not math.isfinite(height):
        place = f"latitude {math.degrees(lat):.6f}, longitude {math.degrees(lon):.6f} deg"
        raise MapError(f"{dem} has no height at {place}; take a file that covers it, or give the height")
    return height
