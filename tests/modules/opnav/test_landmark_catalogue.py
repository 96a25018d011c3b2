"""The catalogue: its places and chips by independent means, its file, its questions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import erfa
import numpy as np
import pytest

from fsw.imaging.maps import GeoMap
from messages.base import F64
from modules.opnav.landmark_catalogue import (
    CHIP,
    Catalogue,
    CatalogueError,
    Landmarks,
    MapFeatures,
    Region,
    build_catalogue,
    read_catalogue,
    region_of,
    write_catalogue,
)
from tests.modules.opnav import synthetic_ground as world

CV: Any = cv2
ERFA: Any = erfa
GSD = 1400.0


@pytest.fixture(scope="module")
def ground() -> world.Region:
    return world.region(pixels=320)


@pytest.fixture(scope="module")
def geo_map(ground: world.Region, tmp_path_factory: pytest.TempPathFactory) -> GeoMap:
    folder = tmp_path_factory.mktemp("map")
    files = world.write_map(folder / "map.tif", ground.texture, ground)
    return GeoMap.open([files], world.write_map(folder / "dem.tif", ground.heights.astype(np.float32), ground))


@pytest.fixture(scope="module")
def catalogue(geo_map: GeoMap) -> Catalogue:
    return build_catalogue(geo_map, gsd=GSD, levels=2)


def sampled(ground: world.Region, band: F64, lat_deg: F64, lon_deg: F64) -> F64:
    """Bilinear values of a band of the region, by OpenCV."""
    x = (lon_deg - ground.lon_deg[0]) / ground.pixel_deg
    y = (ground.lat_deg[0] - lat_deg) / ground.pixel_deg
    return CV.remap(band.astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR).ravel()


def test_places_and_heights(ground: world.Region, catalogue: Catalogue) -> None:
    """Earth-fixed places by ERFA, heights by OpenCV from the file's own pixels."""
    marks = catalogue.landmarks
    assert len(catalogue) > 40
    assert set(np.round(marks.gsd)) == {GSD, 2 * GSD}
    assert np.allclose(marks.r_LE_E, ERFA.gd2gc(1, marks.lon, marks.lat, marks.h), atol=1e-6)
    height = sampled(ground, ground.heights, np.degrees(marks.lat), np.degrees(marks.lon))
    assert np.abs(marks.h - height).max() < 1.0
    assert (marks.sigma[:, 0] <= marks.sigma[:, 1]).all()


def test_chips_lie_north_up_on_the_ground(ground: world.Region, catalogue: Catalogue) -> None:
    """The pixel two thirds out to east and north of the middle, by radii of curvature of the ellipsoid."""
    marks = catalogue.landmarks
    fine = np.flatnonzero(marks.gsd < 1.5 * GSD)
    a, e2 = 6378137.0, 0.00669437999014
    w = np.sqrt(1.0 - e2 * np.sin(marks.lat[fine]) ** 2)
    north_radius, east_radius = a * (1 - e2) / w**3, a / w
    middle = 0.5 * (CHIP - 1)
    for row, column in ((5, 50), (44, 12), (31, 31)):
        east, north = (column - middle) * GSD, (middle - row) * GSD
        lat = marks.lat[fine] + north / north_radius - 0.5 * (east / east_radius) ** 2 * np.tan(marks.lat[fine])
        lon = marks.lon[fine] + east / (east_radius * np.cos(lat))
        grey = sampled(ground, ground.texture.astype(float), np.degrees(lat), np.degrees(lon))
        assert np.abs(grey - marks.chips[fine, row, column]).max() < 4.0


