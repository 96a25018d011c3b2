"""Spacecraft with the real modules round it: bounded errors of what is held and extrapolated; and what stops a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import erfa
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from fsw import Module, ModuleError, Out, Simulation, Task, s
from fsw.math.atmosphere import EARTH_BANDS
from fsw.math.epoch import epoch, julian_dates
from fsw.math.gravity import MU_EARTH
from messages.base import F64
from messages.environment import AtmosphereMsg, EphemerisMsg, MagneticFieldMsg, PlanetOrientationMsg
from sim.dynamics import initial_state
from sim.dynamics.spacecraft import Spacecraft
from sim.environment.atmosphere import Atmosphere
from sim.environment.earth_orientation import EarthOrientation, aligned
from sim.environment.eclipse import Eclipse
from sim.environment.ephemeris import Ephemeris

Criterion = Callable[[str, float], None]
ERFA: Any = erfa
EPOCH = epoch("2024-03-20T06:00:00Z")
AU, MU_SUN, MU_MOON, R_SUN = 149597870700.0, 1.32712440041279419e20, 4.9028001184575496e12, 695700e3


def spacecraft(r: F64, v: F64, **params: Any) -> Spacecraft:
    start = Spacecraft.State(r_BN_N=r, v_BN_N=v, sigma_BN=np.zeros(3), omega_BN_B=np.zeros(3))
    return Spacecraft("craft", Spacecraft.Params(inertia_B=np.eye(3), mass=100.0, **params), start)


def circular(height: float, inclination: float = 0.9) -> tuple[F64, F64]:
    r = 6378137.0 + height
    speed = math.sqrt(MU_EARTH / r)
    return np.array([r, 0.0, 0.0]), speed * np.array([0.0, math.cos(inclination), math.sin(inclination)])


def sun_and_moon(t: float) -> tuple[F64, F64]:
    """Geocentric positions by ERFA at any time, m."""
    whole, rest = julian_dates(EPOCH + round(t * 1e9))
    earth, _ = ERFA.epv00(whole, rest)
    return -np.array(earth["p"]) * AU, np.array(ERFA.moon98(whole, rest)["p"]) * AU


def attraction(r: F64, body: F64, mu: float) -> F64:
    d = body - r
    return np.asarray(mu * (d / (d @ d) ** 1.5 - body / (body @ body) ** 1.5), np.float64)


def solved(slope: Callable[[float, F64], F64], r: F64, v: F64, duration: float) -> F64:
    y0, limits = np.concatenate([r, v]), np.repeat([1e-6, 1e-9], 3)
    return solve_ivp(slope, (0.0, duration), y0, "DOP853", rtol=1e-12, atol=limits, max_step=300.0).y[:, -1]


@pytest.mark.parametrize("tolerance", [0.0, 1e-11])
def test_moving_sun_and_moon(tolerance: float, criterion: Criterion) -> None:
    """A day at 20,000 km; positions come every 10 minutes and move straight between."""
    r, v = circular(2.0e7)
    craft = spacecraft(r, v, j2=0.0, max_step=10.0, tolerance=tolerance)
    sun, moon = (Ephemeris(n, Ephemeris.Params(body_id=i, epoch_tai_ns=EPOCH)) for n, i in (("sun", 10), ("moon", 301)))
    sun.out_ephemeris.connect(craft.in_sun)
    moon.out_ephemeris.connect(craft.in_moon)
    sim = Simulation([Task("far", s(600), [sun, moon]), Task("truth", s(60), [craft])])
    sim.run_until(s(86400))

    def slope(t: float, y: F64) -> F64:
        at_sun, at_moon = sun_and_moon(t)
        pull = attraction(y[:3], at_sun, MU_SUN) + attraction(y[:3], at_moon, MU_MOON)
        return np.concatenate([y[3:], -MU_EARTH * y[:3] / (y[:3] @ y[:3]) ** 1.5 + pull])

    criterion("SPACECRAFT-20", float(np.linalg.norm(craft.state.r_BN_N - solved(slope, r, v, 86400.0)[:3])))


@pytest.mark.parametrize("tolerance", [0.0, 1e-11])
def test_air_that_is_held(tolerance: float, criterion: Criterion) -> None:
    """An orbit at 300 km in exponential air that turns with a sphere, held for 10 s each time."""
    r, v = circular(300e3)
    air = {"drag_coefficient": 2.2, "drag_area": 1.0}
    craft = spacecraft(r, v, j2=0.0, max_step=10.0, tolerance=tolerance, **air)
    earth, atmosphere = EarthOrientation("earth", aligned()), Atmosphere("air", Atmosphere.Params(flattening=0.0))
    craft.out_state.connect(atmosphere.in_state)
    earth.out_orientation.connect(atmosphere.in_orientation)
    atmosphere.out_atmosphere.connect(craft.in_atmosphere, delayed=True)
    sim = Simulation([Task("truth", s(10), [craft, earth, atmosphere])])
    sim.run_until(s(5400))

    def slope(_: float, y: F64, dragged: bool = True) -> F64:
        height = (np.linalg.norm(y[:3]) - 6378137.0) / 1e3
        base, density, scale = EARTH_BANDS[np.searchsorted(EARTH_BANDS[:, 0], height, side="right") - 1]
        u = y[3:] - 7.2921151467e-5 * np.array([-y[1], y[0], 0.0])
        drag = -0.5 * density * math.exp((base - height) / scale) * 2.2 / 100.0 * np.linalg.norm(u) * u
        return np.concatenate([y[3:], -MU_EARTH * y[:3] / (y[:3] @ y[:3]) ** 1.5 + dragged * drag])

    expected, free = solved(slope, r, v, 5400.0), solved(lambda t, y: slope(t, y, False), r, v, 5400.0)
    moved = np.linalg.norm(expected[:3] - free[:3])
    criterion("SPACECRAFT-21", float(np.linalg.norm(craft.state.r_BN_N - expected[:3]) / moved))


def test_light_and_shadow(criterion: Criterion) -> None:
    """Two orbits through the shadow; the visible part of the Sun by a numeric integral over its disk, every second."""
    r, v = circular(600e3, 0.3)
    craft = spacecraft(r, v, j2=0.0, max_step=1.0, light_area=2.0)
    sun, eclipse = Ephemeris("sun", Ephemeris.Params(epoch_tai_ns=EPOCH)), Eclipse("eclipse")
    sun.out_ephemeris.connect(craft.in_sun)
    sun.out_ephemeris.connect(eclipse.in_sun)
    craft.out_state.connect(eclipse.in_state)
    eclipse.out_eclipse.connect(craft.in_eclipse, delayed=True)
    rec, light = craft.out_force.record(), eclipse.out_eclipse.record()
    path = craft.out_state.record()
    Simulation([Task("truth", s(1), [sun, craft, eclipse])]).run_until(s(11600))
    middles = path["r_BN_N"][:-1] + 0.5 * np.diff(path["r_BN_N"], axis=0)
    gained = sum(shine(r - sun_and_moon(float(t) + 0.5)[0], r) for t, r in zip(path.t_s[:-1], middles, strict=True))
    criterion("SPACECRAFT-22", float(np.linalg.norm(rec["dv_BN_N"][-1] - gained) / np.linalg.norm(gained)))
    assert 0.3 < np.mean(light["illumination"] == 0.0) < 0.4


def shine(d: F64, r: F64) -> F64:
    """Acceleration by sunlight at ``r``, ``d`` from the Sun; overlap of two disks as chords of the Sun's."""
    far, near = float(np.linalg.norm(d)), float(np.linalg.norm(r))
    a, b = math.asin(R_SUN / far), math.asin(6378137.0 / near)
    c = math.acos(max(-1.0, min(1.0, float(-d @ -r) / far / near)))
    part = 1.0
    if c < b - a:
        part = 0.0
    elif c < a + b:

        def chord(x: float) -> float:
            """Of the Sun, ``x`` from its centre towards the Earth's, where the Earth hides it."""
            half = math.sqrt(max(a * a - x * x, 0.0))
            hidden = math.sqrt(max(b * b - (c - x) ** 2, 0.0))
            return 2.0 * min(half, hidden)

        part = 1.0 - quad(chord, -a, a, limit=200)[0] / (math.pi * a * a)
    return np.asarray(part * 1361.0 / 299792458.0 * (AU / far) ** 2 * 1.3 * 2.0 / 100.0 * d / far, np.float64)


