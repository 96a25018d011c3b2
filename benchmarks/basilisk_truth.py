"""Basilisk's side of `benchmarks.truth`: the same graph, and the counterpart of each kind of module."""

# pyright: basic, reportMissingImports=false
# Basilisk has no types, and is installed by ``make bench`` only

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.basilisk import add_noise, earth, new_simulation
from benchmarks.case import FAST, SLOW, STARS, Case, Sky

NORMALS_B = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
MS = 1_000_000


def _new(module: str, kind: str) -> Any:
    """An object of a class of Basilisk's simulation package."""
    return getattr(importlib.import_module(f"Basilisk.simulation.{module}"), kind)()


def _spacecraft(case: Case) -> tuple[Any, Any]:
    craft = _new("spacecraft", "Spacecraft")
    craft.hub.mHub = case.mass
    craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    craft.hub.IHubPntBc_B = case.inertia_B.tolist()
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = case.r_BN_N, case.v_BN_N
    craft.hub.sigma_BNInit, craft.hub.omega_BN_BInit = case.sigma_BN, case.omega_BN_B
    return craft, earth(craft, case)


class Graph:
    """A spacecraft among a still Earth, Sun and shadow, and a magnetic field; subclasses put them into tasks.

    Args:
        case: of the spacecraft. sky: around it. noise: of the sensors. model: the field is WMM2025, not a dipole.
    """

    def __init__(self, case: Case, sky: Sky, *, noise: bool = True, model: bool = False) -> None:
        from Basilisk.architecture import messaging

        self.period_ns, self.sky, self.noise, self.end, self._names = case.period_ns, sky, noise, 0, 0
        self.sim = new_simulation(case.period_ns)
        self.craft, self._bodies = _spacecraft(case)
        still: Any = messaging.SpicePlanetStateMsgPayload(J20002Pfix=np.eye(3).tolist())
        still.PlanetName = "earth"
        self.earth = messaging.SpicePlanetStateMsg().write(still)
        self._keep: list[Any] = [self.earth]
        self.sun = sun(self)[0]
        self.eclipse, self.field = eclipse(self)[0], (field if model else dipole)(self)[0]

    def task(self, name: str, period_ns: int, modules: list[Any], priority: int = -1) -> None:
        """Make a task of some modules; those of higher priority run first, then those made first."""
        self.sim.procList[0].addTask(self.sim.CreateNewTask(name, period_ns), priority)
        self.add(name, modules)

    def add(self, task: str, modules: list[Any]) -> None:
        """Name modules and put them into a task."""
        for module in modules:
            self._names += 1
            module.ModelTag = f"m{self._names}"
            self.sim.AddModelToTask(task, module)
            self._keep.append(module)

    def keep(self, module: Any) -> Any:
        """Hold a module that another one refers to; a sensor gets its noise, if that is asked for."""
        self._keep.append(module)
        if self.noise:
            add_noise(module)
        return module

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods; the instant 0 comes with the first."""
        self.end += ticks * self.period_ns
        self.sim.ConfigureStopTime(self.end)
        self.sim.ExecuteSimulation()


class Theirs(Graph):
    """Modules of one kind, all run at each tick; the Sun stands still.

    Args:
        case: of the spacecraft. sky: around it. kind: of the modules, a key of `KINDS`. count: how many.
        noise: of the sensors. record: what the last module gives at each tick.
    """

    def __init__(
        self, case: Case, sky: Sky, kind: str, count: int, *, noise: bool = True, record: bool = False
    ) -> None:
        super().__init__(case, sky, noise=noise)
        self.task("once", 2**62, [self.sun], priority=1)
        made = [KINDS[kind](self) for _ in range(count)]
        self.add("t", [self.craft, self.eclipse, self.field, *(module for module, _, _ in made)])
        _, output, self.column = made[-1]
        if record:
            self.recorder = output.recorder()
            self.add("t", [self.recorder])
        self.sim.InitializeSimulation()

    def history(self, ticks: int) -> NDArray[np.float64]:
        """What the last module gave at each tick; it must have been recorded."""
        self.run(ticks)
        return np.array(getattr(self.recorder, self.column))[:ticks]


class Whole(Graph):
    """The whole sensor graph at its rates."""

    def __init__(self, case: Case, sky: Sky) -> None:
        super().__init__(case, sky, model=True)
        self.task("truth", FAST * MS, [self.craft])
        self.task("sky", SLOW * MS, [self.sun, self.eclipse, atmosphere(self)[0], self.field])
        self.task("inertial", FAST * MS, [imu(self)[0]])
        self.task("stars", STARS * MS, [tracker(self)[0]])
        self.task("slow", SLOW * MS, [make(self)[0] for make in (magnetometer, css, nav)])
        self.sim.InitializeSimulation()


class Orbit:
    """The spacecraft alone."""

    def __init__(self, case: Case) -> None:
        self.period_ns, self.end = case.period_ns, 0
        self.sim = new_simulation(case.period_ns)
        self.craft, self._bodies = _spacecraft(case)
        self.craft.ModelTag = "craft"
        self.sim.AddModelToTask("t", self.craft)
        self.sim.InitializeSimulation()

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods; the instant 0 comes with the first."""
        self.end += ticks * self.period_ns
        self.sim.ConfigureStopTime(self.end)
        self.sim.ExecuteSimulation()

    def position(self) -> NDArray[np.float64]:
        """Newest position, N components, m."""
        return np.array(self.craft.scStateOutMsg.read().r_BN_N)


Made = tuple[Any, Any, str]
"""A module, the message to compare, and its field."""


