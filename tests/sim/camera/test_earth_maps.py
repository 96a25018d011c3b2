"""The Earth camera and real map files: coasts, the edge at longitude 180, cloud-optimised GeoTIFF and JPEG 2000."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.drivers import raster_driver_extensions
from scipy.optimize import minimize_scalar

from fsw.imaging.maps import GeoMap
from sim.camera.earth_camera import EarthCameraParams, EarthRenderer
from tests.sim.camera.earth_rig import (
    OVERHEAD,
    PLAIN,
    WGS84_A,
    WGS84_E2,
    camera,
    ecef,
    from_origin,
    looking,
    project_cv,
    write_map,
)

Criterion = Callable[[str, float], None]
CASPIAN = Path(__file__).parents[3] / "sim" / "data" / "earth" / "blue_marble_z8_caspian.tif"
CV: Any = cv2


def shifted(at: Any, values: Any, line: Any) -> float:
    """How far along a line of map pixels a profile of it lies (least squares)."""

    def misfit(shift: float) -> float:
        return float(np.sum((values - np.interp(at - shift, np.arange(len(line)), line)) ** 2))

    found: Any = minimize_scalar(misfit, bounds=(-1.0, 1.0), method="bounded", options={"xatol": 1e-4})
    return float(found.x)


def coast_points(green: Any) -> list[tuple[int, int]]:
    """Row and column of steep coasts, spread over a map: the sea is dark in green."""
    found: list[tuple[int, int]] = []
    for row in range(40, green.shape[0] - 40, 200):
        steps = np.abs(green[row, 6:-40] - green[row, :-46])  # over 6 pixels
        steps[:40] = 0.0
        if steps.max() > 60.0:
            found.append((row, int(steps.argmax()) + 3))
    return found


@pytest.mark.parametrize("interpolated", [False, True])
def test_coasts_are_where_they_are_in_the_map(criterion: Criterion, interpolated: bool) -> None:
    """Coasts of the Caspian Sea are in the picture where Mercator's formula and OpenCV put those of the map."""
    with rasterio.open(CASPIAN) as data:
        green, transform = data.read(2).astype(float), data.transform
    points = coast_points(green)
    assert len(points) >= 5
    worst: list[float] = []
    for row, column in points:

        def place(columns: Any, row: int = row) -> Any:
            x, y = transform.c + transform.a * (np.asarray(columns) + 0.5), transform.f + transform.e * (row + 0.5)
            lat = np.degrees(2.0 * np.arctan(np.exp(y / WGS84_A)) - np.pi / 2.0)
            return ecef(np.full(x.shape, lat), np.degrees(x / WGS84_A))

        r = place([float(column)])[0]
        lat, lon = (
            np.degrees(np.arctan2(r[2], (1.0 - WGS84_E2) * np.hypot(r[0], r[1]))),
            np.degrees(np.arctan2(r[1], r[0])),
        )
        pose, cam = looking(lat - 0.1, lon + 0.1, 420e3, 5.0, 30.0), camera(2500.0, 400, 400)
        params = EarthCameraParams(**PLAIN, interpolated=interpolated)
        image = EarthRenderer(cam, GeoMap.open([CASPIAN]), params).render(pose, OVERHEAD).radiance[..., 1] * 255.0
        columns = np.linspace(column - 5.0, column + 5.0, 401)
        pixels = project_cv(place(columns), pose, cam).astype(np.float32)
        profile = CV.remap(image, pixels[None, :, 0].copy(), pixels[None, :, 1].copy(), cv2.INTER_CUBIC)[0]
        away = shifted(columns, profile, green[row])
        expected, there = project_cv(place([column, column + away]), pose, cam)
        worst.append(float(np.linalg.norm(there - expected)))
    criterion("EARTH-11", max(worst))


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857"])
@pytest.mark.parametrize("height", [800e3, 20000e3])
def test_edges_of_a_global_map_meet(tmp_path: Path, crs: str, height: float) -> None:
    """At longitude 180 a map looks as, turned by half the globe, it looks at longitude 0."""
    rng = np.random.default_rng(5)
    image = cv2.GaussianBlur(np.tile(rng.integers(0, 255, (360, 720, 3)).astype(np.uint8), (1, 3, 1)), (0, 0), 2.0)
    image = np.ascontiguousarray(image[:, 720:1440])
    half = np.pi * WGS84_A
    grid = from_origin(-180, 90, 0.5, 0.5) if crs == "EPSG:4326" else from_origin(-half, half, half / 360, half / 180)
    edge = write_map(tmp_path / "edge.tif", image, crs, grid)
    middle = write_map(tmp_path / "middle.tif", np.roll(image, 360, axis=1), crs, grid)
    cam = camera(300.0, 240, 240)
    for interpolated in (False, True):
        params = EarthCameraParams(**PLAIN, interpolated=interpolated)
        eye = EarthRenderer(cam, GeoMap.open([edge]), params)
        eye.render(looking(20.0, 60.0, height), OVERHEAD)  # the window of another view does not serve
        got = eye.render(looking(20.0, 179.0, height), OVERHEAD)
        expected = EarthRenderer(cam, GeoMap.open([middle]), params).render(looking(20.0, -1.0, height), OVERHEAD)
        np.testing.assert_array_equal(got.mask, expected.mask)
        assert got.mask[120, 100:140].all()
        np.testing.assert_allclose(got.radiance, expected.radiance, atol=2e-3)


@pytest.mark.parametrize(
    ("driver", "options"),
    [("COG", {"compress": "deflate"}), ("JP2OpenJPEG", {"quality": "100", "reversible": "yes"})],
)
def test_file_formats(tmp_path: Path, driver: str, options: dict[str, Any]) -> None:
    """A cloud-optimised GeoTIFF, and a JPEG 2000 without loss, give the picture of the plain GeoTIFF."""
    assert "jp2" in raster_driver_extensions()
    image = cv2.GaussianBlur(np.random.default_rng(6).integers(0, 255, (600, 700, 3)).astype(np.uint8), (0, 0), 2.0)
    plain = write_map(tmp_path / "plain.tif", image, "EPSG:4326", from_origin(2.0, 49.5, 0.003, 0.003))
    file = tmp_path / f"other.{'jp2' if driver != 'COG' else 'tif'}"
    with rasterio.open(plain) as data:
        profile = {"width": 700, "height": 600, "count": 3, "dtype": "uint8", "crs": data.crs}
        with rasterio.open(file, "w", driver=driver, transform=data.transform, **profile, **options) as out:
            out.write(data.read())
    cam, pose = camera(800.0, 200, 200), looking(48.6, 3.0, 420e3)
    got, expected = (
        EarthRenderer(cam, GeoMap.open([f]), EarthCameraParams(**PLAIN)).render(pose, OVERHEAD).radiance
        for f in (file, plain)
    )
    assert expected.std() > 0.01
    np.testing.assert_allclose(got, expected, atol=1e-5)