def test_file_comes_back_and_damage_is_seen(catalogue: Catalogue, tmp_path: Path) -> None:
    file = tmp_path / "marks.npz"
    digest = write_catalogue(catalogue, file)
    back = read_catalogue(file)
    assert back.maps == ("map.tif", "dem.tif")
    assert (back.gsd, back.detector) == (GSD, "sift")
    for before, after in zip(
        (*catalogue.landmarks, *catalogue.features), (*back.landmarks, *back.features), strict=True
    ):
        assert before.dtype == after.dtype
        assert np.array_equal(before, after)
    assert write_catalogue(back, tmp_path / "again.npz") == digest
    whole = file.read_bytes()
    damaged = tmp_path / "damaged.npz"
    for broken in (whole[: len(whole) // 2], b"", b"no catalogue", whole[:4000] + b"\x55\xaa" * 40 + whole[4080:]):
        damaged.write_bytes(broken)
        with pytest.raises(CatalogueError, match=r"damaged\.npz"):
            read_catalogue(damaged)
    with np.load(file) as held:
        arrays = {name: held[name] for name in held.files}
    save: Any = np.savez
    for change, said in (
        ({"version": np.array(2)}, "format 2, expected 1"),
        ({"landmark_lat": arrays["landmark_lat"] + 1e-9}, "checksum"),
        ({"gsd_m": np.array(7.0)}, "checksum"),
    ):
        save(damaged, **{**arrays, **change})
        with pytest.raises(CatalogueError, match=said):
            read_catalogue(damaged)
    np.savez(damaged, picture=np.zeros(3))
    with pytest.raises(CatalogueError, match="is not a landmark catalogue"):
        read_catalogue(damaged)
    with pytest.raises(CatalogueError, match="does not exist"):
        read_catalogue(tmp_path / "missing.npz")


def scattered(lat_deg: F64, lon_deg: F64) -> Catalogue:
    """A catalogue of bare places."""
    n, lat, lon = len(lat_deg), np.radians(lat_deg), np.radians(lon_deg)
    places = np.array(ERFA.gd2gc(1, lon, lat, np.zeros(n)))
    chips = np.zeros((n, CHIP, CHIP), np.uint8)
    marks = Landmarks(chips, np.full(n, 1e3), lat, lon, np.zeros(n), np.zeros((n, 2)), places, np.ones((n, 2)))
    return Catalogue(("none",), 1e3, "none", marks, MapFeatures(np.empty((0, 3)), np.empty(0), np.empty((0, 1))))


def test_polygons_across_the_date_line_and_over_a_pole() -> None:
    lat, lon = (g.ravel() for g in np.meshgrid(np.arange(-89.5, 90, 3.0), np.arange(-179.5, 180, 3.0)))
    globe = scattered(lat, lon)
    box = np.radians([[-10.0, 170.0], [10.0, 170.0], [10.0, -170.0], [-10.0, -170.0]])
    found = globe.inside(box)
    away = (lon[found] + 180.0) % 360.0 - 180.0
    assert (np.abs(away) >= 170.0).all()
    # the northern edge is a great circle and bulges by 0.15 degrees; no place of the grid is that near
    assert sorted(found) == np.flatnonzero((np.abs(lat) < 10.0) & (np.abs(lon) > 170.0)).tolist()
    cap = np.radians([[70.0, k] for k in range(-180, 180, 2)])
    assert sorted(globe.inside(cap)) == np.flatnonzero(lat > 70.0).tolist()
    assert len(globe.inside(np.radians([[1.0, 1.0], [1.0, 2.0], [2.0, 2.0]]))) == 0
    for wrong in (np.zeros((2, 2)), np.full((4, 2), np.nan), np.radians([[-80.0, 0.0], [80.0, 10.0], [0.0, 175.0]])):
        with pytest.raises(CatalogueError, match="polygon"):
            globe.inside(wrong)


def test_view_finds_what_projects_into_it() -> None:
    """Against OpenCV's projection of all places, a camera over the pole among them."""
    rng = np.random.default_rng(4)
    lat, lon = np.degrees(np.arcsin(rng.uniform(-1, 1, 20000))), rng.uniform(-180, 180, 20000)
    globe = scattered(lat, lon)
    shot = world.looking_down()
    for r in (shot.r_CE_E, np.array([0.0, 3e5, 6.8e6]), np.array([-6.9e6, 1e4, 2e5])):
        z = -r / np.linalg.norm(r)
        x = np.cross(z, [0.3, 0.1, 0.2])
        x /= np.linalg.norm(x)
        here = shot._replace(r_CE_E=r, dcm_CE=np.array([x, np.cross(z, x), z]))
        seen = globe.in_view(world.lens_of(here), here.shape, r, here.dcm_CE, 10.0)
        ray = globe.landmarks.r_LE_E - r
        near = (ray @ z > 0.7 * np.linalg.norm(ray, axis=1)) & (np.linalg.norm(ray, axis=1) < 1.5e6)
        near = np.flatnonzero(near)  # what is farther off comes back into the image by the lens's polynomial
        pixel = world.pixels_of(here, globe.landmarks.r_LE_E[near])
        inside = (pixel > 10).all(axis=1) & (pixel < np.array(here.shape[::-1]) - 11.0).all(axis=1)
        assert inside.sum() > 5
        assert seen.mark.tolist() == near[inside].tolist()
        assert np.allclose(seen.pixel, pixel[inside], atol=1e-6)
        # a chip of 1 km at the middle, some 400 to 500 km below
        height = np.linalg.norm(r) - 6.37e6
        assert np.median(seen.zoom) == pytest.approx(shot.k[0, 0] * 1e3 / height, rel=0.15)


def test_what_cannot_be_made_is_said(geo_map: GeoMap, tmp_path: Path) -> None:
    region = region_of(geo_map.layers[0])
    assert np.allclose(np.degrees(region), [world.LAT - 2.08, world.LON - 2.08, world.LAT + 2.08, world.LON + 2.08])
    elsewhere = Region(*np.radians([10.0, 10.0, 11.0, 11.0]).tolist())
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"region": elsewhere}, "no texture in the region"),
        ({"region": Region(0.2, 0.0, 0.1, 0.1)}, "southern and a northern"),
        ({"gsd": -1.0}, "gsd"),
        ({"detector": "eye"}, "detector: expected one of"),
        ({"levels": 0}, "levels from 1 to 8"),
    ]
    make: Any = build_catalogue
    for arguments, said in wrong:
        with pytest.raises(CatalogueError, match=said):
            make(geo_map, **arguments)
    flat = world.region(pixels=128)
    flat = flat._replace(texture=np.full_like(flat.texture, 90))
    with pytest.raises(CatalogueError, match="no texture"):
        build_catalogue(GeoMap.open([world.write_map(tmp_path / "flat.tif", flat.texture, flat)]), gsd=GSD, levels=1)
