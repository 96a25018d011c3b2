"""Rendered places against their projection by ERFA and OpenCV; relief; what is not on the map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fsw.imaging.maps import SEA_LEVEL, GeoMap, MapError
from fsw.math.geodesy import ecef_from_geodetic
from modules.opnav.landmark_finder.kernel import ground_grid, ground_point, height_at, spread
from modules.opnav.landmark_finder.render import pinhole, render_view, scaled_lens
from tests.modules.opnav import synthetic_ground as world


def dots(ground: world.Region) -> tuple[world.Region, NDArray[np.int64]]:
    """The region with bright spots on black, and their grid indices."""
    at = np.array([[r, c] for r in range(150, 340, 45) for c in range(150, 340, 45)])
    texture = np.zeros(ground.texture.shape, np.uint8)
    texture[at[:, 0], at[:, 1]] = 255
    blurred = cv2.GaussianBlur(texture.astype(np.float32), (0, 0), 2.0)
    return ground._replace(texture=(blurred * 250 / blurred.max()).astype(np.uint8)), at


def test_places_land_where_they_project(tmp_path: Path, criterion: Callable[[str, float], None]) -> None:
    """FIND-1."""
    ground, at = dots(world.region())
    shot = world.looking_down()
    files = world.write_map(tmp_path / "map.tif", ground.texture, ground)
    dem = world.write_map(tmp_path / "dem.tif", ground.heights.astype(np.float32), ground)
    view = render_view(GeoMap.open([files], dem), world.lens_of(shot), shot.shape, shot.r_CE_E, shot.dcm_CE)
    r = world.positions(ground.lat_deg[at[:, 0]], ground.lon_deg[at[:, 1]], ground.heights[at[:, 0], at[:, 1]])
    wanted = world.pixels_of(shot, r)
    worst, seen = 0.0, 0
    for column, row in wanted:
        i, j = round(row), round(column)
        if not (8 <= i < shot.shape[0] - 8 and 8 <= j < shot.shape[1] - 8):
            continue
        box = view.image[i - 7 : i + 8, j - 7 : j + 8].astype(float)
        rows, columns = np.mgrid[i - 7 : i + 8, j - 7 : j + 8]
        centre = np.array([(box * columns).sum(), (box * rows).sum()]) / box.sum()
        worst, seen = max(worst, float(np.abs(centre - [column, row]).max())), seen + 1
    assert seen > 12
    criterion("FIND-1", worst)
    np.testing.assert_allclose(view.ground(wanted[:5]), r[:5], atol=60.0)  # 4 px of relief between nodes, in m


def test_ground_lies_on_the_ray_and_on_the_terrain(tmp_path: Path) -> None:
    ground, shot = world.region(), world.looking_down()
    dem = world.write_map(tmp_path / "dem.tif", ground.heights.astype(np.float32), ground)
    geo_map = GeoMap.open([dem], dem)
    lens = world.lens_of(shot)
    nodes = 41, 61
    lat, lon, h = np.empty(nodes), np.empty(nodes), np.empty(nodes)
    ground_grid(lens, shot.r_CE_E, shot.dcm_CE, 4, *SEA_LEVEL, lat, lon, h)
    assert (h == h[0, 0]).all() or np.abs(h).max() < 0.5
    grid = geo_map.height_grid(lat, lon)
    assert grid is not None
    for u, v in [(10.0, 10.0), (160.0, 120.0), (300.0, 33.3)]:
        a, b, c = ground_point(lens, shot.r_CE_E, shot.dcm_CE, u, v, *grid)
        seen = world.pixels_of(shot, np.array([ecef_from_geodetic(a, b, c)]))[0]
        np.testing.assert_allclose(seen, [u, v], atol=1e-6)
        assert height_at(*grid, a, b) == pytest.approx(c, abs=0.5)
        i = np.interp(-np.degrees(a), -ground.lat_deg, np.arange(len(ground.lat_deg)))
        j = np.interp(np.degrees(b), ground.lon_deg, np.arange(len(ground.lon_deg)))
        assert ground.heights[round(i), round(j)] == pytest.approx(c, abs=60.0)


def test_heights_beyond_their_grid_are_unknown() -> None:
    heights = np.array([[0.0, 10.0], [20.0, 30.0]])
    assert height_at(heights, 0.5, 1.0, -0.1, 0.1, 0.45, 1.05) == pytest.approx(15.0)
    assert height_at(heights, 0.5, 1.0, -0.1, 0.1, 0.45, 1.05 + 2 * np.pi) == pytest.approx(15.0)
    assert np.isnan(height_at(heights, 0.5, 1.0, -0.1, 0.1, 0.7, 1.05))
    assert np.isnan(height_at(heights, 0.5, 1.0, -0.1, 0.1, np.nan, 1.05))


def test_spread_is_linear_and_keeps_unknowns() -> None:
    nodes = np.add.outer(10.0 * np.arange(4.0), np.arange(5.0))
    out = np.empty((12, 16))
    spread(nodes, 4, out)
    np.testing.assert_allclose(out, np.add.outer(2.5 * np.arange(12.0), 0.25 * np.arange(16.0)), atol=1e-12)
    nodes[1, 1] = np.nan
    spread(nodes, 4, out)
    assert np.isnan(out[1:8, 1:8]).all()
    assert np.isfinite(out[8:, 8:]).all()


def test_what_the_map_does_not_show_is_masked(tmp_path: Path) -> None:
    ground, shot = world.region(), world.looking_down((0.35, 0.0, 0.0))
    geo_map = GeoMap.open([world.write_map(tmp_path / "map.tif", ground.texture, ground)])
    view = render_view(geo_map, world.lens_of(shot), shot.shape, shot.r_CE_E, shot.dcm_CE)
    assert 0.1 < view.mask.mean() < 0.95
    assert not view.image[~view.mask].any()
    away = np.diag([1.0, -1.0, -1.0]) @ shot.dcm_CE
    with pytest.raises(MapError, match="covers nothing of the view"):
        render_view(geo_map, world.lens_of(shot), shot.shape, shot.r_CE_E, away)


def test_coarse_pixels_see_the_same_ground(tmp_path: Path) -> None:
    ground, shot = world.region(), world.looking_down()
    geo_map = GeoMap.open([world.write_map(tmp_path / "map.tif", ground.texture, ground)])
    lens = world.lens_of(shot)
    fine = render_view(geo_map, lens, shot.shape, shot.r_CE_E, shot.dcm_CE)
    small = render_view(geo_map, scaled_lens(lens, 4.0), (60, 80), shot.r_CE_E, shot.dcm_CE)
    # Pixel (a, b) of the small view is the middle of 4 x 4 fine ones
    at = np.array([[8.0, 20.0], [40.0, 28.0], [68.0, 48.0]])  # nodes of its grid, so exact
    np.testing.assert_allclose(small.ground(at), fine.ground(4.0 * at + 1.5), atol=5.0)  # chords of 7 km
    reduced = cv2.resize(fine.image, (80, 60), interpolation=cv2.INTER_AREA).astype(float)
    assert np.corrcoef(reduced.ravel(), small.image.ravel())[0, 1] > 0.95
    assert small.sharpness < 2.0


def test_a_pinhole_looks_through_its_middle() -> None:
    lens = pinhole(500.0, (101, 201))
    assert lens[2] == 100.0
    assert lens[3] == 50.0
