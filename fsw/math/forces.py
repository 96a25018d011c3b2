"""Forces that move a satellite: gravity of the planet, the Sun and the Moon; drag and the pressure of sunlight.

All is read from rows where it is needed: a call passes a few addresses, and what is absent costs nothing.
N: inertial frame at the centre of the planet. E: fixed to the planet.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

from fsw.math.compiled import compiled, inlined
from fsw.math.gravity import (
    gravity_acceleration,
    gravity_potential,
    third_body_acceleration,
    zonal_acceleration,
    zonal_potential,
)
from fsw.math.harmonics import harmonic_acceleration, harmonic_potential
from fsw.math.vectors import V3, add, axpy, cross, dot, mat3, mat_t_vec, matvec, norm, scale, sub, vec3

Row: TypeAlias = Any

ASTRONOMICAL_UNIT = 149597870700.0
"""m (IAU 2012, resolution B2)."""
PRESSURE_1AU = 1361.0 / 299792458.0
"""Pressure of sunlight at 1 au, N/m^2: nominal solar irradiance (IAU 2015, resolution B3) by the speed of light."""


class Scene(NamedTuple):
    """Rows that the forces are computed from; times count from ``time_ns``. An input never written has ``seq`` 0.

    Attributes:
        time_ns: time 0. craft: mass, mu, radius, j2 to j6, degree, C, S, drag_coefficient, drag_area,
            light_coefficient, light_area. orientation: PlanetOrientationMsg. sun: EphemerisMsg. moon: EphemerisMsg.
        air: AtmosphereMsg. eclipse: EclipseMsg.
    """

    time_ns: int
    craft: Row
    orientation: Row
    sun: Row
    moon: Row
    air: Row
    eclipse: Row


@compiled
def turned(a: V3, omega: V3, t: float) -> V3:
    """The vector ``a`` turned at the rate ``omega`` (rad/s) for ``t`` s: Rodrigues' formula."""
    rate = norm(omega)
    if rate == 0.0:
        return a
    axis = scale(1.0 / rate, omega)
    c, s = math.cos(rate * t), math.sin(rate * t)
    return axpy(c, a, axpy(s, cross(axis, a), scale((1.0 - c) * dot(axis, a), axis)))


@compiled
def position_E(r: V3, t: float, scene: Scene) -> V3:
    """E components of a position ``r`` in N; without a message E is N. E turns evenly from the message to ``t`` (s)."""
    turn = scene.orientation
    if turn.seq == 0:
        return r
    age = (scene.time_ns - turn.t_ns) / 1e9 + t
    return matvec(mat3(turn.dcm_EN), turned(r, vec3(turn.omega_EN_N), -age))


@compiled
def full_field_acceleration(r_E: V3, craft: Row) -> V3:
    """As `field_acceleration`, by spherical harmonics or J2 to J6; apart, so that what J2 needs is short."""
    if craft.degree > 0:
        return harmonic_acceleration(r_E, craft.mu, craft.radius, craft.degree, craft.C, craft.S)
    return zonal_acceleration(r_E, craft.mu, craft.radius, (craft.j2, craft.j3, craft.j4, craft.j5, craft.j6))


@compiled
def has_only_j2(craft: Row) -> bool:
    """Whether the field is that of a point mass and J2."""
    return craft.degree == 0 and craft.j3 == 0.0 and craft.j4 == 0.0 and craft.j5 == 0.0 and craft.j6 == 0.0


@inlined
def field_acceleration(r_E: V3, craft: Row) -> V3:
    """Acceleration, m/s^2, of the planet's gravity at ``r_E`` (m), both in E components."""
    if has_only_j2(craft):
        return gravity_acceleration(r_E, craft.mu, craft.radius, craft.j2)
    return full_field_acceleration(r_E, craft)


