"""TRIAD against scipy's rotations, against the covariance of Shuster and Oh, and its refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw.math.compiled import plain
from fsw.math.triad import dcm_from_directions, sun_direction, triad

TRIAD, SUN = plain(triad), plain(sun_direction)
BOX = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def test_exact_directions_give_the_rotation() -> None:
    rng = np.random.default_rng(4)
    for turn in Rotation.random(200, rng=rng):
        a, b = rng.normal(size=(2, 3)) * 10.0 ** rng.uniform(-6, 6, (2, 1))
        dcm = turn.as_matrix()
        got = np.array(TRIAD(tuple(dcm @ a), tuple(dcm @ b), tuple(a), tuple(b)))
        np.testing.assert_allclose(got, dcm, rtol=0, atol=2e-14)
        np.testing.assert_allclose(got @ got.T, np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(dcm_from_directions([0, 0, 2], [1, 0, 0], [1, 0, 0], [0, 0, -1]) @ [1, 0, 0], [0, 0, 1])


@pytest.mark.parametrize("angle_deg", [90.0, 50.0])
@pytest.mark.parametrize(("anchor", "other"), [(3.0, 1.0), (1.0, 3.0)])
def test_errors_are_those_of_shuster_and_oh(angle_deg: float, anchor: float, other: float) -> None:
    """At right angles with 3 and 1 degrees: 4.36 in all with the worse one as the anchor, 3.32 the other way."""
    rng, theta, unit = np.random.default_rng(5), math.radians(angle_deg), 1e-3
    a_N, o_N = np.array([1.0, 0.0, 0.0]), np.array([math.cos(theta), math.sin(theta), 0.0])
    turns: list[Any] = []
    for noise in rng.normal(size=(6000, 2, 3)) * unit * np.array([[anchor], [other]]):
        a_B, o_B = a_N + np.cross(a_N, noise[0]), o_N + np.cross(o_N, noise[1])
        turns.append(TRIAD(tuple(a_B), tuple(o_B), tuple(a_N), tuple(o_N)))
    found = np.sqrt(np.mean((Rotation.from_matrix(turns).as_rotvec() / unit) ** 2, axis=0))
    about = math.sqrt(other**2 + (anchor * math.cos(theta)) ** 2) / math.sin(theta)
    np.testing.assert_allclose(found, [about, anchor, anchor], rtol=0.04)
    if angle_deg == 90.0:
        assert np.linalg.norm(found) == pytest.approx(4.36 if anchor > other else 3.32, rel=0.03)


def test_parallel_directions_have_no_attitude() -> None:
    x, near, y = (1.0, 0.0, 0.0), (-1.0, 1e-4, 0.0), (0.0, 1.0, 0.0)
    for pair in (x, near, (0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)):
        assert np.all(np.isnan(TRIAD(x, pair, x, y))) and np.all(np.isnan(TRIAD(x, y, x, pair)))
    with pytest.raises(ValueError, match="anchor_N, other_N: expected two directions at an angle, got parallel"):
        dcm_from_directions(x, y, x, near)
    with pytest.raises(ValueError, match="anchor_B, other_B: expected two directions at an angle"):
        dcm_from_directions(x, x, x, y)
    for bad in ((0.0, 0.0, 0.0), (1.0, 2.0), (math.nan, 0.0, 1.0)):
        with pytest.raises(ValueError, match="other_B: expected three finite numbers"):
            dcm_from_directions(x, bad, x, y)


def test_sun_from_the_cells_of_a_box() -> None:
    for sun in Rotation.random(50, rng=np.random.default_rng(6)).apply([1.0, 0.0, 0.0]):
        np.testing.assert_allclose(SUN(np.maximum(0.0, 0.97 * BOX @ sun), BOX, 0.3), sun, rtol=0, atol=1e-15)
    dark = np.array([0.02, 0.0, 0.03, 0.0, 0.0, 0.01])
    assert np.all(np.isnan(SUN(dark, BOX, 0.3))) and np.all(np.isnan(SUN(dark * math.nan, BOX, 0.3)))
