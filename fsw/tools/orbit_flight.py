"""The flight of a satellite of the Earth, for the fit of an orbit: a compiled module with all its tables as parameters.

The forces are those that the simulated spacecraft feels too: spherical harmonics, Sun and Moon, drag in an exponential
atmosphere that turns with the Earth, or pressure of sunlight with the Earth's shadow.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import erfa
import numpy as np

from fsw.math.atmosphere import EARTH_BANDS
from fsw.math.compiled import compiled
from fsw.math.earth_orientation import COLUMNS, ROWS, EarthParameters, orientation, orientation_table
from fsw.math.eclipse import visible_fraction
from fsw.math.epoch import SECOND, julian_dates
from fsw.math.forces import ASTRONOMICAL_UNIT, PRESSURE_1AU
from fsw.math.gravity import third_body_acceleration
from fsw.math.harmonics import SIZE, GravityField, harmonic_acceleration
from fsw.math.integrators import DENSE, STAGES, dop853_dense, dop853_error, dop853_factor, dop853_step, dop853_value
from fsw.math.vectors import V3, add, axpy, cross, mat_t_vec, matvec, norm, scale, store3, sub, vec3
from fsw.module import KernelModule, Row
from messages.base import F64, I64, Bound, Record, Shape, zeros

ERFA: Any = erfa
DAYS = 32
"""Longest arc, days."""
HOURS = 24 * DAYS + 2
"""Rows of the tables of Sun and Moon, one an hour."""
BATCH = 64
"""Times in one step."""
NO_TIMES = np.zeros(BATCH, np.int64)
NO_TIMES.setflags(write=False)
_HOUR = 3600.0
_EQUATOR, _POLE = 6378137.0, 6356752.314245
_SUN_RADIUS, _EARTH_RADIUS = 695700.0e3, 6371008.4
_MU_SUN, _MU_MOON = 1.32712440041279e20, 4.902800118e12  # DE440
_ERROR_R, _ERROR_V = 1e-5, 1e-8  # of a step, m and m/s


@compiled
def position_at(table: F64, t: float) -> V3:
    """Position (m) at ``t`` seconds from rows of position and velocity (m, m/s), one an hour: cubic Hermite."""
    row = min(max(int(t / _HOUR), 0), table.shape[0] - 2)
    u = t / _HOUR - row
    a, b = vec3(table[row, 0:3]), vec3(table[row + 1, 0:3])
    slope_a, slope_b = scale(_HOUR, vec3(table[row, 3:6])), scale(_HOUR, vec3(table[row + 1, 3:6]))
    change = axpy(u * u * (3.0 - 2.0 * u), sub(b, a), scale(u * (1.0 - u) * (1.0 - u), slope_a))
    return add(a, axpy(u * u * (u - 1.0), slope_b, change))


@compiled
def surface_force(r: V3, v: V3, r_E: V3, omega_N: V3, r_sun: V3, params: Row) -> V3:
    """Acceleration (m/s^2, GCRF) by drag or by sunlight."""
    a = (0.0, 0.0, 0.0)
    if params.drag != 0.0:
        across, along = math.sqrt(r_E[0] * r_E[0] + r_E[1] * r_E[1]), r_E[2]
        distance = math.sqrt(across * across + along * along)
        # the radius of the ellipsoid below; the height differs from the geodetic one by metres
        c, s = across / (_EQUATOR * distance), along / (_POLE * distance)
        height = distance - 1.0 / math.sqrt(c * c + s * s)
        density = params.density * math.exp((params.height - height) / params.scale_height)
        wind = sub(v, cross(omega_N, r))
        a = scale(-0.5 * density * params.drag * norm(wind), wind)
    if params.light != 0.0:
        d = sub(r, r_sun)
        d1 = norm(d)
        visible = visible_fraction(scale(-1.0, d), _SUN_RADIUS, scale(-1.0, r), _EARTH_RADIUS)
        k = visible * params.light * PRESSURE_1AU * (ASTRONOMICAL_UNIT / d1) * (ASTRONOMICAL_UNIT / d1) / d1
        a = axpy(k, d, a)
    return a


@compiled
def slope(t: float, y: F64, out: F64, params: Row) -> None:
    """Derivative of position (m) and velocity (m/s), GCRF, ``t`` seconds after the start."""
    r, v = vec3(y[0:3]), vec3(y[3:6])
    epoch_ns = params.start_ns + round(t * 1e9)
    dcm_EN, omega_N = orientation(epoch_ns, params.orientation_ns, params.orientation_rows, params.orientation)
    r_E, r_sun = matvec(dcm_EN, r), position_at(params.sun, t)
    a = mat_t_vec(dcm_EN, harmonic_acceleration(r_E, params.mu, params.radius, params.degree, params.C, params.S))
    a = add(a, third_body_acceleration(r, r_sun, _MU_SUN))
    a = add(a, third_body_acceleration(r, position_at(params.moon, t), _MU_MOON))
    store3(out[0:3], v)
    store3(out[3:6], add(a, surface_force(r, v, r_E, omega_N, r_sun, params)))


class Flight(KernelModule):
    """Position and velocity by the method of Dormand and Prince 8(5,3), read from its dense output.

    A step leaves the motion at the times ``state.times_ns`` after the start in ``state.motion``; they ascend, from step
    to step too. The motion is NaN if it cannot be integrated.
    """

    class Params(Record):
        """The forces; time 0 is ``start_ns``."""

        start_ns: Annotated[int, "ns", "epoch of time 0, TAI since 2000-01-01T12:00:00 TAI"]
        end_s: Annotated[float, "s", "no step goes beyond this time", Bound(gt=0, le=DAYS * 86400.0)]
        orientation_ns: Annotated[int, "ns", "epoch of the first row of orientation"]
        orientation_rows: Annotated[int, "-", "its rows in use", Bound(ge=2)]
        orientation: Annotated[F64, Shape(ROWS, COLUMNS), "-", "as orientation_table gives"]
        sun: Annotated[F64, Shape(HOURS, 6), "m, m/s", "position and velocity of the Sun, GCRF, one row an hour"]
        moon: Annotated[F64, Shape(HOURS, 6), "m, m/s", "likewise of the Moon"]
        mu: Annotated[float, "m^3/s^2", "gravitational parameter", Bound(gt=0)]
        radius: Annotated[float, "m", "reference radius of the coefficients", Bound(gt=0)]
        degree: Annotated[int, "-", "of the spherical harmonics", Bound(ge=2, lt=SIZE)]
        C: Annotated[F64, Shape(SIZE, SIZE), "-", "normalised cosine coefficients"]
        S: Annotated[F64, Shape(SIZE, SIZE), "-", "normalised sine coefficients"]
        density: Annotated[float, "kg/m^3", "of the air at height", Bound(ge=0)]
        height: Annotated[float, "m", "above the ellipsoid"]
        scale_height: Annotated[float, "m", "by which the density falls to 1/e", Bound(gt=0)]
        drag: Annotated[float, "m^2/kg", "drag coefficient times area by mass"] = 0.0
        light: Annotated[float, "m^2/kg", "radiation pressure coefficient times area by mass"] = 0.0

    class State(Record):
        """The motion and the last step."""

        end: Annotated[F64, Shape(6), "m, m/s", "position and velocity at the end of the last step"]
        times_ns: Annotated[I64, Shape(BATCH), "ns", "times asked for"] = NO_TIMES
        motion: Annotated[F64, Shape(BATCH, 6), "m, m/s", "position and velocity then"] = zeros(BATCH, 6)
        from_s: Annotated[float, "s", "start of the last step"] = 0.0
        step_s: Annotated[float, "s", "its length"] = 0.0
        next_s: Annotated[float, "s", "length to try next"] = 10.0
        start: Annotated[F64, Shape(6), "m, m/s", "position and velocity at its start"] = zeros(6)
        limits: Annotated[F64, Shape(6), "m, m/s", "errors allowed in a step"] = zeros(6)
        stages: Annotated[F64, Shape(STAGES, 6), "-", "its stages"] = zeros(STAGES, 6)
        dense: Annotated[F64, Shape(DENSE, 6), "-", "its dense output"] = zeros(DENSE, 6)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row) -> None:
        """Take steps until one reaches each time, and read the motion there."""
        for i in range(3):
            state.limits[i], state.limits[3 + i] = _ERROR_R, _ERROR_V
        for k in range(BATCH):
            wanted = state.times_ns[k] / 1e9
            while state.step_s == 0.0 or state.from_s + state.step_s < wanted - 1e-9:
                t = state.from_s + state.step_s
                h = min(state.next_s, params.end_s - t)
                state.start[:] = state.end
                slope(t, state.start, state.stages[0], params)
                dop853_step(slope, t, h, state.start, state.stages, state.end, params)
                error = dop853_error(h, state.stages, state.limits)
                if error <= 1.0:
                    dop853_dense(slope, t, h, state.start, state.stages, state.end, state.dense, params)
                    state.from_s, state.step_s = t, h
                    state.next_s = h * dop853_factor(error)
                else:
                    state.end[:] = state.start
                    state.next_s = h * min(dop853_factor(error), 0.9)
                    if not state.next_s > 1e-6:
                        state.motion[:] = math.nan
                        return
            dop853_value(state.dense, (wanted - state.from_s) / state.step_s, state.motion[k])


def flight_params(
    start_ns: int, duration_s: float, height: float, eop: EarthParameters, field: GravityField
) -> Flight.Params:
    """The tables for a time, without drag and light.

    Args:
        start_ns: epoch of time 0, TAI ns since 2000-01-01T12:00:00 TAI. duration_s: how long after it, s.
        height: at which the air is to be right, m; above and below it the density is exponential.
        eop: orientation of the Earth. field: its gravity.

    Raises:
        ValueError: if the time is longer than `DAYS`, or not covered by ``eop``.
    """
    if not 0.0 < duration_s <= DAYS * 86400.0:
        raise ValueError(f"the arc: expected at most {DAYS} days, got {duration_s / 86400.0:.1f}; cut it with --arc")
    first, rows, table = orientation_table(start_ns, math.ceil(duration_s * 1e9), eop)
    whole, rest = julian_dates(start_ns + 3600 * SECOND * np.arange(HOURS))
    sun, moon = (np.concatenate([b["p"], b["v"] / 86400.0], axis=1) * ASTRONOMICAL_UNIT for b in _sun_moon(whole, rest))
    base, density, scale_height = EARTH_BANDS[np.searchsorted(EARTH_BANDS[1:, 0], height / 1e3)] * (1e3, 1.0, 1e3)
    return Flight.Params(
        start_ns=start_ns,
        end_s=duration_s,
        orientation_ns=first,
        orientation_rows=rows,
        orientation=table,
        sun=sun,
        moon=moon,
        mu=field.mu,
        radius=field.radius,
        degree=field.degree,
        C=field.C,
        S=field.S,
        density=float(density),
        height=float(base),
        scale_height=float(scale_height),
    )


def _sun_moon(whole: F64, rest: F64) -> tuple[Any, Any]:
    """Positions and velocities relative to the Earth as ERFA gives them, au and au a day."""
    sun = ERFA.epv00(whole, rest)[0].copy()
    sun["p"], sun["v"] = -sun["p"], -sun["v"]
    return sun, ERFA.moon98(whole, rest)


def fly(params: Flight.Params, start: F64, epoch_ns: list[int]) -> F64:
    """Positions and velocities (n, 6), m and m/s in GCRF, at ascending epochs from the state ``start`` (6,).

    Raises:
        ValueError: if the motion cannot be integrated: it meets the centre of the Earth, or leaves the tables.
    """
    flight = Flight("flight", params, Flight.State(end=start))
    out, since = np.empty((len(epoch_ns), 6)), np.array(epoch_ns) - params.start_ns
    for first in range(0, len(out), BATCH):
        count = min(BATCH, len(out) - first)
        flight.state.times_ns[:count] = since[first : first + count]
        flight.state.times_ns[count:] = since[-1]
        flight.step(0)
        out[first : first + count] = flight.state.motion[:count]
    if not np.all(np.isfinite(out)):
        raise ValueError("the orbit cannot be followed: it meets the Earth's centre; choose a shorter arc")
    return out