def test_the_surface_stops_the_run() -> None:
    """A fall from rest, 500 km above the pole: the time is Kepler's of a straight line, the polar radius is met."""
    craft = spacecraft(np.array([0.0, 0.0, 6.9e6]), np.array([0.0, 1e-3, 0.0]), j2=0.0)
    r0, r1 = 6.9e6, 6356752.314245
    x = r1 / r0
    falls = math.sqrt(r0**3 / (2 * MU_EARTH)) * (math.acos(math.sqrt(x)) + math.sqrt(x * (1 - x)))
    sim = Simulation([Task("truth", s(1), [craft])])
    sim.run_until(s(math.floor(falls)))
    with pytest.raises(ModuleError, match=r"below the planet's surface .*it has come down"):
        sim.run_until(s(math.ceil(falls)))
    assert craft.state.time_ns == s(math.floor(falls))


@pytest.mark.parametrize("tolerance", [0.0, 1e-9])
def test_a_dive_between_two_steps_of_the_task_is_seen(tolerance: float) -> None:
    """Periapsis 100 km below the surface for some 4 minutes, halfway between outputs 2 hours apart."""
    speed = math.sqrt(2.0 * MU_EARTH * (1.0 / 9e6 - 1.0 / (9e6 + 6.278e6)))
    craft = spacecraft(
        np.array([9e6, 0.0, 0.0]), np.array([0.0, speed, 0.0]), tolerance=tolerance, j2=0.0, max_step=1.0
    )
    with pytest.raises(ModuleError, match="surface"):
        Simulation([Task("truth", s(7200), [craft])]).run_until(s(7200))


