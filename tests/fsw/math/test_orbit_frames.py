"""Frames of an orbit against numpy's cross products and pyerfa."""

from __future__ import annotations

import erfa
import numpy as np
import pytest

from fsw.math.orbit_frames import OMEGA_EARTH, dcm_earth_teme, dcm_hill, dcm_orbit

R = np.array([6.7e6, -1.2e6, 0.4e6])
V = np.array([0.9e3, 5.1e3, 5.6e3])


def test_orbit_frame_is_nadir_minus_h_and_along_track() -> None:
    out = np.empty((3, 3))
    dcm_orbit(R, V, out)
    h, z = np.cross(R, V), -R / np.linalg.norm(R)
    y = -h / np.linalg.norm(h)
    np.testing.assert_allclose(out, [np.cross(y, z), y, z], atol=3e-16)
    assert out[0] @ V > 0.0


def test_hill_frame_is_radial_along_track_and_normal() -> None:
    out = np.empty((3, 3))
    dcm_hill(R, V, out)
    h = np.cross(R, V)
    radial, normal = R / np.linalg.norm(R), h / np.linalg.norm(h)
    np.testing.assert_allclose(out, [radial, np.cross(normal, radial), normal], atol=3e-16)


@pytest.mark.parametrize(("r", "v"), [(R, 2.0 * R), (R, np.zeros(3)), (np.zeros(3), V)])
def test_no_orbit_plane_gives_nan(r: np.ndarray, v: np.ndarray) -> None:
    out = np.zeros((3, 3))
    dcm_orbit(r, v, out)
    assert np.all(np.isnan(out))


def test_earth_fixed_from_teme_agrees_with_erfa() -> None:
    out = np.empty((3, 3))
    gmst, xp, yp = 3.3, 0.3, -0.2  # the poles are in arc seconds
    dcm_earth_teme(gmst, xp, yp, out)
    expected = erfa.pom00(xp * erfa.DAS2R, yp * erfa.DAS2R, 0.0) @ erfa.rz(gmst, np.eye(3))
    np.testing.assert_allclose(out, expected, atol=1e-15)


def test_rotation_rate_agrees_with_sidereal_time() -> None:
    turned = erfa.gmst82(2460069.5, 0.1 + 60.0 / 86400.0) - erfa.gmst82(2460069.5, 0.1)
    assert turned / 60.0 == pytest.approx(OMEGA_EARTH, rel=2e-7)  # precession of the equinox is 1e-7 of the rate
