"""The renderer of the Earth camera against closed forms and OpenCV's projection of places that the maps show."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw.imaging.maps import GeoMap
from sim.camera.earth_camera import EarthCameraParams, EarthRenderer
from sim.camera.earth_camera.clouds import density, noise_lattice, threshold
from sim.camera.earth_camera.kernel import RAYLEIGH_RGB, arctan2, decay
from sim.environment.star_catalogue import bright_stars
from tests.sim.camera.earth_rig import (
    OVERHEAD,
    PLAIN,
    WGS84_A,
    WGS84_E2,
    camera,
    centroids,
    dots,
    ecef,
    from_origin,
    looking,
    mercator,
    project_cv,
    utm,
    write_map,
)

Criterion = Callable[[str, float], None]
MIDDLE = 48.5, 3.0
BENT = np.array([-0.1, 0.02, 0.001, -0.0005, 0.01])


def places() -> tuple[Any, Any]:
    """Irregular latitudes and longitudes [deg] of 36 dots."""
    rng = np.random.default_rng(3)
    lat, lon = (a.ravel() for a in np.meshgrid(np.linspace(47.7, 49.3, 6), np.linspace(1.8, 4.2, 6)))
    return lat + rng.uniform(-0.04, 0.04, 36), lon + rng.uniform(-0.04, 0.04, 36)


def dotted(folder: Path, crs: str) -> Path:
    """A map with a dot at each of the places."""
    lat, lon = places()
    grids = {"EPSG:4326": ((lon, lat), 0.002), "EPSG:3857": (mercator(lat, lon), 250.0)}
    (x, y), size = grids[crs] if crs in grids else (utm(lat, lon, 3.0), 160.0)
    image, transform = dots(x, y, size, 3.0)
    return write_map(folder / f"{crs[5:]}.tif", image, crs, transform)


def aimed(off_deg: float, azimuth_deg: float, height: float = 420e3) -> Any:
    """A camera that looks at the middle of the dots, off the vertical."""
    back = np.degrees(height * np.tan(np.radians(off_deg)) / 6.37e6)
    lat = MIDDLE[0] - back * np.cos(np.radians(azimuth_deg))
    lon = MIDDLE[1] - back * np.sin(np.radians(azimuth_deg)) / np.cos(np.radians(MIDDLE[0]))
    return looking(lat, lon, height, off_deg, azimuth_deg)


def flat(folder: Path, value: int = 128, size_deg: float = 8.0) -> Path:
    """A map of one value around the middle."""
    image = np.full((64, 64), value, np.uint8)
    corner = MIDDLE[1] - size_deg / 2.0, MIDDLE[0] + size_deg / 2.0
    return write_map(
        folder / f"flat{value}.tif", image, "EPSG:4326", from_origin(*corner, size_deg / 64, size_deg / 64)
    )


def drawn(files: Any, pose: Any, cam: Any, sun: Any = OVERHEAD, dem: Any = None, **params: Any) -> Any:
    """Radiance and mask."""
    return EarthRenderer(cam, GeoMap.open(files, dem), EarthCameraParams(**params)).render(pose, sun)


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:32631"])
def test_dots_are_where_opencv_projects_them(criterion: Criterion, tmp_path: Path, crs: str) -> None:
    """Three coordinate systems; at nadir, 30 degrees off, and with distortion; every ray, and the interpolated grid."""
    file, (lat, lon) = dotted(tmp_path, crs), places()
    for off, azimuth, distortion in ((0.0, 0.0, np.zeros(5)), (30.0, 60.0, np.zeros(5)), (10.0, 200.0, BENT)):
        pose, cam = aimed(off, azimuth), camera(1100.0, 640, 600, distortion=distortion)
        expected = project_cv(ecef(lat, lon), pose, cam)
        for name, interpolated in (("EARTH-1", False), ("EARTH-2", True)):
            found = centroids(drawn(file, pose, cam, interpolated=interpolated, **PLAIN).radiance[..., 1], expected, 8)
            away = np.linalg.norm(found - expected, axis=1)
            assert np.isfinite(away).sum() >= 30
            criterion(name, float(np.nanmax(away)))


def test_dots_on_a_mountain(criterion: Criterion, tmp_path: Path) -> None:
    """A hill of 4 km, seen 30 degrees off the vertical: it moves dots by more than 3 pixels."""
    lat, lon = places()

    def height(lat: Any, lon: Any) -> Any:
        return 4000.0 * np.exp(-(((lat - 48.5) / 0.4) ** 2) - ((lon - 3.0) / 0.6) ** 2)

    y, x = np.meshgrid(50.0 - 0.005 * (np.arange(600) + 0.5), 1.0 + 0.005 * (np.arange(800) + 0.5), indexing="ij")
    dem = write_map(
        tmp_path / "dem.tif", height(y, x).astype(np.float32), "EPSG:4326", from_origin(1.0, 50.0, 0.005, 0.005)
    )
    pose, cam = aimed(30.0, 60.0), camera(1100.0, 640, 600)
    expected = project_cv(ecef(lat, lon, height(lat, lon)), pose, cam)
    without = project_cv(ecef(lat, lon), pose, cam)
    assert np.max(np.linalg.norm(expected - without, axis=1)) > 3.0
    picture = drawn(dotted(tmp_path, "EPSG:4326"), pose, cam, dem=dem, **PLAIN).radiance[..., 1]
    found = centroids(picture, expected, 8)
    assert np.isfinite(found[:, 0]).sum() >= 30
    criterion("EARTH-3", float(np.nanmax(np.linalg.norm(found - expected, axis=1))))


def test_north_is_up_and_east_is_right(tmp_path: Path) -> None:
    """Red in the north, green in the east, blue in the south west, from straight above."""
    image = np.zeros((100, 100, 3), np.uint8)
    image[10:30, 40:60, 0], image[40:60, 70:90, 1], image[70:90, 10:30, 2] = 255, 255, 255
    file = write_map(tmp_path / "map.tif", image, "EPSG:4326", from_origin(2.0, 49.5, 0.02, 0.02))
    radiance = drawn(file, looking(48.5, 3.0, 420e3), camera(500.0, 256, 256), **PLAIN).radiance
    rows, columns = np.mgrid[:256, :256] - 127.5
    at = [[(radiance[..., c] * a).sum() / radiance[..., c].sum() for a in (columns, rows)] for c in range(3)]
    (nx, ny), (ex, ey), (sx, sy) = at
    assert ny < -30 and abs(nx) < 3
    assert ex > 20 and abs(ey) < 3
    assert sx < -20 and sy > 30


def test_colour_fringes_scale_each_channel(criterion: Criterion, tmp_path: Path) -> None:
    """Dots in red and blue lie where lenses with their own focal lengths project them."""
    (lat, lon), pose = places(), aimed(0.0, 0.0)
    cam = camera(1100.0, 640, 600, chromatic=np.array([1.002, 1.0, 0.997]))
    picture = drawn(dotted(tmp_path, "EPSG:4326"), pose, cam, **PLAIN).radiance
    for channel, factor in ((0, 1.002), (1, 1.0), (2, 0.997)):
        expected = project_cv(ecef(lat, lon), pose, camera(1100.0 * factor, 640, 600))
        away = centroids(picture[..., channel], expected, 8) - expected
        criterion("EARTH-4", float(np.nanmax(np.linalg.norm(away, axis=1))))


def test_light_of_a_flat_map(criterion: Criterion, tmp_path: Path) -> None:
    """Reflectance 128/255 below Suns at 0 to 80 degrees, Lambert and softer; at night it is dark."""
    file, pose, cam = flat(tmp_path), looking(*MIDDLE, 420e3), camera(4000.0, 64, 64)
    normal = ecef(*MIDDLE, 1.0) - ecef(*MIDDLE, 0.0)
    aside = np.cross(normal, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(normal, [0.0, 0.0, 1.0]))
    for angle in (0.0, 30.0, 60.0, 80.0):
        sun = np.cos(np.radians(angle)) * normal + np.sin(np.radians(angle)) * aside
        for k in (1.0, 0.7):
            got = drawn(file, pose, cam, sun, haze=0.0, sun_exponent=k).radiance[31:33, 31:33].mean()
            criterion("EARTH-5", float(got - 128.0 / 255.0 * np.cos(np.radians(angle)) ** k))
    assert drawn(file, pose, cam, -normal, haze=0.0).radiance.max() == 0.0
    bright = drawn(file, pose, cam, normal, haze=0.0, brightness=1.5).radiance[32, 32, 0]
    assert bright == pytest.approx(1.5 * 128.0 / 255.0, rel=1e-4)


def test_sunlight_comes_from_the_sun(tmp_path: Path) -> None:
    """With the Sun low in the east, the east of the picture is brighter."""
    east = np.cross([0.0, 0.0, 1.0], ecef(*MIDDLE))
    sun = ecef(*MIDDLE) / 6.4e6 + 2.0 * east / np.linalg.norm(east)
    got = drawn(flat(tmp_path), looking(*MIDDLE, 420e3), camera(600.0, 256, 256), sun, haze=0.0).radiance[..., 0]
    assert got[:, -1].mean() > got[:, 0].mean() + 0.01
    assert abs(got[0].mean() - got[-1].mean()) < 0.005


def test_haze_straight_down(criterion: Criterion, tmp_path: Path) -> None:
    """Sun at the zenith, camera at nadir: two air masses, scattering straight back (Chandrasekhar, single order)."""
    normal = ecef(*MIDDLE, 1.0) - ecef(*MIDDLE, 0.0)
    cam = camera(4000.0, 64, 64)
    got = drawn(flat(tmp_path), looking(*MIDDLE, 420e3), cam, normal, haze=1.3, aerosol=0.0).radiance[31:33, 31:33]
    through = np.exp(-2.0 * 1.3 * np.array(RAYLEIGH_RGB))
    expected = 128.0 / 255.0 * through + 0.25 * 1.5 * 0.5 * (1.0 - through)
    criterion("EARTH-6", float(np.max(np.abs(got.mean(axis=(0, 1)) - expected))))


@pytest.mark.parametrize("interpolated", [False, True])
def test_fine_patterns_average_to_grey(criterion: Criterion, tmp_path: Path, interpolated: bool) -> None:
    """A checker of 0.5 by 0.7 pixels a square, at nadir and 45 degrees off: no moire."""
    image = np.kron((np.indices((600, 600)).sum(axis=0) % 2).astype(np.uint8) * 255, np.ones((3, 3), np.uint8))
    file = write_map(tmp_path / "checker.tif", image, "EPSG:4326", from_origin(1.75, 49.75, 0.0014, 0.0014))
    for off in (0.0, 45.0):
        pose, cam = aimed(off, 30.0), camera(670.0, 128, 128)
        got = drawn(file, pose, cam, interpolated=interpolated, **PLAIN)
        assert got.mask[32:96, 32:96].all()
        criterion("EARTH-7", float(np.std(got.radiance[32:96, 32:96, 0])))
        assert got.radiance[32:96, 32:96, 0].mean() == pytest.approx(0.5, abs=0.01)


def test_fine_map_first_then_coarse(tmp_path: Path) -> None:
    """Where the fine map has no pixel, or no data, the coarse one shows; beyond both nothing does."""
    fine = np.full((100, 100), 200, np.uint8)
    mask = np.full((100, 100), 255, np.uint8)
    mask[40:60, 40:60] = 0
    first = write_map(tmp_path / "fine.tif", fine, "EPSG:4326", from_origin(2.5, 49.0, 0.01, 0.01), mask=mask)
    coarse = write_map(
        tmp_path / "coarse.tif", np.full((20, 20), 80, np.uint8), "EPSG:4326", from_origin(2.0, 49.5, 0.1, 0.1)
    )
    pose, cam = looking(*MIDDLE, 420e3), camera(420.0, 512, 512)
    got = drawn([first, coarse], pose, cam, **PLAIN)
    px = project_cv(ecef([48.9, 48.5, 49.4, 49.7], [3.3, 3.0, 3.9, 3.0]), pose, cam).round().astype(int)
    values = [round(255 * float(got.radiance[y, x, 0])) for x, y in px]
    assert values == [200, 80, 80, 0]
    assert [bool(got.mask[y, x]) for x, y in px] == [True, True, True, False]
    grid = drawn([first, coarse], pose, cam, interpolated=True, **PLAIN)
    assert np.array_equal(grid.mask, got.mask)


def test_interpolated_grid_against_every_ray(criterion: Criterion) -> None:
    """Grey levels on a real map with distortion, sunlight and haze."""
    data = Path(__file__).parents[3] / "sim" / "data"
    files = [data / "earth" / "blue_marble_z8_paris.tif", data / "earth" / "blue_marble_global_10800x5400.tif"]
    pose, cam = looking(47.5, 2.5, 420e3, 25.0, 20.0), camera(900.0, 512, 512, distortion=BENT)
    full, grid = (drawn(files, pose, cam, interpolated=k).radiance for k in (False, True))
    assert full.max() > 0.2
    criterion("EARTH-8", 255.0 * float(np.sqrt(np.mean((full - grid) ** 2))))


def test_limb_is_that_of_the_ellipsoid(tmp_path: Path) -> None:
    """Pixels are on the Earth where their line and the ellipsoid have two points in common, by the discriminant."""
    globe = write_map(
        tmp_path / "globe.tif", np.full((90, 180), 255, np.uint8), "EPSG:4326", from_origin(-180, 90, 2, 2)
    )
    pose, cam = looking(20.0, 30.0, 3e6, 5.0, 70.0), camera(150.0, 300, 300)
    mask = drawn(globe, pose, cam, **PLAIN).mask
    v, u = np.mgrid[:300, :300] - 149.5
    d = np.stack([u / 150.0, v / 150.0, np.ones_like(u)], axis=-1) @ pose.dcm_CE[0]
    q = np.diag([1.0, 1.0, 1.0 / (1.0 - WGS84_E2)]) / WGS84_A**2
    r = pose.r_CE_E[0]
    a, b, c = np.einsum("...i,ij,...j", d, q, d), d @ q @ r, r @ q @ r - 1.0
    seen = (b < 0.0) & (b * b - a * c >= 0.0)
    assert 0.1 < seen.mean() < 0.9
    assert np.array_equal(mask, seen)


def test_air_glows_beyond_the_limb_and_stars_shine() -> None:
    """Over the horizon in daylight there is light that falls to nothing, and far from it the stars of the catalogue."""
    pose, cam = looking(0.0, 0.0, 420e3, 75.0, 90.0), camera(300.0, 300, 300)
    globe = Path(__file__).parents[3] / "sim" / "data" / "earth" / "blue_marble_global_10800x5400.tif"
    got = drawn(globe, pose, cam, star_gain=1e6)
    column = got.radiance[:, 150, 2]
    limb = int(np.flatnonzero(got.mask[:, 150])[0])
    assert column[limb - 1] > 0.05 > column[limb - 30] >= 0.0
    stars = bright_stars()
    z = stars.u_N @ pose.dcm_CE[0].T
    pixel = project_cv(pose.r_CE_E[0] + 1e15 * stars.u_N[:200], pose, cam)
    shown = (z[:200, 2] > 0.1) & np.all((pixel > 8) & (pixel < 291), axis=1) & (pixel[:, 1] < limb - 40)
    assert shown.sum() >= 2
    found = centroids(got.radiance[..., 1], pixel[shown][:2], 1)
    np.testing.assert_allclose(found, pixel[shown][:2], atol=0.05)


def test_clouds_cover_their_part_and_stay(tmp_path: Path) -> None:
    """The same places are in cloud from two positions; another seed gives other clouds."""
    globe = write_map(tmp_path / "globe.tif", np.zeros((90, 180), np.uint8), "EPSG:4326", from_origin(-180, 90, 2, 2))
    sky: dict[str, Any] = {**PLAIN, "clouds": 0.5, "cloud_height": 1.0}
    cam = camera(300.0, 300, 300)
    wide = drawn(globe, looking(10.0, 20.0, 4e6), cam, **sky).radiance[..., 0]
    inner = wide[100:200, 100:200]
    assert inner.std() > 0.1
    lat, lon = (a.ravel() for a in np.meshgrid(np.linspace(8, 12, 9), np.linspace(18, 22, 9)))
    values: list[Any] = []
    for pose in (looking(10.0, 20.0, 2e6), looking(9.0, 21.0, 2e6)):
        picture = drawn(globe, pose, camera(1200.0, 512, 512), **sky).radiance[..., 0]
        x, y = project_cv(ecef(lat, lon), pose, camera(1200.0, 512, 512)).round().astype(int).T
        inside = (x >= 0) & (x < 512) & (y >= 0) & (y < 512)
        values.append(np.where(inside, picture[np.clip(y, 0, 511), np.clip(x, 0, 511)], np.nan))
    both = np.isfinite(values[0]) & np.isfinite(values[1])
    assert both.sum() > 20
    assert np.corrcoef(values[0][both], values[1][both])[0, 1] > 0.97
    other = drawn(globe, looking(10.0, 20.0, 4e6), cam, **{**sky, "cloud_seed": 2}).radiance[..., 0]
    assert np.corrcoef(other[100:200, 100:200].ravel(), inner.ravel())[0, 1] < 0.5


@pytest.mark.parametrize("cover", [0.2, 0.5, 0.8])
def test_clouds_cover_their_part(cover: float) -> None:
    """Of 6,000 places all over the Earth."""
    lattice, rng = noise_lattice(1), np.random.default_rng(0)
    u = rng.normal(size=(6000, 3))
    r = 6378e3 * u / np.linalg.norm(u, axis=1, keepdims=True)
    thick = [density(lattice, (x, y, z), threshold(cover), 3000.0) for x, y, z in r.tolist()]
    assert np.mean(np.array(thick) > 0.5) == pytest.approx(cover, abs=0.05)


def test_fast_functions() -> None:
    """Against the library's, all around and where they change branches."""
    rng = np.random.default_rng(1)
    for y, x in [*rng.normal(size=(500, 2)).tolist(), [0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0], [1.0, 1.0]]:
        assert arctan2(y, x) == pytest.approx(np.arctan2(y, x), abs=2e-15)
    for x in [0.0, 1e-9, 0.3, 2.0, 17.0, 59.0]:
        assert decay(x) == pytest.approx(np.exp(-x), rel=1e-6)