def sun(graph: Graph) -> Made:
    """The Sun on the ellipse about the Earth that it is on at time zero."""
    return _planet(graph, rotation=False)


def spinning(graph: Graph) -> Made:
    """The same, which also turns about its axis."""
    return _planet(graph, rotation=True)


def _planet(graph: Graph, *, rotation: bool) -> Made:
    from Basilisk.simulation import planetEphemeris

    module = graph.keep(planetEphemeris.PlanetEphemeris())
    module.setPlanetNames(planetEphemeris.StringVector(["sun"]))
    orbit = planetEphemeris.ClassicElements()
    orbit.a, orbit.e, orbit.i, orbit.Omega, orbit.omega, orbit.f = graph.sky.sun_elements
    module.planetElements = planetEphemeris.classicElementVector([orbit])
    if rotation:
        module.rightAscension = planetEphemeris.DoubleVector([0.0])
        module.declination = planetEphemeris.DoubleVector([1.5])
        module.lst0 = planetEphemeris.DoubleVector([0.0])
        module.rotRate = planetEphemeris.DoubleVector([7.29e-5])
    return module, module.planetOutMsgs[0], "PositionVector"


def eclipse(graph: Graph) -> Made:
    """Past the Earth alone."""
    module = graph.keep(_new("eclipse", "Eclipse"))
    module.sunInMsg.subscribeTo(graph.sun.planetOutMsgs[0])
    module.addPlanetToModel(graph.earth)
    module.addSpacecraftToModel(graph.craft.scStateOutMsg)
    return module, module.eclipseOutMsgs[0], "illuminationFactor"


def _environment(graph: Graph, module: Any) -> Any:
    module.addSpacecraftToModel(graph.craft.scStateOutMsg)
    module.planetPosInMsg.subscribeTo(graph.earth)
    return graph.keep(module)


def dipole(graph: Graph) -> Made:
    """Centred dipole."""
    module = _environment(graph, _new("magneticFieldCenteredDipole", "MagneticFieldCenteredDipole"))
    module.g10, module.g11, module.h11 = graph.sky.dipole
    module.planetRadius = graph.sky.field_radius
    return module, module.envOutMsgs[0], "magField_N"


def field(graph: Graph) -> Made:
    """World Magnetic Model, degree 12."""
    module = _new("magneticFieldWMM", "MagneticFieldWMM")
    module.configureWMMFile(graph.sky.wmm_file)
    module.epochDateFractionalYear = graph.sky.year
    _environment(graph, module)
    return module, module.envOutMsgs[0], "magField_N"


def atmosphere(graph: Graph) -> Made:
    """One exponential above a sphere."""
    module = _environment(graph, _new("exponentialAtmosphere", "ExponentialAtmosphere"))
    module.baseDensity, module.scaleHeight = graph.sky.air
    module.planetRadius = graph.sky.earth_radius
    return module, module.envOutMsgs[0], "neutralDensity"


def imu(graph: Graph) -> Made:
    """Rate and acceleration in one."""
    module = graph.keep(_new("imuSensor", "ImuSensor"))
    module.scStateInMsg.subscribeTo(graph.craft.scStateOutMsg)
    return module, module.sensorOutMsg, "AngVelPlatform"


def tracker(graph: Graph) -> Made:
    """Star tracker."""
    module = graph.keep(_new("starTracker", "StarTracker"))
    module.scStateInMsg.subscribeTo(graph.craft.scStateOutMsg)
    return module, module.sensorOutMsg, "qInrtl2Case"


def css(graph: Graph) -> Made:
    """Six cells, called by a constellation."""
    group = graph.keep(_new("coarseSunSensor", "CSSConstellation"))
    cells = [graph.keep(_new("coarseSunSensor", "CoarseSunSensor")) for _ in NORMALS_B]
    for cell, normal_B in zip(cells, NORMALS_B, strict=True):
        cell.fov, cell.nHat_B = 80.0 * np.pi / 180.0, normal_B
        cell.stateInMsg.subscribeTo(graph.craft.scStateOutMsg)
        cell.sunInMsg.subscribeTo(graph.sun.planetOutMsgs[0])
        cell.sunEclipseInMsg.subscribeTo(graph.eclipse.eclipseOutMsgs[0])
        group.appendCSS(cell)
    return group, group.constellationOutMsg, "CosValue"


def magnetometer(graph: Graph) -> Made:
    """Three axes, reading the field of the graph."""
    module = graph.keep(_new("magnetometer", "Magnetometer"))
    module.stateInMsg.subscribeTo(graph.craft.scStateOutMsg)
    module.magInMsg.subscribeTo(graph.field.envOutMsgs[0])
    return module, module.tamDataOutMsg, "tam_S"


def nav(graph: Graph) -> Made:
    """Navigation stand-in."""
    module = graph.keep(_new("simpleNav", "SimpleNav"))
    module.scStateInMsg.subscribeTo(graph.craft.scStateOutMsg)
    return module, module.transOutMsg, "r_BN_N"


KINDS: dict[str, Callable[[Graph], Made]] = {
    "Gyro and Accelerometer": imu,
    "StarTracker": tracker,
    "CssArray, 6 cells": css,
    "Magnetometer": magnetometer,
    "SimpleNav": nav,
    "MagneticField, IGRF-14, degree 13": field,
    "MagneticField, WMM2025, degree 12": field,
    "DipoleField": dipole,
    "Eclipse": eclipse,
    "Atmosphere": atmosphere,
    "Ephemeris": sun,
    "Ephemeris and EarthOrientation, angle": spinning,
}
"""The counterpart of each kind of `benchmarks.truth`; Gps, StarVectors and exact Earth orientation have none."""
