"""Limbs of ellipsoids against closed forms, rays by brute force, and the quadratic form of the tangent cone."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from fsw.math import camera, ellipsoid
from messages.base import F64

MPMATH: Any = mpmath
MARS = 3396190.0
AUDIT_F = 256.0 / math.tan(math.radians(27.5))
"""512 px and 55 degrees."""


def pinhole(fx: float = 800.0, fy: float = 780.0, skew: float = 1.3) -> F64:
    lens = np.zeros(11)
    lens[:5], lens[10] = [fx, fy, 255.5, 240.0, skew], camera.UNLIMITED
    return lens


def turned(seed: int) -> F64:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


def off_axis(r: float, theta: float, towards: float = 0.0) -> F64:
    return r * np.array([math.sin(theta) * math.cos(towards), math.sin(theta) * math.sin(towards), math.cos(theta)])


@pytest.mark.parametrize("theta_deg", [0.0, 5.0, 20.0, 40.0])
@pytest.mark.parametrize("distance", [5e6, 18e6, 1e9, 1e12])
def test_sphere_to_ellipse(theta_deg: float, distance: float) -> None:
    """The cone of a sphere cut by the image plane: extremes f tan(theta +- rho), known in closed form."""
    f, theta, rho = 1000.0, math.radians(theta_deg), math.asin(MARS / distance)
    lens = pinhole(f, f, 0.0)
    r = off_axis(distance, theta, 0.7)
    found = ellipsoid.ellipsoid_in_image(lens, np.full(3, MARS), turned(1), r)
    with MPMATH.workdps(40):
        t, p = MPMATH.mpf(theta), MPMATH.asin(MPMATH.mpf(MARS) / MPMATH.mpf(distance))
        high, low = f * MPMATH.tan(t + p), f * MPMATH.tan(t - p)
        middle, major = (high + low) / 2, (high - low) / 2
        minor = f * MPMATH.sin(p) / MPMATH.sqrt(MPMATH.cos(t) ** 2 - MPMATH.sin(p) ** 2)
        offset = middle - f * MPMATH.tan(t)
        middle, major, minor, offset = (float(x) for x in (middle, major, minor, offset))
    towards = np.array([math.cos(0.7), math.sin(0.7)])
    np.testing.assert_allclose(found.center_px - [255.5, 240.0], middle * towards, rtol=1e-12, atol=1e-10)
    assert found.semi_major_px == pytest.approx(major, rel=1e-12)
    assert found.semi_minor_px == pytest.approx(minor, rel=1e-12)
    assert found.area_px == pytest.approx(math.pi * major * minor, rel=1e-12)
    if theta > 0.0:
        assert ellipsoid.sphere_center_offset(f, theta, rho) == pytest.approx(offset, rel=1e-12, abs=1e-12)
        if distance < 1e9:
            assert found.angle == pytest.approx(0.7, abs=1e-9)


@pytest.mark.parametrize(
    ("distance", "theta_deg", "offset_px"),
    [(18e6, 5, 1.6), (18e6, 10, 3.3), (18e6, 20, 7.5), (10e6, 5, 5.7), (10e6, 10, 11.7), (10e6, 20, 26.9)],
)
def test_centre_offsets_of_the_audit(distance: float, theta_deg: float, offset_px: float) -> None:
    """Mars in a camera with 512 px and 55 degrees; figures with one decimal."""
    lens = pinhole(AUDIT_F, AUDIT_F, 0.0)
    r = off_axis(distance, math.radians(theta_deg))
    center = ellipsoid.ellipsoid_in_image(lens, np.full(3, MARS), np.eye(3), r).center_px
    body = np.array(camera.project_point(lens, r[0], r[1], r[2]))
    assert np.linalg.norm(center - body) == pytest.approx(offset_px, abs=0.051)
    assert center[0] > body[0] > 255.5  # outward
    rho = math.asin(MARS / distance)
    assert ellipsoid.sphere_center_offset(AUDIT_F, math.radians(theta_deg), rho) == pytest.approx(offset_px, abs=0.051)


CASES = {
    "sphere": (np.full(3, MARS), 18e6),
    "spheroid": (np.array([6378137.0, 6378137.0, 6356752.3]), 20e6),
    "triaxial": (np.array([17e3, 11e3, 9e3]), 60e3),
    "close": (np.array([17e3, 11e3, 9e3]), 21e3),
}


@pytest.mark.parametrize("name", CASES)
def test_limb_points_touch_the_body_and_lie_on_the_ellipse(name: str) -> None:
    """Points of the limb: on the surface, the ray tangent to it, and on the conic of the image."""
    axes, distance = CASES[name]
    lens = pinhole()
    for seed in range(5):
        dcm = turned(seed)
        r = off_axis(distance, 0.1 if name == "close" else 0.4, float(seed))
        points = np.empty((90, 3))
        ellipsoid.limb_points(axes, dcm, r, points)
        fixed = (points - r) @ dcm  # relative to the centre, body-fixed
        np.testing.assert_allclose(((fixed / axes) ** 2).sum(1), 1.0, rtol=0.0, atol=1e-12)
        normal = fixed / axes**2
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        ray = points @ dcm
        assert np.abs((normal * ray).sum(1) / np.linalg.norm(ray, axis=1)).max() < 1e-12
        found = ellipsoid.ellipsoid_in_image(lens, axes, dcm, r)
        if not np.isfinite(found.area_px):
            assert name == "close"
            continue
        pixels = ellipsoid.limb_pixels(lens, axes, dcm, r, 90)
        homogeneous = np.column_stack([pixels, np.ones(90)])
        value = np.einsum("ni,ij,nj->n", homogeneous, found.conic, homogeneous)
        # the value changes by 2 for a change of one semi-axis: this is 1e-11 of it
        scale = max(1.0, float(np.abs(found.conic[2, 2])))
        assert np.abs(value).max() < 2e-12 * scale
        # symmetric about the centre, and as far from it as the semi-axes say
        away = np.linalg.norm(pixels - found.center_px, axis=1)
        assert found.semi_minor_px <= away.min() * (1.0 + 1e-10) and away.max() <= found.semi_major_px * (1.0 + 1e-10)


def test_axes_and_angle_against_the_extremes_of_dense_points() -> None:
    axes, distance = CASES["triaxial"]
    lens, dcm, r = pinhole(), turned(8), off_axis(distance, 0.3, 2.0)
    found = ellipsoid.ellipsoid_in_image(lens, axes, dcm, r)
    pixels = ellipsoid.limb_pixels(lens, axes, dcm, r, 40_000) - found.center_px
    away = np.linalg.norm(pixels, axis=1)
    assert found.semi_major_px == pytest.approx(away.max(), rel=1e-7)
    assert found.semi_minor_px == pytest.approx(away.min(), rel=1e-7)
    far = pixels[np.argmax(away)]
    apart = math.remainder(math.atan2(far[1], far[0]) - found.angle, math.pi)
    assert abs(apart) < 1e-3
    x, y = pixels[:, 0], pixels[:, 1]
    assert found.area_px == pytest.approx(0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))), rel=1e-7)


@pytest.mark.parametrize("name", ["sphere", "spheroid", "triaxial"])
def test_limb_is_where_rays_begin_to_miss(name: str) -> None:
    """On a line through the middle of the image of the body, the miss distance of rays is that of the surface."""
    axes, distance = CASES[name]
    lens, dcm, r = pinhole(), turned(3), off_axis(distance, 0.2, 1.0)
    start = -dcm.T @ r
    conic = ellipsoid.ellipsoid_in_image(lens, axes, dcm, r).conic
    for pixel in ellipsoid.limb_pixels(lens, axes, dcm, r, 12):
        center = ellipsoid.ellipsoid_in_image(lens, axes, dcm, r).center_px
        for scale, hit in [(1.0 - 1e-6, True), (1.0 + 1e-6, False)]:
            u, v = center + scale * (pixel - center)
            x, y = camera.undistort_point(lens, float(u), float(v))
            d = dcm.T @ np.array([x, y, 1.0])
            d /= np.linalg.norm(d)
            met = ellipsoid.ray_to_ellipsoid(tuple(start.tolist()), tuple(d.tolist()), tuple(axes.tolist()))
            assert math.isfinite(met) == hit
            place = np.array([u, v, 1.0])
            assert (place @ conic @ place < 0.0) == hit


def test_ray_to_ellipsoid_is_the_first_crossing() -> None:
    rng, axes = np.random.default_rng(4), np.array([17e3, 11e3, 9e3])
    triple: Any = tuple(axes.tolist())
    for _ in range(200):
        start = rng.normal(size=3) * 1e5
        if ((start / axes) ** 2).sum() < 1.1:
            continue
        target = rng.normal(size=3) * 9e3
        d = target - start
        d /= np.linalg.norm(d)

        def level(t: float, start: F64 = start, d: F64 = d) -> float:
            return float((((start + t * d) / axes) ** 2).sum())

        lowest: Any = minimize_scalar(level, bracket=(0.0, np.linalg.norm(start)), tol=1e-12)
        met = ellipsoid.ray_to_ellipsoid(tuple(start.tolist()), tuple(d.tolist()), triple)
        if lowest.fun > 1.0 + 1e-9:
            assert math.isnan(met)
        elif lowest.fun < 1.0 - 1e-9:
            assert level(met) == pytest.approx(1.0, abs=1e-11) and met < lowest.x
            assert math.isnan(ellipsoid.ray_to_ellipsoid(tuple(start.tolist()), tuple((-d).tolist()), triple))
    assert math.isnan(ellipsoid.ray_to_ellipsoid((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), triple))


def test_distorted_limb_points_are_those_of_the_lens() -> None:
    lens = pinhole()
    lens[5:8] = [-0.1, 0.02, 1e-3]
    axes, distance = CASES["triaxial"]
    dcm, r = turned(3), off_axis(distance, 0.2, 1.0)
    pixels = ellipsoid.limb_pixels(lens, axes, dcm, r, 20)
    tangents = np.array([camera.undistort_point(lens, float(u), float(v)) for u, v in pixels])
    straight = pinhole()
    np.testing.assert_allclose(
        tangents * straight[:2] + np.outer(tangents[:, 1], [1.3, 0.0]) + straight[2:4],
        ellipsoid.limb_pixels(straight, axes, dcm, r, 20),
        rtol=0.0,
        atol=1e-10,
    )


@pytest.mark.parametrize(
    "r",
    [[0.0, 0.0, 5e3], [0.0, 0.0, -60e3], [60e3, 0.0, 1e3], [60e3, 0.0, -5e3], [np.nan, 0.0, 60e3]],
    ids=["inside", "behind", "beside", "beside and behind", "nan"],
)
def test_no_ellipse(r: list[float]) -> None:
    axes, _ = CASES["triaxial"]
    found = ellipsoid.ellipsoid_in_image(pinhole(), axes, np.eye(3), np.array(r))
    numbers = [*found.center_px, found.semi_major_px, found.semi_minor_px, found.angle, found.area_px]
    assert np.isnan(numbers).all() and np.isnan(found.conic).all()
    points = np.empty((4, 3))
    ellipsoid.limb_points(axes, np.eye(3), np.array(r), points)
    assert np.isnan(points).all() == (r[0] != 60e3 and r[2] != -60e3)
