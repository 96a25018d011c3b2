"""Field of view, ground samples and footprints against closed forms and differences; the mirror test."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw.math import camera, geodesy, view_geometry
from fsw.math.compiled import plain
from fsw.math.vectors import mat3, vec3
from messages.base import F64
from messages.opnav import CameraConfigMsg

CV: Any = cv2


def config(**changes: Any) -> CameraConfigMsg:
    given: dict[str, Any] = {"width_px": 1296, "height_px": 972, "focal_px": [1000.0, 1000.0]}
    given |= {"center_px": [647.5, 485.5], **changes}
    return CameraConfigMsg(**given)


def over(lat: float, lon: float, h: float) -> tuple[F64, F64]:
    """Position and attitude of a camera that looks down at a place, north up."""
    return np.array(geodesy.ecef_from_geodetic(lat, lon, h)), np.array(view_geometry.north_up(lat, lon))


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.85, 0.04), (-0.6, 2.6), (1.2, -3.1)])
def test_north_up_nadir_image(place: tuple[float, float]) -> None:
    """The mirror test: what lies east is on the right, what lies north is at the top, the vertical in the middle."""
    lat, lon = place
    r, dcm = over(lat, lon, 400e3)
    assert np.linalg.det(dcm) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(dcm @ dcm.T, np.eye(3), atol=1e-15)
    lens = camera.lens_vector(config())
    away = 1e-3  # rad, 6 km
    for north, east in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]:
        mark = np.array(geodesy.ecef_from_geodetic(lat + away * north, lon + away * east / math.cos(lat), 0.0))
        x, y, z = dcm @ (mark - r)
        u, v = camera.project_point(lens, x, y, z)
        step = 1000.0 * 6.4e6 * away / 400e3  # 16 px
        assert u - 647.5 == pytest.approx(east * step, abs=0.02 * step)
        assert v - 485.5 == pytest.approx(-north * step, abs=0.02 * step)


def test_north_up_has_the_axes_of_east_north_up() -> None:
    out = np.empty((3, 3))
    geodesy.enu_dcm(0.7, -2.1, out)
    dcm = np.array(view_geometry.north_up(0.7, -2.1))
    np.testing.assert_array_equal(dcm, [out[0], -out[1], -out[2]])


def test_field_of_view_of_a_pinhole() -> None:
    """2 atan(I / 2 f), and OpenCV's for the axes."""
    horizontal, vertical, diagonal = view_geometry.field_of_view(config())
    assert horizontal == pytest.approx(2.0 * math.atan(1296 / 2000.0), abs=1e-14)
    assert vertical == pytest.approx(2.0 * math.atan(972 / 2000.0), abs=1e-14)
    assert diagonal == pytest.approx(2.0 * math.atan(math.hypot(1296, 972) / 2000.0), abs=1e-14)
    k = np.array([[1000.0, 0.0, 648.0], [0.0, 1000.0, 486.0], [0.0, 0.0, 1.0]])  # of corners, not middles
    theirs = CV.calibrationMatrixValues(k, (1296, 972), 1.0, 1.0)
    assert np.degrees(horizontal) == pytest.approx(theirs[0], abs=1e-12)
    assert np.degrees(vertical) == pytest.approx(theirs[1], abs=1e-12)


def test_field_of_view_with_distortion() -> None:
    """The ends, found by OpenCV's iteration, span the angle; a barrel sees more than a pinhole."""
    barrel = config(distortion=np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]), center_px=np.array([640.0, 490.0]))
    k = np.array([[1000.0, 0.0, 640.0], [0.0, 1000.0, 490.0], [0.0, 0.0, 1.0]])
    ends = np.array([[-0.5, 485.5], [1295.5, 485.5], [647.5, -0.5], [647.5, 971.5], [-0.5, -0.5], [1295.5, 971.5]])
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-15)
    tangents = CV.undistortPoints(ends[:, None], k, barrel.distortion, R=np.eye(3), P=np.eye(3), criteria=criteria)[
        :, 0
    ]
    rays = np.column_stack([tangents, np.ones(6)])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    found = view_geometry.field_of_view(barrel)
    for i in range(3):
        assert found[i] == pytest.approx(math.acos(rays[2 * i] @ rays[2 * i + 1]), abs=1e-12)
    assert found[2] > view_geometry.field_of_view(config())[2]


def test_undistort_against_opencv() -> None:
    numbers = np.array([-0.2, 0.05, 1e-3, -1e-3, 0.01])
    lens = camera.lens_vector(config(distortion=numbers))
    k = np.array([[1000.0, 0.0, 647.5], [0.0, 1000.0, 485.5], [0.0, 0.0, 1.0]])
    pixels = np.random.default_rng(2).uniform([0, 0], [1296, 972], (200, 2))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-15)
    theirs = CV.undistortPoints(pixels[:, None], k, numbers, R=np.eye(3), P=np.eye(3), criteria=criteria)[:, 0]
    mine = np.empty((200, 2))
    camera.undistort(lens, pixels, mine)
    np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-12)


def test_lateral_chromatic_aberration() -> None:
    """Red larger, blue smaller by 0.1 %: half a pixel at 500 px from the principal point; k1 bends it on top."""
    fringed = config(chromatic=np.array([1.001, 1.0, 0.999]), chromatic_k1=np.array([0.0, 0.0, 0.01]), skew_px=2.0)
    point, center = (0.4, -0.3, 1.0), np.array([647.5, 485.5])
    lenses = [camera.channel_lens(fringed, c) for c in range(3)]
    seen = [np.array(camera.project_point(lens, *point)) - center for lens in lenses]
    np.testing.assert_array_equal(lenses[1], camera.lens_vector(fringed))
    np.testing.assert_allclose(seen[0], 1.001 * seen[1], rtol=1e-14)
    np.testing.assert_allclose(seen[2], 0.999 * (1.0 + 0.01 * 0.25) * seen[1], rtol=1e-13)
    assert lenses[2][camera.S_MAX] == camera.UNLIMITED
    x, y = camera.undistort_point(lenses[2], *(seen[2] + center).tolist())
    assert (x, y) == pytest.approx(point[:2], abs=1e-13)
    np.testing.assert_array_equal(camera.channel_lens(config(), 0), camera.channel_lens(config(), 2))


