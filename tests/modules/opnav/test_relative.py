"""What the modules of disk navigation share: table of bodies, lens of a row, attitude at an exposure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fsw.math.bodies import bodies
from fsw.math.camera import UNLIMITED, lens_vector, monotonic_limit
from modules.opnav import relative
from modules.opnav.basilisk import basilisk_radii, camera_of
from modules.opnav.horizon_nav import HorizonNav
from tests.modules.opnav.disk_truth import camera, sources


def test_limit_of_a_lens_by_roots() -> None:
    """Smallest positive root of 1 + a s + b s^2 + c s^3 against numpy's roots, over signs and sizes."""
    rng = np.random.default_rng(1)
    for _ in range(2000):
        k1, k2, k3 = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 1, 3) * rng.integers(0, 2, 3)
        expected = monotonic_limit(k1, k2, k3)
        found = relative.first_root(3.0 * k1, 5.0 * k2, 7.0 * k3)
        if expected < 0.99 * UNLIMITED:
            assert abs(found / expected - 1.0) < 1e-6
        else:
            assert found == UNLIMITED


def test_lens_of_a_row() -> None:
    cam, lens = camera(800.0, distortion=(-0.3, 0.02, 1e-3, -5e-4, 0.1)), np.zeros(11)
    camera_port = sources(HorizonNav("nav"))["in_camera"]
    camera_port.write(cam, 0)
    relative.lens_of(camera_port.row.view(np.recarray)[0], lens)
    np.testing.assert_allclose(lens, lens_vector(cam), rtol=1e-12)


def test_bodies() -> None:
    """Every body of the table has axes near its radius; unknown ones have none; given axes go first."""
    for b in bodies():
        a, _, c = relative.semi_axes(b.naif, (0.0, 0.0, 0.0))
        assert c <= a * (1.0 + 1e-12)
        if b.naif not in (2000433, 402, 401):  # very long or small: the table's radius is a mean
            assert abs(a / b.radius - 1.0) < 0.02
            assert abs(c / b.radius - 1.0) < 0.21
    assert all(math.isnan(x) for x in relative.semi_axes(12345, (0.0, 0.0, 0.0)))
    assert relative.semi_axes(12345, (3.0, 2.0, 1.0)) == (3.0, 2.0, 1.0)
    assert math.isnan(basilisk_radii(301)[0])


def test_pole_frame_is_a_rotation() -> None:
    for pole in ([0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [0.3, -0.5, 0.7], [0.0, -1.0, 0.0], [0.0, 0.1, -3.0]):
        m = np.array(relative.pole_frame((pole[0], pole[1], pole[2])))
        np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(m) > 0.0
        np.testing.assert_allclose(m[2], np.array(pole) / np.linalg.norm(pole), atol=1e-15)


def test_solve_refuses_what_is_not_positive_definite() -> None:
    rng, x = np.random.default_rng(2), np.zeros(3)
    for _ in range(200):
        root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-4, 4, 3)[:, None]
        A, b = root @ root.T, rng.normal(size=3)
        assert relative.solve_spd(A, b, x)
        np.testing.assert_allclose(A @ x, b, atol=1e-9 * np.max(np.abs(A)) * np.max(np.abs(x)))
    assert not relative.solve_spd(np.ones((3, 3)), np.ones(3), x)
    assert not relative.solve_spd(np.diag([1.0, -1.0, 1.0]), np.ones(3), x)
    assert not relative.solve_spd(np.full((3, 3), np.nan), np.ones(3), x)


def test_field_of_view_that_is_no_camera() -> None:
    with pytest.raises(ValueError, match="focal_px"):
        camera_of(2.0, 2000, 1000, (0.0, 0.0, 0.0))