def test_beyond_the_ephemeris() -> None:
    craft = spacecraft(*circular(500e3))
    sun = Ephemeris("sun", Ephemeris.Params(epoch_tai_ns=EPOCH, span=100.0))
    sun.out_ephemeris.connect(craft.in_sun)
    with pytest.raises(ModuleError, match=r"span.*outside of the table"):
        Simulation([Task("truth", s(1), [sun, craft])]).run_until(s(200))
    assert craft.state.time_ns == s(100)


class Bad(Module):
    """Messages with NaN in one field."""

    out_orientation = Out(PlanetOrientationMsg)
    out_sun = Out(EphemerisMsg)
    out_moon = Out(EphemerisMsg)
    out_atmosphere = Out(AtmosphereMsg)
    out_field = Out(MagneticFieldMsg)

    def step(self, t_ns: int) -> None:
        """Write numbers and then spoil one."""
        self.out_orientation.write(PlanetOrientationMsg(dcm_EN=np.eye(3), omega_EN_N=np.zeros(3)), t_ns)
        for port in (self.out_sun, self.out_moon):
            port.write(EphemerisMsg(body_id=10, mu=1.0, radius=1.0, r_PN_N=np.ones(3), v_PN_N=np.ones(3)), t_ns)
        self.out_atmosphere.write(AtmosphereMsg(density=1e-12, v_AN_N=np.zeros(3)), t_ns)
        self.out_field.write(MagneticFieldMsg(B_N=np.ones(3)), t_ns)
        for port, field in (
            (self.out_orientation, "omega_EN_N"),
            (self.out_sun, "r_PN_N"),
            (self.out_moon, "v_PN_N"),
            (self.out_atmosphere, "density"),
            (self.out_field, "B_N"),
        ):
            port.row[field] = np.nan