def ground(lens: F64, r: F64, dcm: F64, u: float, v: float) -> F64:
    d = np.asarray(plain(view_geometry.pixel_ray)(lens, u, v)) @ dcm
    lat, lon, _ = plain(geodesy.ray_to_height)(r[0], r[1], r[2], d[0], d[1], d[2], 0.0)
    return np.array(geodesy.ecef_from_geodetic(lat, lon, 0.0))


def sample(lens: F64, r: F64, dcm: F64, u: float, v: float, h: float = 0.0) -> tuple[float, float, float, float]:
    return view_geometry.ground_sample(lens, plain(vec3)(r), plain(mat3)(dcm), u, v, h)


@pytest.mark.parametrize("tilt_deg", [0.0, 10.0, 30.0, 55.0])
def test_ground_sample_closed_form(tilt_deg: float) -> None:
    """In the middle of the image: along p d / (f cos i), across p d / f; at nadir both are p h / f."""
    r, dcm = over(0.5, 1.0, 700e3)
    tilted = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix() @ dcm
    along, across, d, i = sample(camera.lens_vector(config()), r, tilted, 647.5, 485.5)
    assert along == pytest.approx(d / (1000.0 * math.cos(i)), rel=1e-12)
    assert across == pytest.approx(d / 1000.0, rel=1e-7 if tilt_deg == 0.0 else 1e-12)
    if tilt_deg == 0.0:
        assert d == pytest.approx(700e3, abs=1e-6) and i == pytest.approx(0.0, abs=1e-7)
    else:  # the incidence is larger than the tilt, by the law of sines on a sphere near enough
        assert math.sin(i) == pytest.approx(math.sin(math.radians(tilt_deg)) * (1 + 700e3 / 6.37e6), rel=5e-3)


def test_ground_sample_against_differences() -> None:
    """Anywhere in the image of a lens with distortion, skew and rectangular pixels: singular values of differences."""
    numbers = np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0])
    lens = camera.lens_vector(config(focal_px=np.array([1000.0, 900.0]), skew_px=3.0, distortion=numbers))
    r, dcm = over(-0.9, 2.0, 700e3)
    dcm = Rotation.from_euler("xyz", [12.0, -10.0, 70.0], degrees=True).as_matrix() @ dcm
    for u, v in [(100.0, 100.0), (1200.0, 900.0), (647.5, 485.5), (30.0, 800.0)]:
        du = ground(lens, r, dcm, u + 0.5, v) - ground(lens, r, dcm, u - 0.5, v)
        dv = ground(lens, r, dcm, u, v + 0.5) - ground(lens, r, dcm, u, v - 0.5)
        expected = np.linalg.svd(np.column_stack([du, dv]), compute_uv=False)
        along, across, d, _ = sample(lens, r, dcm, u, v)
        np.testing.assert_allclose([along, across], expected, rtol=3e-6)
        assert d == pytest.approx(np.linalg.norm(ground(lens, r, dcm, u, v) - r), rel=1e-12)


def test_ground_sample_past_the_limb() -> None:
    r, dcm = over(0.0, 0.0, 700e3)
    assert np.isnan(sample(camera.lens_vector(config()), r, -dcm, 647.5, 485.5)).all()


def test_footprint() -> None:
    """Around the place below, clockwise from the top left on the map; its corners project to the image's corners."""
    r, dcm = over(0.8, 0.1, 400e3)
    lens = camera.lens_vector(config())
    corners = view_geometry.footprint(config(), r, dcm, per_edge=1)
    assert corners.shape == (4, 2)
    lat, lon = corners.T
    assert lat[0] > 0.8 > lat[2] and lon[0] < 0.1 < lon[1] and lat[1] > 0.8 > lat[3] and lon[3] < 0.1 < lon[2]
    wanted = [(-0.5, -0.5), (1295.5, -0.5), (1295.5, 971.5), (-0.5, 971.5)]
    for (la, lo), pixel in zip(corners.tolist(), wanted, strict=True):
        x, y, z = dcm @ (np.array(geodesy.ecef_from_geodetic(la, lo, 0.0)) - r)
        assert camera.project_point(lens, x, y, z) == pytest.approx(pixel, abs=1e-8)
    polygon = view_geometry.footprint(config(), r, dcm, per_edge=5)
    np.testing.assert_array_equal(polygon[::5], corners)
    high = view_geometry.footprint(config(), r, dcm, per_edge=1, h=200e3)
    assert np.ptp(high[:, 0]) == pytest.approx(np.ptp(lat) / 2.0, rel=0.1)


def test_footprint_past_the_limb_and_bad_counts() -> None:
    r, dcm = over(0.0, 0.0, 700e3)
    tilted = Rotation.from_euler("x", -60.0, degrees=True).as_matrix() @ dcm
    corners = view_geometry.footprint(config(), r, tilted, per_edge=1)
    assert np.isnan(corners).all(axis=1).sum() == 2 and np.isfinite(corners).all(axis=1).sum() == 2
    with pytest.raises(ValueError, match="per_edge: expected at least 1"):
        view_geometry.footprint(config(), r, dcm, per_edge=0)