@compiled
def field_potential(r_E: V3, craft: Row) -> float:
    """Potential energy of a unit mass in the planet's gravity, J/kg, at ``r_E`` (m), E components."""
    if craft.mu == 0.0:
        return 0.0
    if has_only_j2(craft):
        return gravity_potential(r_E, craft.mu, craft.radius, craft.j2)
    if craft.degree > 0:
        return harmonic_potential(r_E, craft.mu, craft.radius, craft.degree, craft.C, craft.S)
    return zonal_potential(r_E, craft.mu, craft.radius, (craft.j2, craft.j3, craft.j4, craft.j5, craft.j6))


@compiled
def body_position(body: Row, t: float, time_ns: int) -> V3:
    """Position, m, of the body of an EphemerisMsg, which moves evenly from the message to ``t`` s after ``time_ns``."""
    return axpy((time_ns - body.t_ns) / 1e9 + t, vec3(body.v_PN_N), vec3(body.r_PN_N))


@compiled
def drag_acceleration(v: V3, air: Row, craft: Row) -> V3:
    """Acceleration, m/s^2, by the air, N components (Vallado eq. 8-28)."""
    wind = sub(v, vec3(air.v_AN_N))
    k = 0.5 * air.density * craft.drag_coefficient * craft.drag_area / craft.mass
    return scale(-k * norm(wind), wind)


@compiled
def light_acceleration(r: V3, sun: V3, eclipse: Row, craft: Row) -> V3:
    """Acceleration, m/s^2, by sunlight on a sphere, N components (Vallado eq. 8-44); full light without a message."""
    d = sub(r, sun)
    d1 = norm(d)
    k = PRESSURE_1AU * craft.light_coefficient * craft.light_area / craft.mass * (ASTRONOMICAL_UNIT / d1) ** 2 / d1
    if eclipse.seq > 0:
        k *= eclipse.illumination
    return scale(k, d)


@compiled
def turned_field(r: V3, t: float, scene: Scene) -> V3:
    """Acceleration, m/s^2, of the planet's gravity at ``r`` (m), both in N; the planet is turned as at ``t`` s."""
    turn = scene.orientation
    age = (scene.time_ns - turn.t_ns) / 1e9 + t
    a = field_acceleration(position_E(r, t, scene), scene.craft)
    return turned(mat_t_vec(mat3(turn.dcm_EN), a), vec3(turn.omega_EN_N), age)


@compiled
def third_bodies(r: V3, t: float, scene: Scene) -> V3:
    """Acceleration, m/s^2, N components, by the Sun and the Moon."""
    a = (0.0, 0.0, 0.0)
    if scene.sun.seq > 0:
        a = third_body_acceleration(r, body_position(scene.sun, t, scene.time_ns), scene.sun.mu)
    if scene.moon.seq > 0:
        a = add(a, third_body_acceleration(r, body_position(scene.moon, t, scene.time_ns), scene.moon.mu))
    return a


@compiled
def gravity(r: V3, t: float, scene: Scene) -> V3:
    """Acceleration, m/s^2, N components, by the planet, the Sun and the Moon, ``t`` s after the time of the scene."""
    a = (0.0, 0.0, 0.0)
    if scene.craft.mu > 0.0:
        a = field_acceleration(r, scene.craft) if scene.orientation.seq == 0 else turned_field(r, t, scene)
    if scene.sun.seq > 0 or scene.moon.seq > 0:
        a = add(a, third_bodies(r, t, scene))
    return a


@compiled
def surface_acceleration(r: V3, v: V3, t: float, scene: Scene) -> V3:
    """Acceleration, m/s^2, N components, by air and light, at ``r`` (m) and ``v`` (m/s)."""
    craft, a = scene.craft, (0.0, 0.0, 0.0)
    if craft.light_area > 0.0 and scene.sun.seq > 0:
        a = light_acceleration(r, body_position(scene.sun, t, scene.time_ns), scene.eclipse, craft)
    if craft.drag_area > 0.0 and scene.air.seq > 0:
        a = add(a, drag_acceleration(v, scene.air, craft))
    return a
