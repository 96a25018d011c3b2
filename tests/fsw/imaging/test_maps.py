"""Map files of several kinds, and those that are refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from rasterio import Affine, warp
from rasterio.enums import ColorInterp

from fsw.imaging.maps import GeoMap, MapError
from fsw.imaging.rasters import TILE, Raster

CV: Any = cv2
RASTERIO: Any = rasterio
WARP: Any = warp
ROOT = Path(__file__).parents[3]
PLACES = [(36.2, 51.3), (36.0, 52.0), (35.7, 52.6)]


def write(path: Path, bands: NDArray[Any], crs: str | None, transform: Any, **options: Any) -> Path:
    count, height, width = bands.shape
    profile = {"driver": "GTiff", "dtype": bands.dtype, "count": count, "height": height, "width": width}
    with RASTERIO.open(path, "w", crs=crs, transform=transform, **{**profile, **options}) as out:
        out.write(bands)
    return path


def ramp(shape: tuple[int, int] = (300, 400), kind: Any = np.uint8) -> NDArray[Any]:
    return (np.add.outer(np.arange(shape[0]), np.arange(shape[1])) % 251)[None].astype(kind)


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:32639", "EPSG:3395"])
def test_places_are_located_as_proj_does(tmp_path: Path, crs: str) -> None:
    corner = WARP.transform("EPSG:4326", crs, [51.0, 53.0], [37.0, 35.0])
    (left, right), (top, bottom) = corner[0], corner[1]
    transform = Affine((right - left) / 400, 0.0, left, 0.0, (bottom - top) / 300, top)
    layer = Raster(write(tmp_path / "map.tif", ramp(), crs, transform))
    lat, lon = np.radians(np.array(PLACES)).T
    column, row = layer.locate(lat, lon)
    xs, ys = WARP.transform("EPSG:4326", crs, [p[1] for p in PLACES], [p[0] for p in PLACES])[:2]
    for k, (x, y) in enumerate(zip(xs, ys, strict=True)):
        assert column[k] == pytest.approx((x - left) * 400 / (right - left) - 0.5, abs=1e-6)
        assert row[k] == pytest.approx((y - top) * 300 / (bottom - top) - 0.5, abs=1e-6)
    assert np.isnan(layer.locate(np.array([math.nan]), np.array([0.0]))[0]).all()
    # the same place a turn away
    again = layer.locate(lat, lon - 2.0 * math.pi)[0]
    np.testing.assert_allclose(again, column, atol=1e-6)


def test_windows_hold_the_pixels_of_the_file(tmp_path: Path) -> None:
    size = TILE + 300
    bands = ramp((size, size))
    layer = Raster(write(tmp_path / "map.tif", bands, "EPSG:4326", Affine(0.001, 0.0, 50.0, 0.0, -0.001, 40.0)))
    far = np.array([float(TILE + 50)])
    patch = layer.patch(far, far, 1)
    assert patch is not None
    assert (patch.column, patch.row) == (TILE, TILE)
    np.testing.assert_array_equal(patch.image[..., 0], bands[0, TILE:, TILE:])
    whole = layer.patch(np.array([0.0, size - 1.0]), np.array([0.0, size - 1.0]), 1)
    again = layer.patch(far, far + 20.0, 1)
    assert whole is not None
    assert again is not None
    assert np.shares_memory(again.image, whole.image)  # kept, but cut to the same window as before
    assert (again.column, again.row) == (TILE, TILE)
    np.testing.assert_array_equal(again.image, patch.image)
    halved = layer.patch(np.array([0.0, size - 1.0]), np.array([0.0, size - 1.0]), 2)
    assert halved is not None
    mean = bands[0].astype(float).reshape(size // 2, 2, size // 2, 2).mean(axis=(1, 3))
    assert np.abs(halved.image[..., 1] - mean).max() <= 0.5
    assert layer.patch(np.array([-30.0]), np.array([5.0]), 1) is None


def test_other_kinds_of_pixels(tmp_path: Path) -> None:
    transform = Affine(0.01, 0.0, 50.0, 0.0, -0.01, 40.0)
    wide = Raster(write(tmp_path / "wide.tif", ramp(kind=np.uint16) * 40, "EPSG:4326", transform))
    everywhere = np.array([0.0, 399.0]), np.array([0.0, 299.0])
    patch = wide.patch(*everywhere, 1)
    assert patch is not None
    assert np.corrcoef(patch.image[..., 0].ravel(), ramp().ravel())[0, 1] > 0.999
    holes = ramp(kind=np.float32)
    holes[0, :50] = -9999.0
    part = Raster(write(tmp_path / "holes.tif", holes, "EPSG:4326", transform, nodata=-9999.0)).patch(*everywhere, 1)
    assert part is not None
    assert not part.mask[:50].any()
    assert part.mask[50:].all()
    path = write(tmp_path / "palette.tif", ramp() % 4, "EPSG:4326", transform)
    with RASTERIO.open(path, "r+") as out:
        out.colorinterp = [ColorInterp.palette]
        out.write_colormap(1, {0: (0, 0, 0), 1: (10, 20, 30), 2: (40, 50, 60), 3: (250, 0, 7)})
    painted = Raster(path).patch(*everywhere, 1)
    assert painted is not None
    assert painted.image[0, 3].tolist() == [250, 0, 7]


def test_heights_of_the_shipped_file() -> None:
    """The side-car file makes the picture a raster of heights: peaks and seas are where they are."""
    earth = ROOT / "sim" / "data" / "earth"
    geo_map = GeoMap.open([earth / "blue_marble_z8_caspian.tif"], earth / "nasa_topography_2048x1024.png")
    known = [
        (35.95, 52.11, 5610.0),
        (40.0, 51.0, 0.0),
        (27.99, 86.93, 8849.0),
        (-30.0, -140.0, 0.0),
        (0.0, 179.95, 0.0),
    ]
    for lat, lon, height in known:
        grid = geo_map.height_grid(np.radians([[lat]]), np.radians([[lon]]))
        assert grid is not None
        row = round((math.radians(lat) - grid.lat0) / grid.dlat)
        column = round((math.radians(lon) - grid.lon0) / grid.dlon)
        found = float(grid.heights[row - 1 : row + 2, max(column - 1, 0) : column + 2].max())
        # pixels of 19.5 km flatten the peaks
        assert 0.4 * height <= found <= height + 25.0
    assert geo_map.covers(math.radians(37.0), math.radians(51.0))
    assert not geo_map.covers(math.radians(48.0), math.radians(2.0))


def test_heights_in_another_coordinate_system(tmp_path: Path) -> None:
    band = np.full((1, 200, 200), 1234.0, np.float32)
    band[0, :, 100:] = 300.0
    dem = write(tmp_path / "utm.tif", band, "EPSG:32639", Affine(1000.0, 0.0, 500e3, 0.0, -1000.0, 4100e3))
    geo_map = GeoMap.open([dem], dem)
    xs, ys = WARP.transform("EPSG:32639", "EPSG:4326", [540e3, 660e3], [4000e3, 4000e3])[:2]
    grid = geo_map.height_grid(np.radians([ys]), np.radians([xs]))
    assert grid is not None
    for lon, lat, height in zip(xs, ys, (1234.0, 300.0), strict=True):
        row = round((math.radians(lat) - grid.lat0) / grid.dlat)
        column = round((math.radians(lon) - grid.lon0) / grid.dlon)
        assert grid.heights[row, column] == height
    assert geo_map.height_grid(np.radians([[10.0]]), np.radians([[10.0]])) is None


def test_heights_without_data_are_the_sea(tmp_path: Path) -> None:
    band = np.full((1, 40, 40), -32768, np.int16)
    band[0, :, 20:] = 500
    at = Affine(0.1, 0.0, 50.0, 0.0, -0.1, 40.0)
    dem = write(tmp_path / "dem.tif", band, "EPSG:4326", at, nodata=-32768)
    grid = GeoMap.open([dem], dem).height_grid(np.radians([[38.0]]), np.radians([[52.0]]))
    assert grid is not None
    assert set(np.unique(grid.heights)) == {0.0, 500.0}


def test_files_that_are_refused(tmp_path: Path) -> None:
    good = Affine(0.1, 0.0, 50.0, 0.0, -0.1, 40.0)
    text = tmp_path / "notes.tif"
    text.write_text("not a picture")
    turned = write(tmp_path / "turned.tif", ramp(), "EPSG:4326", Affine(0.1, 0.02, 50.0, 0.02, -0.1, 40.0))
    nowhere = tmp_path / "nowhere.png"
    assert CV.imwrite(str(nowhere), ramp()[0])
    no_system = write(tmp_path / "no_system.tif", ramp(), None, good)
    fine = write(tmp_path / "fine.tif", ramp(), "EPSG:4326", good)
    empty = write(tmp_path / "empty.tif", np.full((1, 9, 9), -1.0, np.float32), "EPSG:4326", good, nodata=-1.0)
    cases: list[tuple[list[Path], Path | None, str]] = [
        ([], None, "no map file"),
        ([tmp_path / "absent.tif"], None, "does not exist"),
        ([text], None, "cannot be read as a raster"),
        ([nowhere], None, "no georeference"),
        ([no_system], None, "no coordinate system"),
        ([fine], nowhere, "no georeference"),
        ([fine], turned, "rotated pixel axes"),
        ([empty], None, "holds no data"),
    ]
    for files, dem, message in cases:
        with pytest.raises(MapError, match=message):
            GeoMap.open(files, dem)
