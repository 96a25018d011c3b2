"""Initial states against Vallado's published examples, scipy's rotations, ERFA by another way, and geometry."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Simulation, Task, s
from fsw.math.bodies import bodies, body
from fsw.math.epoch import epoch, julian_dates
from sim.dynamics import initial_state
from sim.dynamics.spacecraft import Spacecraft

R, V = np.array([-5279847.8, -495460.7, 4343152.4]), np.array([-2434.75, -6523.03, -3530.27])
ERFA: Any = erfa
TLE = (Path(__file__).parents[3] / "sim" / "data" / "orbits" / "iss_tle_2023-05-03.txt").read_text().splitlines()


def test_attitude_relative_to_the_orbit_frame() -> None:
    """Nadir pointing: z to the centre, x along the track; the rate is that of the orbit, about -y."""
    state = initial_state.from_rv(R, V)
    dcm_BN = Rotation.from_mrp(state.sigma_BN.copy()).as_matrix().T
    np.testing.assert_allclose(dcm_BN @ R / np.linalg.norm(R), [0.0, 0.0, -1.0], atol=1e-15)
    assert (dcm_BN @ V)[0] > 0.99 * np.linalg.norm(V)
    rate = np.linalg.norm(np.cross(R, V)) / (R @ R)
    np.testing.assert_allclose(state.omega_BN_B, [0.0, -float(rate), 0.0], atol=1e-18)


def test_roll_pitch_yaw_and_rate() -> None:
    angles, spin = (0.2, -0.3, 0.7), np.array([0.01, -0.02, 0.005])
    level, turned = initial_state.from_rv(R, V), initial_state.from_rv(R, V, roll_pitch_yaw=angles, omega_BO_B=spin)
    dcm_ON, dcm_BN = (Rotation.from_mrp(x.sigma_BN.copy()).as_matrix().T for x in (level, turned))
    expected = Rotation.from_euler("ZYX", angles[::-1]).as_matrix().T
    np.testing.assert_allclose(dcm_BN @ dcm_ON.T, expected, atol=2e-15)
    np.testing.assert_allclose(turned.omega_BN_B, spin + expected @ level.omega_BN_B, atol=1e-17)


def test_elements_round_the_periapsis() -> None:
    state = initial_state.from_elements(7.2e6, 0.05, 0.9, 1.0, 2.0, 0.0)
    assert np.linalg.norm(state.r_BN_N) == pytest.approx(7.2e6 * 0.95, rel=1e-14)
    assert state.v_BN_N @ state.r_BN_N == pytest.approx(0.0, abs=1e-3)
    normal = np.cross(state.r_BN_N, state.v_BN_N)
    assert normal[2] / np.linalg.norm(normal) == pytest.approx(math.cos(0.9), rel=1e-14)


def test_sun_synchronous_plane_turns_with_the_mean_sun() -> None:
    """Flown with J2 for ten days, the node moves by 360 deg / 365.2422 a day; Vallado gives i = 98.6 deg at 800 km."""
    zero = epoch("2023-03-20T21:24:00Z")  # equinox: the Sun is at right ascension 0
    elements = initial_state.sun_synchronous(800e3, 10.5, zero)
    assert math.degrees(elements[2]) == pytest.approx(98.6, abs=0.05)
    assert math.remainder(elements[3] - math.radians(-22.5), 2 * math.pi) == pytest.approx(0.0, abs=math.radians(2.0))
    craft = Spacecraft(
        "craft",
        Spacecraft.Params(inertia_B=np.eye(3), tolerance=1e-11),
        initial_state.from_elements(*elements),
    )
    rec = craft.out_conserved.record(every=s(600))
    Simulation([Task("truth", s(600), [craft])]).run_until(s(10 * 86400))
    h = rec["momentum_orbit_N"]
    node = np.unwrap(np.arctan2(h[:, 0], -h[:, 1]))
    per_day = np.polyfit(rec.t_s / 86400.0, node, 1)[0]
    assert math.degrees(per_day) == pytest.approx(360.0 / 365.2422, rel=6e-3)  # 7/2 times 3/2 J2: osculating for mean


@pytest.mark.parametrize("ascending", [True, False])
@pytest.mark.parametrize("inclination", [0.9, 1.7, 2.1])
def test_inclination_over_a_place(inclination: float, ascending: bool) -> None:
    dcm_EN = Rotation.from_rotvec([0.0, 0.0, -1.1]).as_matrix()
    state = initial_state.from_geodetic(0.8, -2.0, 500e3, dcm_EN, inclination=inclination, ascending=ascending)
    h = np.cross(state.r_BN_N, state.v_BN_N)
    assert math.acos(h[2] / np.linalg.norm(h)) == pytest.approx(inclination, abs=1e-12)
    assert bool(state.v_BN_N[2] > 0.0) is ascending
    assert state.v_BN_N @ state.r_BN_N == pytest.approx(0.0, abs=1e-4)
    geodetic = ERFA.gc2gd(1, dcm_EN @ state.r_BN_N)
    np.testing.assert_allclose(geodetic, (-2.0, 0.8, 500e3), rtol=1e-12)


def test_heading_east_on_the_equator_is_equatorial() -> None:
    state = initial_state.from_geodetic(0.0, 0.3, 500e3, np.eye(3), heading=math.pi / 2)
    np.testing.assert_allclose(np.cross(state.r_BN_N, state.v_BN_N)[:2], 0.0, atol=1e-3)


def test_teme_against_vallado() -> None:
    """Vallado, Crawford, Hujsak and Kelso (2006), AIAA 2006-6753, appendix C, and Vallado, 4th ed., example 3-15."""
    dcm = initial_state.dcm_gcrf_teme(epoch("2004-04-06T07:51:28.386009Z"))
    r = dcm @ np.array([5094180.16210, 6127644.65950, 6380344.53270])
    v = dcm @ np.array([-4746.1319870, 785.8180410, 5531.9312880])
    assert np.linalg.norm(r - [5102508.958, 6123011.401, 6378136.928]) < 1.5
    assert np.linalg.norm(v - [-4743.2196, 790.5366, 5533.7561]) < 2e-3


def test_tle_at_its_epoch() -> None:
    """By way of the true equator and equinox of IAU 1976/1980, which SGP4 was made for: 1 m and the frame bias."""
    from sgp4.api import Satrec

    zero = epoch("2023-05-03T16:00:00Z")
    state = initial_state.from_tle(TLE[0], TLE[1], zero)
    tt, utc = julian_dates(zero), julian_dates(zero, "utc")
    _, r, v = Satrec.twoline2rv(*TLE[:2]).sgp4(*utc)
    old = ERFA.pnm80(*tt).T @ ERFA.rz(-ERFA.eqeq94(*tt), np.eye(3))
    assert np.linalg.norm(state.r_BN_N - old @ np.array(r) * 1e3) < 2.5
    assert np.linalg.norm(state.v_BN_N - old @ np.array(v) * 1e3) < 3e-3


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: initial_state.from_elements(6.5e6, 0.1, 0.5, 0.0, 0.0, 1.0), "through Earth"),
        (lambda: initial_state.from_elements(-7e6, 0.5, 0.5, 0.0, 0.0, 1.0), "no orbit"),
        (lambda: initial_state.from_rv(R, R * 1e-3), "parallel"),
        (lambda: initial_state.from_rv([1.0, 2.0, math.nan], V), "finite"),
        (lambda: initial_state.from_rv(R, V, planet="Vulcan"), "Vulcan"),
        (lambda: initial_state.from_geodetic(0.9, 0.0, 5e5, np.eye(3), inclination=0.5), "inclination"),
        (lambda: initial_state.from_geodetic(0.9, 0.0, 5e5, np.eye(3)), "one of the two"),
        (lambda: initial_state.sun_synchronous(7000e3, 6.0, 0), "Sun-synchronous"),
        (lambda: initial_state.sun_synchronous(700e3, 25.0, 0), "local_time"),
        (lambda: initial_state.from_tle(TLE[0], TLE[1].replace("51.6420", "51.6421"), 0), "checksum"),
        (lambda: body(12345), "12345"),
    ],
)
def test_what_is_refused(make: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make()


@pytest.mark.parametrize("planet", [b.name for b in bodies()])
def test_every_body_makes_a_planet(planet: str) -> None:
    b = body(planet)
    assert body(b.naif) is b and body(planet.lower()) is b
    params = Spacecraft.Params(inertia_B=np.eye(3), **initial_state.planet_params(planet))
    r, speed = 3.0 * b.radius, math.sqrt(b.mu / (3.0 * b.radius))
    state = initial_state.from_rv([r, 0.0, 0.0], [0.0, 0.8 * speed, 0.6 * speed], planet=planet)
    assert params.mu == b.mu and np.linalg.norm(state.r_BN_N) == r
