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


def test_a_polar_orbit_over_the_pole() -> None:
    """The inclination leaves the heading open there, and rounding must not choose it."""
    for latitude in (math.pi / 2.0, -math.pi / 2.0):
        by_heading = initial_state.from_geodetic(latitude, 0.7, 5e5, np.eye(3), heading=0.0)
        state = initial_state.from_geodetic(latitude, 0.7, 5e5, np.eye(3), inclination=math.pi / 2.0)
        np.testing.assert_allclose(state.v_BN_N, by_heading.v_BN_N, rtol=0, atol=1e-9)
        with pytest.raises(ValueError, match=r"expected 90\.000 to 90\.000 deg"):
            initial_state.from_geodetic(latitude, 0.7, 5e5, np.eye(3), inclination=1.5)


def with_number(lines: list[str], number: str) -> tuple[str, str]:
    """The same elements, the second line with another satellite's number and its checksum."""
    text = lines[1].replace("25544", number)[:68]
    return lines[0], text + str(sum(int(c) if c.isdigit() else c == "-" for c in text) % 10)


DECAYED = (  # Vallado et al. (2006), verification set of SGP4
    "1 28872U 05037B   05333.02012661  .25992681  00000-0  24476-3 0  1534",
    "2 28872  96.4736 157.9986 0303955 244.0492 110.6523 16.46015938 10708",
)


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
        (lambda: body("Jupitr"), r"did you mean Jupiter \(599\)"),
        (lambda: body("qwxz"), r"it has Sun \(10\), Mercury"),
        (lambda: initial_state.planet_params(398), r"398; did you mean Earth \(399\)"),
        (lambda: initial_state.from_rv(R, V, beta_BN=[1.0, 0.0, 0.0, 0.1]), "beta_BN: expected four numbers"),
        (lambda: initial_state.from_rv(R, V, beta_BN=[math.nan, 0.0, 0.0, 0.0]), "beta_BN: expected four numbers"),
        (lambda: initial_state.from_rv(R, V, roll_pitch_yaw=[0.0, math.inf, 0.0]), "roll_pitch_yaw: expected three"),
        (lambda: initial_state.from_rv(R, [0.0, 0.0, 0.0]), "parallel or zero"),
        (
            lambda: initial_state.from_geodetic(0.9, 0.0, 5e5, np.ones((3, 3)), heading=1.0),
            "dcm_EN: expected a rotation",
        ),
        (lambda: initial_state.from_geodetic(0.9, 0.0, 5e5, np.eye(3), heading=math.nan), "heading: expected a finite"),
        (lambda: initial_state.from_geodetic(0.9, math.nan, 5e5, np.eye(3), heading=1.0), "longitude, height"),
        (lambda: initial_state.from_geodetic(2.0, 0.0, 5e5, np.eye(3), heading=1.0), "latitude: expected"),
        (lambda: initial_state.from_geodetic(0.9, 0.0, -5e3, np.eye(3), heading=1.0), "through Earth"),
        (lambda: initial_state.from_geodetic(0.9, 0.0, 5e5, np.eye(3), inclination=2.5), "51.* to 128"),
        (lambda: initial_state.from_tle(TLE[0], TLE[1], epoch("1990-01-01T00:00:00Z")), "60 days.* 12176 days before"),
        (lambda: initial_state.from_tle(TLE[0], TLE[1], epoch("2023-07-10")), "60 days"),
        (
            lambda: initial_state.from_tle(TLE[0], TLE[1], epoch("2023-05-04"), planet="Mars"),
            "planet: expected the Earth",
        ),
        (lambda: initial_state.from_tle(*with_number(TLE, "25545"), epoch("2023-05-04")), "line2: .*25544, got 25545"),
        (lambda: initial_state.from_tle(*DECAYED, epoch("2005-12-02T00:28:59Z")), "SGP4 refuses.*eccentricity"),
        (lambda: initial_state.from_geodetic(0.1, 0.0, 5e5, np.eye(3), heading=0.0, planet="Mars"), "planet: expected"),
        (lambda: initial_state.sun_synchronous(700e3, 6.0, 0, e=-0.1), "e: expected the eccentricity"),
        (lambda: initial_state.sun_synchronous(700e3, 6.0, 0, e=1.2), "e: expected the eccentricity"),
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


