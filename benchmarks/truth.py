"""Spacecraft, environment and sensors of this repository, one kind of module many times or all of them as they fly."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.case import FAST, SLOW, STARS, Case, Sky
from fsw import KernelModule, Simulation, Task, minutes, ms, s
from fsw.math.bodies import body
from fsw.math.compiled import plain
from fsw.math.earth_orientation import assumed_parameters
from fsw.math.epoch import epoch
from fsw.math.harmonics import read_icgem
from fsw.math.kepler import rv_to_elements
from fsw.math.magnetic import RADIUS
from fsw.math.vectors import vec3
from sim.dynamics.spacecraft import Spacecraft
from sim.environment.atmosphere import Atmosphere
from sim.environment.dipole_field import DipoleField
from sim.environment.earth_orientation import EarthOrientation, aligned, earth_rotation, iau2006
from sim.environment.eclipse import Eclipse
from sim.environment.ephemeris import Ephemeris
from sim.environment.magnetic_field import MagneticField, igrf14, of_model, wmm2025
from sim.environment.magnetic_field.models import DATA, year_start
from sim.environment.star_catalogue import bright_stars
from sim.scenarios import leo_sensors
from sim.sensors.accelerometer import Accelerometer
from sim.sensors.css_array import CssArray
from sim.sensors.gps import Gps
from sim.sensors.gyro import Gyro
from sim.sensors.magnetometer import Magnetometer
from sim.sensors.simple_nav import SimpleNav
from sim.sensors.star_tracker import StarTracker
from sim.sensors.star_vectors import StarVectors, catalogue

START = epoch("2025-06-21T10:30:00Z")
GRAVITY = DATA.parent / "gravity" / "EGM2008_50.gfc"
SUN_RADIUS, EARTH_RADIUS = 695000e3, 6378136.6
"""Of Basilisk's table, m."""
ONCE = minutes(60 * 24 * 365)


@cache
def _sun_params() -> Ephemeris.Params:
    return Ephemeris.Params(epoch_tai_ns=START, radius=SUN_RADIUS)


@cache
def _field_params(model: str) -> MagneticField.Params:
    return of_model(wmm2025() if model == "WMM2025" else igrf14(), START)


@cache
def _iau_params() -> EarthOrientation.Params:
    return iau2006(START, minutes(60 * 24 * 30), assumed_parameters(START, 0.0))


@cache
def _star_params() -> StarVectors.Params:
    stars = bright_stars()
    return StarVectors.Params(**catalogue(stars.u_N, stars.magnitude, faintest=5.0))


def orbit_case(degree: int = 0, period_ns: int = ms(100)) -> Case:
    """The orbit of the scenario leo_sensors under EGM2008: J2 alone, or harmonics of ``degree``."""
    state = leo_sensors.build().spacecraft.state
    field = read_icgem(GRAVITY)
    return Case(
        r_BN_N=np.array(state.r_BN_N),
        v_BN_N=np.array(state.v_BN_N),
        sigma_BN=np.array(state.sigma_BN),
        omega_BN_B=np.array(state.omega_BN_B),
        inertia_B=np.diag([9.0, 8.0, 6.0]),
        mu=field.mu,
        radius=field.radius,
        j2=float(-np.sqrt(5.0) * field.C[2, 0]),
        period_ns=period_ns,
        degree=degree,
        C=field.C if degree else None,
        S=field.S if degree else None,
    )


def sky() -> Sky:
    """What the other side is to be given of this one's surroundings."""
    sun = Ephemeris("sun", _sun_params())
    Simulation([Task("t", period=s(1), modules=[sun])]).step()
    message, dipole = sun.out_ephemeris.latest(), DipoleField.Params()
    assert message is not None
    elements = plain(rv_to_elements)(vec3(message.r_PN_N), vec3(message.v_PN_N), body("Sun").mu)
    return Sky(
        sun_elements=elements,
        year=2025.0 + (START - year_start(2025)) / (year_start(2026) - year_start(2025)),
        wmm_file=str(DATA / "WMM_2025.COF"),
        dipole=(dipole.g10, dipole.g11, dipole.h11),
        field_radius=RADIUS,
        earth_radius=EARTH_RADIUS,
    )


