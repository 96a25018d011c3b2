"""Bad input of the Earth camera: a clear error, or a picture without a map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fsw.imaging.maps import GeoMap, MapError
from sim.camera.earth_camera import EarthCameraParams, EarthRenderer, Pose
from tests.sim.camera.earth_rig import OVERHEAD, PLAIN, camera, from_origin, looking, project_cv, write_map

PLACE = from_origin(2.0, 49.5, 0.02, 0.02)
CAMERA = camera(500.0, 96, 96)


def picture(files: Any, pose: Any = None, dem: Any = None, **params: Any) -> Any:
    maps = GeoMap.open(files, dem)
    return EarthRenderer(CAMERA, maps, EarthCameraParams(**{**PLAIN, **params})).render(
        pose or looking(48.5, 3.0, 420e3), OVERHEAD
    )


def ramp(dtype: Any, bands: int = 1, scale: float = 1.0) -> Any:
    """Values that grow from west to east, each band half of the one before."""
    one = np.tile(np.linspace(0.0, 1.0, 100), (100, 1))
    return (scale * np.stack([one / 2**k for k in range(bands)], axis=-1)).astype(dtype)


def test_no_georeference(tmp_path: Path) -> None:
    file = tmp_path / "plain.tif"
    Image.fromarray(ramp(np.uint8, 3, 255)).save(file)
    with pytest.raises(MapError, match=r"plain\.tif has no georeference \(no coordinate system\); use a GeoTIFF"):
        picture(file)


@pytest.mark.parametrize("missing", ["nothing.tif", "folder"])
def test_missing_file(tmp_path: Path, missing: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(MapError, match="does not exist"):
        picture(tmp_path / missing)


def test_corrupt_file(tmp_path: Path) -> None:
    file = tmp_path / "corrupt.tif"
    file.write_bytes(b"II*\x00" + bytes(range(200)))
    with pytest.raises(MapError, match=r"corrupt\.tif cannot be read"):
        picture(file)


@pytest.mark.parametrize("interpolated", [False, True])
def test_truncated_file(tmp_path: Path, interpolated: bool) -> None:
    """The header is whole and the pixels are not: the error comes with the first picture."""
    rng = np.random.default_rng(1)
    image = rng.integers(0, 255, (100, 100, 3)).astype(np.uint8)
    file = write_map(tmp_path / "cut.tif", image, "EPSG:4326", PLACE, tiled=True, blockxsize=16, blockysize=16)
    file.write_bytes(file.read_bytes()[:12000])
    with pytest.raises(MapError, match=r"cut\.tif cannot be read"):
        picture(file, interpolated=interpolated)


@pytest.mark.parametrize(("dtype", "scale"), [(np.uint8, 255), (np.uint16, 40000), (np.float32, 0.4), (np.int16, 3000)])
@pytest.mark.parametrize("bands", [1, 2, 3, 4])
def test_numbers_and_bands(tmp_path: Path, dtype: Any, scale: float, bands: int) -> None:
    """One band is grey, of more the first three are colours; other types than bytes are stretched."""
    options: dict[str, Any] = {"photometric": "minisblack"} if bands != 3 else {}
    file = write_map(tmp_path / "map.tif", ramp(dtype, bands, scale), "EPSG:4326", PLACE, **options)
    got = picture(file)
    middle = got.radiance[48]
    assert got.mask[48].mean() > 0.9
    seen = middle[got.mask[48]]
    assert np.all(np.diff(seen[:, 0]) >= -1e-4) and seen[-1, 0] - seen[0, 0] > 0.4
    if bands < 3:
        assert np.array_equal(seen[:, 0], seen[:, 2])
    else:
        assert seen[40, 0] > 1.5 * seen[40, 1] > 2.0 * seen[40, 2]


def test_alpha_is_no_data(tmp_path: Path) -> None:
    image = np.full((100, 100, 4), 200, np.uint8)
    image[:, :, 3] = 255
    image[40:60, 40:60, 3] = 0
    got = picture(write_map(tmp_path / "rgba.tif", image, "EPSG:4326", PLACE, photometric="rgb", alpha="yes"))
    assert not got.mask[46:50, 46:50].any() and got.radiance[46:50, 46:50].max() == 0.0
    assert got.mask[10, 10]


@pytest.mark.parametrize("value", [0.0, float("nan")])
def test_areas_without_data(tmp_path: Path, value: float) -> None:
    """Values that the file calls nodata, and NaN, are gaps; their neighbours keep their value."""
    image = np.full((100, 100), 0.5, np.float32)
    image[:10] = 0.25
    image[:, ::2] += 0.1
    image[40:60, 40:60] = value
    got = picture(write_map(tmp_path / "gaps.tif", image, "EPSG:4326", PLACE, nodata=value))
    assert not got.mask[46:50, 46:50].any()
    assert np.isfinite(got.radiance).all()
    assert got.mask[48, 20] and got.radiance[48, 20, 0] > 0.5


def test_tiny_map(tmp_path: Path) -> None:
    """One pixel of 0.2 degrees, and one of 20 m that no ray meets."""
    file = write_map(
        tmp_path / "one.tif", np.full((1, 1), 255, np.uint8), "EPSG:4326", from_origin(2.9, 48.6, 0.2, 0.2)
    )
    got = picture(file)
    x, y = project_cv(np.array([[4.207e6, 0.22e6, 4.78e6]]), looking(48.5, 3.0, 420e3), CAMERA)[0]
    assert np.isfinite([x, y]).all()
    assert got.mask[48, 48] and not got.mask[10, 10] and got.radiance[48, 48, 0] == pytest.approx(1.0)
    small = write_map(
        tmp_path / "small.tif", np.full((1, 1), 255, np.uint8), "EPSG:4326", from_origin(3.0, 48.5, 2e-4, 2e-4)
    )
    assert picture(small).mask.sum() <= 1


def test_map_elsewhere(tmp_path: Path) -> None:
    """A map that does not cover the view: black, and masked."""
    file = write_map(
        tmp_path / "far.tif", np.full((50, 50), 255, np.uint8), "EPSG:4326", from_origin(100.0, 10.0, 0.1, 0.1)
    )
    for interpolated in (False, True):
        got = picture(file, interpolated=interpolated)
        assert not got.mask.any() and got.radiance.max() == 0.0
    antipode = write_map(
        tmp_path / "utm.tif", np.full((9, 9), 255, np.uint8), "EPSG:32760", from_origin(5e5, 5e6, 30, 30)
    )
    assert not picture(antipode).mask.any()


def test_heights_elsewhere(tmp_path: Path) -> None:
    """A height file that does not cover the view: sea level."""
    heights = np.full((50, 50), 3000.0, np.float32)
    dem = write_map(tmp_path / "dem.tif", heights, "EPSG:4326", from_origin(100.0, 10.0, 0.1, 0.1))
    file = write_map(tmp_path / "map.tif", ramp(np.uint8, 3, 255), "EPSG:4326", PLACE)
    np.testing.assert_array_equal(picture(file, dem=dem).radiance, picture(file).radiance)


def test_looking_away(tmp_path: Path) -> None:
    """Only the sky is in view."""
    file = write_map(tmp_path / "map.tif", ramp(np.uint8, 3, 255), "EPSG:4326", PLACE)
    got = picture(file, looking(48.5, 3.0, 420e3, 150.0, 0.0), haze=1.0)
    assert not got.mask.any() and got.radiance.max() == 0.0


def test_camera_inside_the_earth(tmp_path: Path) -> None:
    file = write_map(tmp_path / "map.tif", ramp(np.uint8, 3, 255), "EPSG:4326", PLACE)
    with pytest.raises(ValueError, match=r"outside the Earth, got one 6266\.\d km from its centre; positions are in m"):
        picture(file, looking(48.5, 3.0, -100e3))
    pose = looking(48.5, 3.0, 420e3)
    with pytest.raises(ValueError, match="expected a camera outside the Earth"):
        picture(file, Pose(pose.r_CE_E / 1e3, pose.dcm_CE, pose.dcm_EN))  # km for m
    with pytest.raises(ValueError, match="expected finite numbers"):
        picture(file, Pose(pose.r_CE_E * np.nan, pose.dcm_CE, pose.dcm_EN))


def test_sun_nowhere(tmp_path: Path) -> None:
    file = write_map(tmp_path / "map.tif", ramp(np.uint8, 3, 255), "EPSG:4326", PLACE)
    renderer = EarthRenderer(CAMERA, GeoMap.open([file]), EarthCameraParams())
    with pytest.raises(ValueError, match="sun_E: expected a direction"):
        renderer.render(looking(48.5, 3.0, 420e3), np.zeros(3))


@pytest.mark.parametrize("crs", ["EPSG:3995", "EPSG:3857"])
def test_poles_and_date_line(tmp_path: Path, crs: str) -> None:
    """A map around the north pole is drawn at the pole; one of the world, across the date line."""
    if crs == "EPSG:3995":
        file = write_map(
            tmp_path / "pole.tif", np.full((200, 200), 90, np.uint8), crs, from_origin(-2e6, 2e6, 2e4, 2e4)
        )
        got = picture(file, looking(89.9, 10.0, 1e6))
    else:
        world = 20037508.342789244
        size = 2.0 * world / 512
        file = write_map(
            tmp_path / "world.tif", np.full((512, 512), 90, np.uint8), crs, from_origin(-world, world, size, size)
        )
        got = picture(file, looking(10.0, 180.0, 1e6))
    assert got.mask.all()
    np.testing.assert_allclose(got.radiance, 90.0 / 255.0, atol=1e-4)