@pytest.mark.parametrize("name", ["orientation", "sun", "moon", "atmosphere", "field"])
def test_nan_in_an_input(name: str) -> None:
    craft, bad = spacecraft(*circular(500e3), drag_area=1.0, dipole_B=np.ones(3)), Bad("bad")
    getattr(bad, f"out_{name}").connect(getattr(craft, f"in_{name}"))
    with pytest.raises(ModuleError, match=f"in_{name}.*NaN"):
        Simulation([Task("truth", s(1), [bad, craft])]).run_until(0)
    assert craft.out_state.latest() is None


@pytest.mark.parametrize(
    ("params", "name"),
    [
        ({"drag_area": 1.0}, "in_atmosphere"),
        ({"light_area": 1.0}, "in_sun"),
        ({"dipole_B": np.ones(3)}, "in_field"),
        ({"degree": 2, "C": np.ones((51, 51))}, "in_orientation"),
    ],
)
def test_an_effect_without_its_input(params: dict[str, Any], name: str) -> None:
    craft = spacecraft(*circular(500e3), **params)
    with pytest.raises(ModuleError, match=f"{name}: expected a message"):
        Simulation([Task("truth", s(1), [craft])]).run_until(s(1))


def test_harmonics_without_coefficients() -> None:
    with pytest.raises(ValueError, match=r"Params\.C: expected coefficients"):
        Spacecraft.Params(inertia_B=np.eye(3), degree=4)


def test_nan_in_the_start() -> None:
    with pytest.raises(ValueError, match="v_BN_N"):
        spacecraft(np.array([7e6, 0.0, 0.0]), np.array([0.0, math.nan, 0.0]))


def test_tolerance_that_cannot_be_met() -> None:
    """Straight through a point mass."""
    craft = spacecraft(np.array([7e6, 0.0, 0.0]), np.zeros(3), j2=0.0, tolerance=1e-10, surface_radius=1e-3)
    with pytest.raises(ModuleError, match=r"Params\.tolerance|finite|surface"):
        Simulation([Task("truth", s(1), [craft])]).run_until(s(3600))


def test_attitude_alone_needs_no_place() -> None:
    """mu = 0 at the origin: only the rotation."""
    for tolerance in (0.0, 1e-10):
        start = Spacecraft.State(
            r_BN_N=np.zeros(3), v_BN_N=np.zeros(3), sigma_BN=np.zeros(3), omega_BN_B=np.array([0.0, 0.0, 0.1])
        )
        craft = Spacecraft("craft", Spacecraft.Params(inertia_B=np.eye(3), mu=0.0, tolerance=tolerance), start)
        Simulation([Task("truth", s(1), [craft])]).run_until(s(10))
        np.testing.assert_allclose(craft.state.sigma_BN, [0.0, 0.0, math.tan(0.25)], atol=1e-9)
        assert not craft.state.r_BN_N.any()


def test_a_planet_of_the_table_is_flown() -> None:
    """After the period of a circular orbit, by Kepler's law, it is back."""
    for planet in ("Moon", "Mars", "Jupiter", "Europa", "Bennu", 2000004):
        given = initial_state.planet_params(planet) | {f"j{n}": 0.0 for n in range(2, 7)}
        r = 3.0 * given["surface_radius"]
        period = 2.0 * math.pi * math.sqrt(r**3 / given["mu"])
        craft = spacecraft(
            np.array([r, 0.0, 0.0]), np.array([0.0, math.sqrt(given["mu"] / r), 0.0]), tolerance=1e-12, **given
        )
        Simulation([Task("truth", round(period * 1e9), [craft])]).run_until(round(period * 1e9))
        np.testing.assert_allclose(craft.state.r_BN_N, [r, 0.0, 0.0], atol=1e-9 * r)
