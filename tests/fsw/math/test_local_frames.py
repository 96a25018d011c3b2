"""Frames of an orbit and their rates against Basilisk's vectors and differences along Kepler orbits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw.math import local_frames as lf
from fsw.math.kepler import elements_to_rv, mean_motion, mean_to_true
from fsw.math.vectors import V3
from messages.base import F64

DATA: dict[str, Any] = json.loads((Path(__file__).parents[2] / "data" / "basilisk_orbital_motion.json").read_text())
MU = 3.986004415e14
ELLIPSE = (8.2e6, 0.2, 1.1, 0.7, 2.2)


def v3(x: Any) -> V3:
    return (float(x[0]), float(x[1]), float(x[2]))


def state(t: float) -> tuple[V3, V3]:
    a, e, i, node, peri = ELLIPSE
    return elements_to_rv((a, e, i, node, peri, mean_to_true(0.6 + mean_motion(a, e, MU) * t, e)), MU)


def rate_of(frame: Any, t: float) -> F64:
    """Angular velocity, in the frame's components, by central differences."""
    step = 0.5
    dcm = np.array(frame(*state(t)))
    slope = (np.array(frame(*state(t + step))) - np.array(frame(*state(t - step)))) / (2.0 * step)
    w = -slope @ dcm.T
    return np.array([w[2, 1], w[0, 2], w[1, 0]])


@pytest.mark.parametrize("case", DATA["hill"])
def test_hill_frame_against_basilisk(case: dict[str, Any]) -> None:
    chief = v3(case["rc_N"]), v3(case["vc_N"])
    np.testing.assert_allclose(lf.hill_frame(*chief), case["dcm_HN"], rtol=0, atol=1e-15)
    rho, rho_dot = lf.to_hill(*chief, v3(case["rd_N"]), v3(case["vd_N"]))
    # differences of positions of 3e7 m carry their last bit, 4e-9 m
    np.testing.assert_allclose(rho, case["rho_H"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(rho_dot, case["rhoPrime_H"], rtol=0, atol=4e-12)
    r, v = lf.from_hill(*chief, v3(case["rho_H"]), v3(case["rhoPrime_H"]))
    np.testing.assert_allclose(r, case["rd_back"], rtol=1e-15, atol=1e-8)
    np.testing.assert_allclose(v, case["vd_back"], rtol=1e-15, atol=1e-12)


def test_orbit_frame_flies_forward_and_looks_down() -> None:
    r, v = state(100.0)
    dcm = np.array(lf.orbit_frame(r, v))
    assert dcm[0] @ v > 0.9 * np.linalg.norm(v)
    np.testing.assert_allclose(dcm[2], -np.array(r) / np.linalg.norm(r), atol=2e-16)
    np.testing.assert_allclose(dcm @ dcm.T, np.eye(3), atol=4e-16)
    assert np.linalg.det(dcm) > 0.0
    np.testing.assert_allclose(dcm[1] @ np.cross(r, v), -np.linalg.norm(np.cross(r, v)), rtol=1e-15)


@pytest.mark.parametrize("t", [0.0, 1500.0, 5000.0])
def test_rates_against_differences(t: float) -> None:
    r, v = state(t)
    np.testing.assert_allclose(lf.orbit_rate(r, v), rate_of(lf.orbit_frame, t), rtol=0, atol=2e-10)
    np.testing.assert_allclose(lf.hill_rate(r, v, (0.0, 0.0, 0.0)), rate_of(lf.hill_frame, t), rtol=0, atol=2e-10)
    step = 0.5
    slope = (np.array(lf.orbit_rate(*state(t + step))) - np.array(lf.orbit_rate(*state(t - step)))) / (2.0 * step)
    np.testing.assert_allclose(lf.orbit_rate_derivative(r, v), slope, rtol=0, atol=1e-12)
    size = float(np.linalg.norm(np.cross(r, v)) / np.dot(r, r))
    assert lf.orbit_rate(r, v) == (0.0, pytest.approx(-size, rel=1e-15), 0.0)


def test_a_push_along_the_normal_turns_the_hill_frame() -> None:
    """Differences along a parabola of time: position, velocity and acceleration as given."""
    r, v = (np.array(x) for x in state(300.0))
    push = np.array([0.4, -0.2, 0.7]) - MU * r / np.linalg.norm(r) ** 3
    dcm, step = np.array(lf.hill_frame(v3(r), v3(v))), 1e-2

    def frame(t: float) -> F64:
        return np.array(lf.hill_frame(v3(r + v * t + 0.5 * push * t * t), v3(v + push * t)))

    w = -(frame(step) - frame(-step)) / (2.0 * step) @ dcm.T
    rate = lf.hill_rate(v3(r), v3(v), v3(push))
    np.testing.assert_allclose(rate, [w[2, 1], w[0, 2], w[1, 0]], rtol=0, atol=1e-12)
    assert abs(rate[0]) > 1e-5


@pytest.mark.parametrize(("r", "v"), [((7e6, 0.0, 0.0), (1e3, 0.0, 0.0)), ((7e6, 0.0, 0.0), (0.0, 0.0, 0.0))])
def test_no_plane_gives_nan(r: V3, v: V3) -> None:
    assert np.isnan(lf.hill_frame(r, v)).all()
    assert np.isnan(lf.orbit_frame(r, v)).all()
    assert np.isnan(lf.hill_rate(r, v, (0.0, 0.0, 1.0))).all()
    assert np.isnan(lf.to_hill(r, v, (7e6, 1.0, 0.0), v)).all()
