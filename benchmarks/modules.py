"""The truth side by side: orbits, every environment module, every sensor, and all of them together."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks import truth
from benchmarks.case import PERIOD_S
from benchmarks.timing import Figure, Line, figure, interleaved, slope_figure, timed
from fsw import s

ORBIT_BAR, MODULE_BAR, GRAPH_BAR = 1.0 / 20.0, 1.0 / 2.0, 1.0 / 8.0
MANY = 50
"""Instances of a module, less one, whose cost is divided."""
TICKS = 6000 // PERIOD_S
"""About one orbit."""
COUNTERPARTS = {
    "Gyro and Accelerometer": "imuSensor",
    "StarTracker": "starTracker",
    "CssArray, 6 cells": "6 coarseSunSensor, CSSConstellation",
    "Magnetometer": "magnetometer",
    "SimpleNav": "simpleNav",
    "MagneticField, IGRF-14, degree 13": "magneticFieldWMM, degree 12",
    "MagneticField, WMM2025, degree 12": "magneticFieldWMM",
    "DipoleField": "magneticFieldCenteredDipole",
    "Eclipse": "eclipse",
    "Atmosphere": "exponentialAtmosphere",
    "Ephemeris": "planetEphemeris",
    "Ephemeris and EarthOrientation, angle": "planetEphemeris with rotation",
}
"""The module of Basilisk for each kind of `benchmarks.truth.KINDS` that has one."""
COMPARED = {
    "Magnetometer": ("B_S", "T"),
    "CssArray, 6 cells": ("signal", "of full sunlight"),
    "MagneticField, WMM2025, degree 12": ("B_N", "T"),
    "DipoleField": ("B_N", "T"),
    "Eclipse": ("illumination", "of the Sun's disk"),
    "Atmosphere": ("density", "kg/m^3"),
}
"""Field of the message and unit for the kinds that should give the same without noise."""


class Difference(msgspec.Struct, frozen=True):
    """How far both sides are apart over one orbit.

    Attributes:
        name: what was compared. largest: difference of any component at any tick. size: largest value of any.
        unit: of both.
    """

    name: str
    largest: float
    size: float
    unit: str


def agreement(scale: float = 1.0) -> list[Difference]:
    """Compare what should be the same over an orbit, in ticks of 3 s (the orbits themselves: 1 s).

    Args:
        scale: part of the orbit that is flown.
    """
    from benchmarks import basilisk_truth

    case = msgspec.structs.replace(truth.orbit_case(period_ns=s(PERIOD_S)), j2=0.0)  # the same to the last bit
    sky, ticks = truth.sky(), max(int(TICKS * scale), 10)
    found: list[Difference] = []

    def add(name: str, own: NDArray[np.float64], other: NDArray[np.float64], unit: str) -> None:
        largest, size = float(np.max(np.abs(own - other))), float(np.max(np.abs(own)))
        found.append(Difference(name, largest, size, unit))

    for degree in (0, 50):
        orbit = truth.orbit_case(degree, s(1))
        sides = truth.Orbit(orbit), basilisk_truth.Orbit(orbit)
        for side in sides:
            side.run(ticks * PERIOD_S)
        own, other = (side.position() for side in sides)
        add(f"position after an orbit, {f'degree {degree}' if degree else 'J2'}", own, other, "m")
    for kind, (column, unit) in COMPARED.items():
        theirs = basilisk_truth.Theirs(case, sky, kind, 1, noise=False, record=True)
        own = truth.Ours(case, kind, 1, noise=False).history(column, ticks).reshape(ticks, -1)
        other = theirs.history(ticks).reshape(ticks, -1)
        add(kind, own, other[:, : own.shape[1]], unit)
    return found


def _running(run: Callable[[int], object], ticks: int) -> Callable[[], float]:
    """A case that goes on where it stopped; what comes before the first tick does not count."""
    run(10)
    return lambda: timed(run, ticks) / 1e3


def _orbits(repeats: int, scale: float, *, basilisk: bool) -> list[Line]:
    """Spacecraft with J2, the same with degree 50, and the whole sensor graph; microseconds a tick of 0.1 s."""
    small, large = truth.orbit_case(), truth.orbit_case(50)

    def ticks(count: int) -> int:
        return max(int(count * scale), 10)

    cases: dict[str, Callable[[], float]] = {
        "J2": _running(truth.Orbit(small).run, ticks(50_000)),
        "50": _running(truth.Orbit(large).run, ticks(2_000)),
        "whole": _running(truth.Whole(small).run, ticks(20_000)),
    }
    if basilisk:
        from benchmarks import basilisk_truth

        cases["their J2"] = _running(basilisk_truth.Orbit(small).run, ticks(10_000))
        cases["their 50"] = _running(basilisk_truth.Orbit(large).run, ticks(1_000))
        cases["their whole"] = _running(basilisk_truth.Whole(small, truth.sky()).run, ticks(5_000))
    found = {name: figure(values) for name, values in interleaved(cases, repeats).items()}
    names = {
        "J2": ("Spacecraft, J2 / spacecraft", ORBIT_BAR),
        "50": ("Spacecraft, EGM2008 to degree 50 / spacecraft", MODULE_BAR),
        "whole": ("whole sensor graph", GRAPH_BAR),
    }
    return [judged(name, found[key], found.get(f"their {key}"), bar) for key, (name, bar) in names.items()]


def judged(name: str, own: Figure, other: Figure | None, bar: float) -> Line:
    """A line whose rule is a ratio of times; without the other side it has none."""
    if other is None:
        return Line(name, "µs", own, None)
    return Line(name, "µs", own, other, f"at least {1.0 / bar:g} times faster", own.least / other.least, bar)


def _single(repeats: int, scale: float, *, basilisk: bool) -> list[Line]:
    """One more module of each kind: the slope between one and many, which all read the same spacecraft."""
    case, ticks = truth.orbit_case(period_ns=s(PERIOD_S)), max(int(TICKS * scale), 10)
    sky = truth.sky() if basilisk else None
    lines: list[Line] = []
    for kind in truth.KINDS:  # one kind after the other, so that few graphs are in memory at once
        cases = {str(n): _running(truth.Ours(case, kind, n).run, 4 * ticks) for n in (1, MANY)}
        there = COUNTERPARTS.get(kind)
        if sky and there:
            from benchmarks import basilisk_truth

            for n in (1, MANY):
                cases[f"their {n}"] = _running(basilisk_truth.Theirs(case, sky, kind, n).run, ticks)
        samples = interleaved(cases, repeats)
        own, *other = (
            slope_figure(samples[f"{side}{MANY}"], samples[f"{side}1"], MANY - 1)
            for side in ("", "their ")
            if f"{side}1" in samples
        )
        name = f"{kind} / {there}" if there else f"{kind} / no counterpart"
        lines.append(judged(name, own, other[0] if other else None, MODULE_BAR))
    return lines


def measure(repeats: int = 7, scale: float = 1.0, *, basilisk: bool = True) -> list[Line]:
    """Time everything.

    Args:
        repeats: how often. scale: of the number of ticks, below 1 for a trial. basilisk: measure that side too.
    """
    return [*_orbits(repeats, scale, basilisk=basilisk), *_single(repeats, scale, basilisk=basilisk)]
