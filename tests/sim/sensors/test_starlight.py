"""Aberration against a Lorentz transformation, and what blinds a star sensor against plain geometry."""

from __future__ import annotations

from typing import Any

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages.base import F64
from sim.sensors.star_tracker import StarTracker
from sim.sensors.starlight import C_LIGHT, aberrated
from tests.sim.sensors.sensor_rig import AU, Criterion, measure

ERFA: Any = erfa

QUIET: dict[str, Any] = {"sigma_cross": 0.0, "sigma_roll": 0.0}


def boosted(u: F64, beta: F64) -> F64:
    """Direction to a star for a moving observer: its photon's momentum -u, boosted by the 4 x 4 matrix."""
    b2 = beta @ beta
    gamma = 1.0 / np.sqrt(1.0 - b2)
    matrix = np.eye(4)
    matrix[0, 0] = gamma
    matrix[0, 1:] = matrix[1:, 0] = -gamma * beta
    matrix[1:, 1:] += (gamma - 1.0) * np.outer(beta, beta) / b2
    seen = matrix @ np.concatenate([[1.0], -u])
    return -seen[1:] / seen[0]


def test_aberration_against_lorentz() -> None:
    """For 30 km/s to rounding, and for half the speed of light."""
    rng = np.random.default_rng(1)
    for speed in (1e-4, 0.5):
        for _ in range(50):
            u, beta = rng.normal(size=3), rng.normal(size=3)
            u, beta = u / np.linalg.norm(u), speed * beta / np.linalg.norm(beta)
            seen = np.array(aberrated(tuple(u.tolist()), tuple(beta.tolist())))
            np.testing.assert_allclose(seen, boosted(u, beta), atol=4e-16)


def test_aberration_against_erfa(criterion: Criterion) -> None:
    """Without the bending of light by the Sun, which ERFA has in the same function: the Sun is put very far away."""
    rng, worst = np.random.default_rng(3), 0.0
    for _ in range(200):
        u, beta = rng.normal(size=3), rng.normal(size=3) * 1e-4
        u /= np.linalg.norm(u)
        seen = np.array(aberrated(tuple(u.tolist()), tuple(beta.tolist())))
        expected = ERFA.ab(u, beta, 1e30, np.sqrt(1.0 - beta @ beta))
        worst = max(worst, float(np.max(np.abs(seen - expected))))
    criterion("STAR-4", worst)


def exposed(angle: float, where: str, exclusion: float) -> bool:
    """Whether a tracker sees stars with its boresight (z) at an angle from a body of the sky, all else far away."""
    other: dict[str, Any] = {
        "sun": np.array([0.0, AU, 0.0]),
        "moon": np.array([0.0, 3.8e8, 0.0]),
        "r_BN_N": np.array([0.0, -7e6, 0.0]),
    }
    towards = np.array([np.sin(angle), 0.0, np.cos(angle)])
    if where == "limb":
        other["r_BN_N"] = -7e6 * towards
    else:
        other[where] = other["r_BN_N"] + (AU if where == "sun" else 3.8e8) * towards
    chosen: dict[str, Any] = {**QUIET, f"{where}_exclusion": exclusion}
    return measure(StarTracker("star", StarTracker.Params(**chosen)), **other).valid


@pytest.mark.parametrize("where", ["sun", "moon", "limb"])
def test_exclusion(where: str) -> None:
    """Half a thousandth of a radian on both sides of the limit; the limb is asin(R / r) from nadir."""
    edge = 0.4 + (np.arcsin(6378137.0 / 7e6) if where == "limb" else 0.0)
    assert not exposed(edge - 5e-4, where, 0.4)
    assert exposed(edge + 5e-4, where, 0.4)
    assert exposed(edge - 5e-4, where, 0.0)


@pytest.mark.parametrize("port", ["in_sun", "in_moon"])
def test_unknown_sun_or_moon_blinds(port: str) -> None:
    """An exclusion angle without knowledge of the body gives no measurement, not one that looks right."""
    params = StarTracker.Params(sun_exclusion=0.1, moon_exclusion=0.1)
    assert measure(StarTracker("star", params)).valid
    message = measure(StarTracker("star", params), leave=(port,))
    assert not message.valid
    assert np.isnan(message.beta_SN).all()


def test_inside_the_planet_is_no_place_to_see_stars() -> None:
    params = StarTracker.Params(limb_exclusion=0.1)
    assert not measure(StarTracker("star", params), r_BN_N=np.array([6e6, 0.0, 0.0])).valid


def test_attitude_with_aberration() -> None:
    """Against the rotation that fits a small field of exactly aberrated stars, Earth's motion included."""
    rng = np.random.default_rng(2)
    body = Rotation.random(rng=rng)
    v, v_sun = np.array([3000.0, -6800.0, 1000.0]), np.array([-20e3, 22e3, 4e3])
    true_SN = body.inv()
    stars_S = np.column_stack([*rng.uniform(-0.01, 0.01, (2, 400)), np.ones(400)])
    stars_N = body.apply(stars_S / np.linalg.norm(stars_S, axis=1)[:, None])
    seen_S = true_SN.apply([boosted(u, (v - v_sun) / C_LIGHT) for u in stars_N])
    fitted = Rotation.align_vectors(seen_S, stars_N)[0]
    params = StarTracker.Params(**QUIET, aberration=True)
    truth: dict[str, Any] = {"sigma_BN": body.as_mrp(), "v_BN_N": v}
    message = measure(StarTracker("star", params), v_sun=v_sun, **truth)
    measured = Rotation.from_quat(message.beta_SN, scalar_first=True).inv()
    assert 3e-5 < (fitted * true_SN.inv()).magnitude() < 1.4e-4
    assert (measured * fitted.inv()).magnitude() < 5e-8  # the field's size times the square of the effect
    alone = measure(StarTracker("star", params), leave=("in_sun",), **truth)
    shift = Rotation.from_quat(alone.beta_SN, scalar_first=True).inv() * true_SN.inv()
    assert shift.magnitude() <= np.linalg.norm(v) / C_LIGHT
    assert shift.magnitude() > 1e-6
