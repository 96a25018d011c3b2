"""Windows of georeferenced rasters, through rasterio: any format, coordinate system and size."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Generator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import warp
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.windows import Window

from messages.base import F64

RASTERIO: Any = rasterio
WARP: Any = warp
TILE = 1024
"""Windows begin and end at multiples of this many pixels, so that neighbouring views share one."""
MERCATOR_RADIUS = 6378137.0
"""Of EPSG:3857 [m]: Web Mercator is spherical, on the geodetic latitude (EPSG guidance note 7-2, method 1024)."""


class MapError(ValueError):
    """A map or height file that cannot be used; one sentence that says which, why, and what to do."""


class Patch(NamedTuple):
    """A window of a raster, each pixel the mean of ``factor`` x ``factor`` of the file's."""

    image: NDArray[Any]
    """(rows, columns, 3) uint8 for a map, (rows, columns) float64 [m] for heights."""
    mask: NDArray[np.uint8]
    """(rows, columns): 255 where there is data."""
    column: int
    row: int
    factor: int


@contextlib.contextmanager
def opened(path: str | Path, *, geographic: bool = False) -> Generator[Any]:
    """An open dataset with a coordinate system, closed afterwards; warped to geographic WGS84 coordinates on request.

    Raises:
        MapError: if the file cannot be read or is not georeferenced.
    """
    path = Path(path)
    if not path.is_file():
        raise MapError(f"map file {path} does not exist")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            dataset: Any = RASTERIO.open(path)
    except RasterioError as error:
        raise MapError(f"map file {path} cannot be read as a raster ({error})") from error
    with dataset:
        if dataset.crs is None or dataset.transform.is_identity or dataset.transform.determinant == 0.0:
            missing = "coordinate system" if dataset.crs is None else "transform from pixels to coordinates"
            raise MapError(
                f"map file {path} has no georeference (no {missing}); use a GeoTIFF, or put a world file "
                f"and an .aux.xml file with the coordinate system beside it"
            )
        if geographic and dataset.crs.to_epsg() != 4326:
            with WarpedVRT(dataset, crs="EPSG:4326", resampling=Resampling.bilinear) as warped:
                yield warped
        else:
            yield dataset