class Graph:
    """A spacecraft among a still Earth, Sun and shadow, and a magnetic field; subclasses add modules and tasks.

    Args:
        case: of the spacecraft. noise: of the sensors; without it, parameters are those with which both sides should
        give the same. model: the field is IGRF-14, not a dipole.
    """

    sim: Simulation

    def __init__(self, case: Case, *, noise: bool = True, model: bool = False) -> None:
        self.period_ns, self.noise = case.period_ns, noise
        self.craft = _spacecraft(case)
        self.turning = EarthOrientation("turning", aligned(0.0))
        self.sun = Ephemeris("sun", _sun_params())
        self.eclipse = _eclipse(self, "eclipse")
        self.field = _magnetic_field(self, "field") if model else _dipole(self, "field")

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods; the instant 0 comes with the first."""
        self.sim.run_for(ticks * self.period_ns)


class Ours(Graph):
    """Modules of one kind, all run at each tick; the Sun stands still.

    Args:
        case: of the spacecraft. kind: of the modules, a key of `KINDS`. count: how many. noise: as in `Graph`.
    """

    def __init__(self, case: Case, kind: str, count: int, *, noise: bool = True) -> None:
        super().__init__(case, noise=noise)
        self.added = [module for i in range(count) for module in KINDS[kind](self, f"_{i}")]
        modules = [self.turning, self.craft, self.eclipse, self.field, *self.added]
        once = Task("once", period=ONCE, modules=[self.sun])
        self.sim = Simulation([once, Task("tick", period=case.period_ns, modules=modules)], seed=1)

    def history(self, field: str, ticks: int) -> NDArray[np.float64]:
        """A field of the output of the last module at each tick."""
        recording = self.added[-1].outputs[0].record()
        self.run(ticks)
        return np.array(recording[field])[:ticks]


class Orbit:
    """The spacecraft alone; with harmonics it is told how the Earth is turned, as it must be."""

    def __init__(self, case: Case) -> None:
        self.period_ns = case.period_ns
        self.craft = _spacecraft(case)
        modules: list[KernelModule] = [self.craft]
        if case.degree:
            turning = EarthOrientation("turning", aligned(0.0))
            turning.out_orientation.connect(self.craft.in_orientation)
            modules.insert(0, turning)
        self.sim = Simulation([Task("t", period=case.period_ns, modules=modules)])

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods."""
        self.sim.run_for(ticks * self.period_ns)

    def position(self) -> NDArray[np.float64]:
        """Newest position, N components, m."""
        state = self.craft.out_state.latest()
        assert state is not None
        return np.array(state.r_BN_N)


class Whole(Graph):
    """The whole sensor graph: spacecraft, environment, and each sensor that has a counterpart, at their rates."""

    def __init__(self, case: Case) -> None:
        super().__init__(case, model=True)
        sky = [self.turning, self.sun, self.eclipse, *_atmosphere(self, ""), self.field]
        slow = [*_magnetometer(self, ""), *_css(self, ""), *_nav(self, "")]
        tasks = [
            Task("truth", period=ms(FAST), modules=[self.craft]),
            Task("sky", period=ms(SLOW), modules=sky),
            Task("inertial", period=ms(FAST), modules=_imu(self, "")),
            Task("stars", period=ms(STARS), modules=_tracker(self, "")),
            Task("slow", period=ms(SLOW), modules=slow),
        ]
        self.sim = Simulation(tasks, seed=1)


def _spacecraft(case: Case) -> Spacecraft:
    given: dict[str, Any] = {"C": case.C, "S": case.S} if case.degree else {}
    params = Spacecraft.Params(
        inertia_B=case.inertia_B,
        mass=case.mass,
        mu=case.mu,
        radius=case.radius,
        j2=case.j2,
        degree=case.degree,
        max_step=max(case.period_ns / 1e9, 0.1),
        **given,
    )
    motion = {n: getattr(case, n) for n in ("r_BN_N", "v_BN_N", "sigma_BN", "omega_BN_B")}
    return Spacecraft("craft", params, Spacecraft.State(**motion))


def _eclipse(graph: Graph, name: str) -> Eclipse:
    """Past the Earth alone, as on the other side."""
    module = Eclipse(name, Eclipse.Params(radius=EARTH_RADIUS))
    graph.craft.out_state.connect(module.in_state)
    graph.sun.out_ephemeris.connect(module.in_sun)
    return module


def _dipole(graph: Graph, name: str) -> DipoleField:
    """Of IGRF-14 for 2025."""
    module = DipoleField(name)
    graph.craft.out_state.connect(module.in_state)
    graph.turning.out_orientation.connect(module.in_orientation)
    return module


def _magnetic_field(graph: Graph, name: str, model: str = "IGRF-14") -> MagneticField:
    module = MagneticField(name, _field_params(model))
    graph.craft.out_state.connect(module.in_state)
    graph.turning.out_orientation.connect(module.in_orientation)
    return module