def test_inertial_attitude_and_rate() -> None:
    """Euler parameters instead of angles; without an inertial rate the body stays with the orbit frame."""
    beta = np.array([0.5, -0.5, 0.5, 0.5])
    still = initial_state.from_rv(R, V, beta_BN=beta, omega_BN_B=[0.0, 0.0, 0.0])
    dcm_BN = Rotation.from_quat(beta, scalar_first=True).as_matrix().T
    np.testing.assert_allclose(Rotation.from_mrp(still.sigma_BN.copy()).as_matrix().T, dcm_BN, atol=1e-15)
    assert not still.omega_BN_B.any()
    with_orbit = initial_state.from_rv(R, V, beta_BN=beta)
    np.testing.assert_allclose(with_orbit.omega_BN_B, dcm_BN @ np.cross(R, V) / (R @ R), atol=1e-18)


def test_orbit_frame_rate_by_differences() -> None:
    """On an eccentric orbit too the level body keeps its axes in the orbit frame: flown for 1 s each way."""
    state = initial_state.from_elements(9e6, 0.2, 1.1, 0.3, 0.7, 1.3)
    r, v = state.r_BN_N.copy(), state.v_BN_N.copy()
    g = -3.986004415e14 * r / np.linalg.norm(r) ** 3

    def axes(t: float) -> Rotation:
        """Position to the third order, velocity to the second."""
        at, speed = r + v * t + 0.5 * g * t * t, v + g * t
        z = -at / np.linalg.norm(at)
        y = -np.cross(at, speed) / np.linalg.norm(np.cross(at, speed))
        return Rotation.from_matrix(np.stack([np.cross(y, z), y, z], axis=1))

    h = 0.05
    rate = (axes(-h).inv() * axes(h)).as_rotvec() / (2.0 * h)
    np.testing.assert_allclose(state.omega_BN_B, rate, atol=1e-10)


@pytest.mark.parametrize(
    ("r", "v", "refused"),
    [
        # periapsis between both radii: refused over the equator, allowed over the pole
        ([6.37e6, 0.0, 0.0], [0.0, 8.2e3, 0.0], True),
        ([0.0, 0.0, 6.37e6], [0.0, 8.2e3, 0.0], False),
        # an ellipse comes back, a hyperbola that climbs does not
        ([6.5e6, 0.0, 0.0], [7e3, 3e3, 0.0], True),
        ([6.5e6, 0.0, 0.0], [12e3, 3e3, 0.0], False),
        ([6.5e6, 0.0, 0.0], [-12e3, 3e3, 0.0], True),
        ([4e7, 0.0, 0.0], [-1e3, 9e3, 0.0], False),
    ],
)
def test_orbits_that_meet_the_earth(r: list[float], v: list[float], refused: bool) -> None:
    if refused:
        with pytest.raises(ValueError, match="through Earth"):
            initial_state.from_rv(r, v)
    else:
        assert initial_state.from_rv(r, v).r_BN_N[2] == r[2]


@pytest.mark.parametrize(
    ("planet", "moon_km", "days", "tolerance"),
    [  # semi-major axes and periods of moons: JPL and NASA tables; the mass of the moon counts too
        ("Earth", 384400.0, 27.3217, 0.02),
        ("Mars", 9376.0, 0.31891, 1e-3),
        ("Jupiter", 421800.0, 1.769138, 1e-3),
        ("Saturn", 1221870.0, 15.945421, 1e-3),
        ("Uranus", 436298.0, 8.705872, 1e-3),
        ("Neptune", 354759.0, 5.876854, 1e-3),
        ("Pluto", 19591.0, 6.387230, 0.13),
        ("Sun", 149598023.0, 365.25636, 1e-4),
    ],
)
def test_mu_of_planets_by_their_moons(planet: str, moon_km: float, days: float, tolerance: float) -> None:
    mu = 4.0 * math.pi**2 * (moon_km * 1e3) ** 3 / (days * 86400.0) ** 2
    assert body(planet).mu == pytest.approx(mu, rel=tolerance)


@pytest.mark.parametrize(
    ("name", "gravity"),
    [
        *[("Moon", 1.62), ("Mercury", 3.70), ("Venus", 8.87), ("Io", 1.796), ("Europa", 1.314), ("Ganymede", 1.428)],
        *[("Callisto", 1.236), ("Titan", 1.352), ("Ceres", 0.27), ("Vesta", 0.22), ("Phobos", 0.0057)],
    ],
)
def test_gravity_on_the_ground(name: str, gravity: float) -> None:
    """Published to two or three digits."""
    b = body(name)
    assert b.mu / b.radius**2 == pytest.approx(gravity, rel=0.06 if gravity < 1.0 else 0.01)
