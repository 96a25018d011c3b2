"""The camera against OpenCV, mpmath, and its own inverse."""

from __future__ import annotations

from typing import Any

import cv2
import mpmath
import numpy as np
import pytest

from fsw.math import camera
from messages.base import F64
from messages.opnav import CameraConfigMsg

CV: Any = cv2
MPMATH: Any = mpmath
CASES = {
    "station": [1030.5, 1031.0, 636.0, 474.0, 0.0, 0.032, -0.026, 0.0016, 0.0022, 0.0],
    "pinhole": [900.0, 900.0, 500.0, 400.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "barrel": [800.0, 790.0, 640.0, 480.0, 0.0, -0.28, 0.07, -0.0003, 0.0005, -0.008],
    "skewed": [800.0, 790.0, 640.0, 480.0, 1.7, -0.1, 0.02, 0.001, -0.001, 0.003],
}


def lens_of(numbers: list[float]) -> F64:
    message = CameraConfigMsg(
        width_px=1296,
        height_px=972,
        focal_px=np.array(numbers[:2]),
        center_px=np.array(numbers[2:4]),
        skew_px=numbers[4],
        distortion=np.array(numbers[5:]),
    )
    return camera.lens_vector(message)


def points(n: int = 400) -> F64:
    rng = np.random.default_rng(4)
    p = rng.uniform(-0.6, 0.6, (n, 3))
    p[:, 2] = rng.uniform(1.0, 5e5, n)
    p[:, :2] *= p[:, 2:]
    return p


def projected(lens: F64, p: F64) -> F64:
    out = np.empty((len(p), 2))
    camera.project(lens, p, out)
    return out


@pytest.mark.parametrize("name", ["station", "pinhole", "barrel"])
def test_projects_as_opencv(name: str) -> None:
    lens, p = lens_of(CASES[name]), points()
    k = np.array([[lens[0], 0.0, lens[2]], [0.0, lens[1], lens[3]], [0.0, 0.0, 1.0]])
    reference, slopes = CV.projectPoints(p, np.zeros(3), np.zeros(3), k, lens[5:10])
    np.testing.assert_allclose(projected(lens, p), reference[:, 0], rtol=0.0, atol=1e-12 * 1296)
    d_point, d_lens = np.empty((2, 3)), np.empty((2, 10))
    for i in range(50):
        camera.project_derivatives(lens, p[i, 0], p[i, 1], p[i, 2], d_point, d_lens)
        theirs = slopes[2 * i : 2 * i + 2]  # by rotation, translation, focal, centre, distortion
        np.testing.assert_allclose(d_point, theirs[:, 3:6], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(d_lens[:, :4], theirs[:, 6:10], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(d_lens[:, 5:], theirs[:, 10:15], rtol=1e-12, atol=1e-12)


def exact(numbers: list[Any], x: Any, y: Any, z: Any) -> tuple[Any, Any]:
    """The model written out again, for any number type."""
    fx, fy, cx, cy, skew, k1, k2, p1, p2, k3 = numbers
    a, b = x / z, y / z
    s = a**2 + b**2
    radial = 1 + k1 * s + k2 * s**2 + k3 * s**3
    xd = a * radial + 2 * p1 * a * b + p2 * (s + 2 * a**2)
    yd = b * radial + p1 * (s + 2 * b**2) + 2 * p2 * a * b
    return fx * xd + skew * yd + cx, fy * yd + cy


def exact_slope(arguments: list[Any], row: int, column: int) -> float:
    """Derivative of a coordinate of the pixel by one argument."""

    def along(t: Any) -> Any:
        shifted = [a + (t if k == column else 0) for k, a in enumerate(arguments)]
        return exact(shifted[:10], *shifted[10:])[row]

    return float(MPMATH.diff(along, 0))


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_mpmath(name: str) -> None:
    lens = lens_of(CASES[name])
    d_point, d_lens = np.empty((2, 3)), np.empty((2, 10))
    with MPMATH.workdps(40):
        for at in ([0.3, -0.4, 1.1], [-0.5, 0.2, 1.3]):
            arguments = [MPMATH.mpf(float(v)) for v in [*lens[:10], *at]]
            u, v = camera.project_derivatives(lens, at[0], at[1], at[2], d_point, d_lens)
            wanted = exact(arguments[:10], *arguments[10:])
            assert abs(u - wanted[0]) < 1e-12 * 1296
            assert abs(v - wanted[1]) < 1e-12 * 1296
            for row in range(2):
                for column in range(13):
                    slope = exact_slope(arguments, row, column)
                    mine = d_lens[row, column] if column < 10 else d_point[row, column - 10]
                    assert mine == pytest.approx(slope, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_undistort_is_the_inverse(name: str) -> None:
    lens, p = lens_of(CASES[name]), points()
    pixel = projected(lens, p)
    tangents, ones = np.empty_like(pixel), np.ones((len(p), 1))
    camera.undistort(lens, pixel, tangents)
    np.testing.assert_allclose(tangents, p[:, :2] / p[:, 2:], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(projected(lens, np.hstack([tangents, ones])), pixel, rtol=0.0, atol=1e-10)


def test_limit_is_where_the_radius_turns() -> None:
    for numbers in CASES.values():
        k1, k2, k3 = numbers[5], numbers[6], numbers[9]
        s = np.linspace(1e-6, 20.0, 2_000_001)
        r = np.sqrt(s) * (1.0 + s * (k1 + s * (k2 + s * k3)))
        turns = np.flatnonzero(np.diff(r) <= 0.0)
        limit = camera.monotonic_limit(k1, k2, k3)
        if len(turns):
            assert limit == pytest.approx(s[turns[0]], abs=2e-5)
        else:
            assert limit > 20.0


def test_points_that_the_lens_cannot_see_are_refused() -> None:
    lens = lens_of(CASES["station"])
    wide = 1.01 * float(np.sqrt(lens[camera.S_MAX]))
    bad = np.array([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0], [wide, 0.0, 1.0], [np.nan, 0.0, 1.0]])
    assert np.isnan(projected(lens, bad)).all()
    d_point, d_lens = np.zeros((2, 3)), np.zeros((2, 10))
    assert np.isnan(camera.project_derivatives(lens, 0.1, 0.1, -1.0, d_point, d_lens)).all()
    assert not d_point.any()
    tangents = np.empty((2, 2))
    camera.undistort(lens, np.array([[1e5, 1e5], [np.nan, 3.0]]), tangents)
    assert np.isnan(tangents).all()