class Raster:
    """One georeferenced raster file, read in windows when they are needed. The last window is kept."""

    def __init__(self, path: str | Path, *, heights: bool = False) -> None:
        """Open and check the file.

        Args:
            path: the file.
            heights: it holds heights in its first band (scale and offset of the file are applied), not a picture.

        Raises:
            MapError: as `opened`, or if the coordinate system cannot be related to WGS84.
        """
        self.path, self.heights = Path(path), heights
        with opened(path, geographic=heights) as data:
            self.crs: Any = data.crs
            self.epsg: int | None = data.crs.to_epsg()
            self.inverse: Any = ~data.transform
            self.shape: tuple[int, int] = data.shape
            self.palette: NDArray[np.uint8] | None = _palette(data)
            self.bands = [1, 2, 3] if data.count >= 3 and not heights else [1]
            self.scale, self.offset = float(data.scales[0]), float(data.offsets[0])
            self.stretch = None if heights or data.dtypes[0] == "uint8" else self._limits(data)
            middle = apply(data.transform, data.width / 2.0, data.height / 2.0)
        self._patch: Patch | None = None
        try:
            lon, _ = WARP.transform(self.crs, "EPSG:4326", [middle[0]], [middle[1]])[:2]
        except RasterioError as error:
            raise MapError(f"map file {path}: its coordinate system cannot be related to WGS84 ({error})") from error
        self.middle_lon_deg = float(lon[0])

    def _limits(self, data: Any) -> tuple[float, float]:
        """Values shown as black and white, from a small overview: correlation does not mind how they are chosen."""
        small = [max(1, n // math.ceil(max(data.shape) / 512)) for n in data.shape]
        values = data.read(self.bands, out_shape=(len(self.bands), *small), masked=True).compressed()
        values = values[np.isfinite(values)]
        if values.size == 0:
            raise MapError(f"map file {self.path} holds no data")
        low, high = np.percentile(values, [1.0, 99.0])
        return float(low), float(max(high, low + 1e-9))

    def locate(self, lat: F64, lon: F64) -> tuple[F64, F64]:
        """Pixel column and row of geodetic coordinates [rad]; pixel centres at integers; NaN where undefined."""
        lat_deg, lon_deg = np.degrees(lat), np.degrees(lon)
        lon_deg = self.middle_lon_deg + np.remainder(lon_deg - self.middle_lon_deg + 180.0, 360.0) - 180.0
        if self.epsg == 3857:
            x = MERCATOR_RADIUS * np.radians(lon_deg)
            y = MERCATOR_RADIUS * np.arctanh(np.sin(lat))
        elif self.epsg == 4326:
            x, y = lon_deg, lat_deg
        else:
            x, y = self._warped(lon_deg, lat_deg)
        column, row = apply(self.inverse, x, y)
        return column - 0.5, row - 0.5

    def _warped(self, lon_deg: F64, lat_deg: F64) -> tuple[F64, F64]:
        known = np.isfinite(lon_deg) & np.isfinite(lat_deg)
        x, y = np.full(lon_deg.shape, np.nan), np.full(lon_deg.shape, np.nan)
        if known.any():
            xs, ys = WARP.transform("EPSG:4326", self.crs, lon_deg[known], lat_deg[known])[:2]
            x[known], y[known] = xs, ys
        x[~np.isfinite(x)], y[~np.isfinite(y)] = np.nan, np.nan
        return x, y

    def inside(self, column: F64, row: F64) -> NDArray[np.bool_]:
        """Whether pixel coordinates lie on the raster."""
        rows, columns = self.shape
        return (column >= -0.5) & (column <= columns - 0.5) & (row >= -0.5) & (row <= rows - 0.5)

    def patch(self, column: F64, row: F64, factor: int) -> Patch | None:
        """The window that covers those of the coordinates that lie on the raster, or None if none does."""
        on = self.inside(column, row)
        if not on.any():
            return None
        rows, columns = self.shape
        tile = TILE * factor
        left = max(0, int(column[on].min()) - 2 * factor) // tile * tile
        top = max(0, int(row[on].min()) - 2 * factor) // tile * tile
        right = min(columns, (int(column[on].max()) + 2 * factor) // tile * tile + tile)
        bottom = min(rows, (int(row[on].max()) + 2 * factor) // tile * tile + tile)
        kept = self._patch
        if kept is None or kept.factor != factor or not _holds(kept, left, top, right, bottom):
            self._patch = kept = self._read(left, top, right, bottom, factor)
        # Cut to this view's own window: the answer must not depend, not even by rounding, on what was read before
        i, j = (top - kept.row) // factor, (left - kept.column) // factor
        height, width = max(1, (bottom - top) // factor), max(1, (right - left) // factor)
        box = slice(i, i + height), slice(j, j + width)
        return Patch(kept.image[box], kept.mask[box], left, top, factor)

    def _read(self, left: int, top: int, right: int, bottom: int, factor: int) -> Patch:
        # Whole multiples of the factor, or the means would not be centred; the last partial row and column are left out
        width, height = max(1, (right - left) // factor), max(1, (bottom - top) // factor)
        window = Window(left, top, width * factor, height * factor)  # pyright: ignore[reportCallIssue]
        options: dict[str, Any] = {"window": window, "out_shape": (height, width)}
        try:
            with opened(self.path, geographic=self.heights) as data:
                how = Resampling.nearest if self.palette is not None or factor == 1 else Resampling.average
                bands = [data.read(b, resampling=how, **options) for b in self.bands]
                mask = data.dataset_mask(resampling=Resampling.nearest, **options)
        except RasterioError as error:
            raise MapError(f"map file {self.path} cannot be read ({error})") from error
        if self.heights:
            image = np.where(mask > 0, bands[0].astype(np.float64) * self.scale + self.offset, 0.0)
        elif self.palette is not None:
            image = self.palette[bands[0]]
        else:
            image = np.ascontiguousarray(np.dstack([self._bytes(b) for b in (bands * 3)[:3]]))
        return Patch(image, mask.astype(np.uint8), left, top, factor)

    def _bytes(self, band: NDArray[Any]) -> NDArray[np.uint8]:
        if self.stretch is None:
            return band
        low, high = self.stretch
        scaled = (np.nan_to_num(band.astype(np.float64), nan=low) - low) * (255.0 / (high - low))
        return np.clip(np.rint(scaled), 0.0, 255.0).astype(np.uint8)


def apply(transform: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """An affine transform (a, b, c, d, e, f) of numbers or arrays."""
    return transform.a * x + transform.b * y + transform.c, transform.d * x + transform.e * y + transform.f


def _holds(patch: Patch, left: int, top: int, right: int, bottom: int) -> bool:
    rows, columns = patch.mask.shape
    far_right, far_bottom = patch.column + columns * patch.factor, patch.row + rows * patch.factor
    return (
        patch.column <= left
        and patch.row <= top
        and far_right > right - patch.factor
        and far_bottom > bottom - patch.factor
    )


def _palette(data: Any) -> NDArray[np.uint8] | None:
    if data.colorinterp[0] != ColorInterp.palette:
        return None
    colours = np.zeros((256, 3), np.uint8)
    for index, colour in data.colormap(1).items():
        if index < 256:
            colours[index] = colour[:3]
    return colours