def _atmosphere(graph: Graph, name: str) -> list[KernelModule]:
    params = Atmosphere.Params()
    if not graph.noise:
        density, height = Sky((), 0.0, "", (0.0, 0.0, 0.0), 0.0, 0.0).air
        shape: Any = {"radius": EARTH_RADIUS, "flattening": 0.0, "bands": 1}
        bands = len(params.density)
        params = Atmosphere.Params(
            **shape, base_height=np.zeros(bands), density=np.full(bands, density), scale_height=np.full(bands, height)
        )
    module = Atmosphere(f"air{name}", params)
    graph.craft.out_state.connect(module.in_state)
    graph.turning.out_orientation.connect(module.in_orientation)
    return [module]


def _imu(graph: Graph, name: str) -> list[KernelModule]:
    gyro, accelerometer = Gyro(f"gyro{name}"), Accelerometer(f"accelerometer{name}")
    graph.craft.out_state.connect(gyro.in_state)
    graph.craft.out_state.connect(accelerometer.in_state)
    graph.craft.out_force.connect(accelerometer.in_force)
    return [gyro, accelerometer]


def _tracker(graph: Graph, name: str) -> list[KernelModule]:
    module = StarTracker(f"star_tracker{name}")
    graph.craft.out_state.connect(module.in_state)
    return [module]


def _star_vectors(graph: Graph, name: str) -> list[KernelModule]:
    module = StarVectors(f"stars{name}", _star_params())
    graph.craft.out_state.connect(module.in_state)
    return [module]


def _css(graph: Graph, name: str) -> list[KernelModule]:
    module = CssArray(f"css{name}", CssArray.Params() if graph.noise else CssArray.Params(sigma=0.0, albedo=0.0))
    graph.craft.out_state.connect(module.in_state)
    graph.sun.out_ephemeris.connect(module.in_sun)
    graph.eclipse.out_eclipse.connect(module.in_eclipse)
    return [module]


def _magnetometer(graph: Graph, name: str) -> list[KernelModule]:
    module = Magnetometer(
        f"magnetometer{name}", Magnetometer.Params() if graph.noise else Magnetometer.Params(sigma=0.0)
    )
    graph.craft.out_state.connect(module.in_state)
    graph.field.out_field.connect(module.in_field)
    return [module]


def _nav(graph: Graph, name: str) -> list[KernelModule]:
    module = SimpleNav(f"nav{name}", SimpleNav.Params(sigma_r=1e-3, sigma_v=1e-3, sigma_att=1e-3, sigma_rate=1e-3))
    graph.craft.out_state.connect(module.in_state)
    return [module]


def _gps(graph: Graph, name: str) -> list[KernelModule]:
    module = Gps(f"gps{name}")
    graph.craft.out_state.connect(module.in_state)
    graph.turning.out_orientation.connect(module.in_orientation)
    return [module]


def _ephemeris(_: Graph, name: str) -> list[KernelModule]:
    return [Ephemeris(f"body{name}", _sun_params())]


def _spinning(graph: Graph, name: str) -> list[KernelModule]:
    turn = EarthOrientation(f"turn{name}", earth_rotation(START, assumed_parameters(START, 0.0)))
    return [*_ephemeris(graph, name), turn]


def _nutating(_: Graph, name: str) -> list[KernelModule]:
    return [EarthOrientation(f"turn{name}", _iau_params())]


KINDS: dict[str, Callable[[Graph, str], list[KernelModule]]] = {
    "Gyro and Accelerometer": _imu,
    "StarTracker": _tracker,
    "CssArray, 6 cells": _css,
    "Magnetometer": _magnetometer,
    "SimpleNav": _nav,
    "MagneticField, IGRF-14, degree 13": lambda g, n: [_magnetic_field(g, f"field{n}")],
    "MagneticField, WMM2025, degree 12": lambda g, n: [_magnetic_field(g, f"field{n}", "WMM2025")],
    "DipoleField": lambda g, n: [_dipole(g, f"dipole{n}")],
    "Eclipse": lambda g, n: [_eclipse(g, f"eclipse{n}")],
    "Atmosphere": _atmosphere,
    "Ephemeris": _ephemeris,
    "Ephemeris and EarthOrientation, angle": _spinning,
    "EarthOrientation, IAU 2006/2000A": _nutating,
    "Gps": _gps,
    "StarVectors": _star_vectors,
}
"""Makes and connects one of a kind; its name ends as told."""
