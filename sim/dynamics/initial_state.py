"""Initial states and planets of a spacecraft, from what a person knows of an orbit; for the set-up of a scenario.

Attitude is given by roll, pitch and yaw (3-2-1: yaw first) of the body relative to the orbit frame O (x along the
track, z to nadir), and by the rate relative to O: ``omega_BN_B = omega_BO_B + dcm_BO omega_ON_O``. Angles are in rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import erfa
import numpy as np
from sgp4.api import SGP4_ERRORS, Satrec

from fsw.math import epoch as time
from fsw.math import euler, geodesy, kepler, local_frames
from fsw.math.attitude import dcm_to_mrp, ep_to_dcm
from fsw.math.bodies import Body, body
from fsw.math.compiled import plain
from fsw.math.harmonics import GravityField
from fsw.math.vectors import V3, V4, matmul, matvec, transpose
from messages.base import F64
from sim.dynamics.spacecraft import Spacecraft

ERFA: Any = erfa
SATREC: Any = Satrec
SGP4_WORDS: Any = SGP4_ERRORS
TLE_DAYS = 60.0
"""Two-line elements are refused farther from their epoch: SGP4 is then wrong by more than an orbit's size."""
TROPICAL_YEAR = 365.2421897 * 86400.0
"""s."""
_LEVEL = (0.0, 0.0, 0.0)
_AT_POLE = 1e-6
"""Nearer to the axis of the Earth, m, there is no east."""


def planet_params(planet: int | str) -> dict[str, Any]:
    """Parameters of `Spacecraft` for a central body of `fsw.math.bodies`; N has its z axis along the body's pole.

    Raises:
        ValueError: if the body is unknown.
    """
    b = body(planet)
    zonals = dict(zip(("j2", "j3", "j4", "j5", "j6"), (float(j) for j in b.zonals), strict=True))
    sizes = {"surface_radius": b.radius, "flattening": b.flattening}
    return {"mu": b.mu, "radius": b.field_radius, **zonals, **sizes}


def field_params(field: GravityField, degree: int | None = None) -> dict[str, Any]:
    """Parameters of `Spacecraft` for spherical harmonics up to ``degree`` (None: all that the field holds).

    Raises:
        ValueError: if the field has no such degree.
    """
    wanted = field.degree if degree is None else degree
    if not 2 <= wanted <= field.degree:
        raise ValueError(f"degree: expected 2 to {field.degree}, which {field.name} holds here, got {degree}")
    return {"mu": field.mu, "radius": field.radius, "degree": wanted, "C": field.C, "S": field.S}


def _vector(value: Sequence[float] | F64, name: str) -> V3:
    if len(value) != 3 or not all(math.isfinite(x) for x in value):
        raise ValueError(f"{name}: expected three finite numbers, got {value}")
    return (float(value[0]), float(value[1]), float(value[2]))


def _unit_ep(beta: Sequence[float] | F64) -> V4:
    length = math.sqrt(sum(x * x for x in beta))
    if len(beta) != 4 or not abs(length - 1.0) <= 1e-9:
        raise ValueError(
            f"beta_BN: expected four numbers, scalar first, of length 1, got {beta} of length {length:.9g}"
        )
    return float(beta[0]), float(beta[1]), float(beta[2]), float(beta[3])


def _require_orbit(r: V3, v: V3, planet: Body) -> None:
    """Refuse an orbit that meets the planet: ellipses anywhere, open orbits from ``r`` on."""
    h = np.cross(r, v)
    h1, r1 = float(np.linalg.norm(h)), float(np.linalg.norm(r))
    if not h1 > kepler.PARALLEL * r1 * float(np.linalg.norm(v)):
        raise ValueError("r_N, v_N: expected an orbit, got a fall: position and velocity are parallel or zero")
    a, e, *_ = plain(kepler.rv_to_elements)(r, v, planet.mu)
    x = np.cross(v, h) / planet.mu - np.array(r) / r1
    x = x / e if e > kepler.SMALL else np.array(r) / r1
    y = np.cross(h, x) / h1
    here = math.atan2(float(r @ y), float(r @ x))
    first, last = (-math.pi, math.pi) if e < 1.0 else (here, max(0.0, here))
    f = np.append(np.linspace(first, last, 1441), min(max(first, 0.0), last))
    places = (h1**2 / planet.mu / (1.0 + e * np.cos(f)))[:, None] * (np.cos(f)[:, None] * x + np.sin(f)[:, None] * y)
    below = np.linalg.norm(places / [1.0, 1.0, 1.0 - planet.flattening], axis=1) < planet.radius
    if np.any(below):
        lowest = float(np.linalg.norm(places[below], axis=1).min()) / 1e3
        text = f"the orbit (a = {a / 1e3:.1f} km, e = {e:.4f}) goes down to {lowest:.1f} km from the centre"
        size = planet.radius / 1e3
        raise ValueError(f"{text}, through {planet.name}, whose radius is {size:.1f} km; choose a higher one")


def from_rv(
    r_N: Sequence[float] | F64,
    v_N: Sequence[float] | F64,
    *,
    roll_pitch_yaw: Sequence[float] | F64 = _LEVEL,
    omega_BO_B: Sequence[float] | F64 = _LEVEL,
    beta_BN: Sequence[float] | F64 | None = None,
    omega_BN_B: Sequence[float] | F64 | None = None,
    planet: int | str = "Earth",
) -> Spacecraft.State:
    """Initial state from position (m) and inertial velocity (m/s), N components.

    Args:
        r_N, v_N: (3,). roll_pitch_yaw: attitude relative to O, rad. omega_BO_B: rate relative to O, rad/s.
        beta_BN: (4,) inertial attitude instead, unit Euler parameters, scalar first. omega_BN_B: inertial rate instead.
        planet: name or NAIF identifier, for the check that the orbit does not meet it.

    Raises:
        ValueError: if the orbit meets the planet or is none, a number is not finite, or ``beta_BN`` is not of length 1.
    """
    r, v = _vector(r_N, "r_N"), _vector(v_N, "v_N")
    _require_orbit(r, v, body(planet))
    roll, pitch, yaw = _vector(roll_pitch_yaw, "roll_pitch_yaw")
    dcm_BO = plain(euler.euler_to_dcm)(321, (yaw, pitch, roll))
    dcm_ON = plain(local_frames.orbit_frame)(r, v)
    dcm_BN = plain(matmul)(dcm_BO, dcm_ON)
    if beta_BN is not None:
        dcm_BN = plain(ep_to_dcm)(_unit_ep(beta_BN))
        dcm_BO = plain(matmul)(dcm_BN, plain(transpose)(dcm_ON))
    turning = plain(matvec)(dcm_BO, plain(local_frames.orbit_rate)(r, v))
    omega = np.array(_vector(omega_BO_B, "omega_BO_B")) + np.array(turning)
    if omega_BN_B is not None:
        omega = np.array(_vector(omega_BN_B, "omega_BN_B"))
    sigma = np.array(plain(dcm_to_mrp)(dcm_BN))
    return Spacecraft.State(r_BN_N=np.array(r), v_BN_N=np.array(v), sigma_BN=sigma, omega_BN_B=omega)


def from_elements(
    a: float, e: float, i: float, Omega: float, omega: float, f: float, *, planet: int | str = "Earth", **attitude: Any
) -> Spacecraft.State:
    """Initial state from osculating elements: semi-major axis (m, negative for hyperbolas), eccentricity, angles (rad).

    Args:
        a, e, i, Omega, omega, f: as in `fsw.math.kepler`, f is the true anomaly. planet: name or NAIF identifier.
        attitude: the other arguments of `from_rv`.

    Raises:
        ValueError: if the elements are of no orbit, or of one through the planet.
    """
    r, v = plain(kepler.elements_to_rv)((a, e, i, Omega, omega, f), body(planet).mu)
    if not all(math.isfinite(x) for x in (*r, *v)):
        raise ValueError(f"elements: there is no orbit with a = {a} m, e = {e}, f = {f} rad; check signs and units")
    return from_rv(r, v, planet=planet, **attitude)


def sun_synchronous(
    height: float, local_time: float, epoch_ns: int, *, e: float = 0.0, omega: float = 0.0, f: float = 0.0
) -> tuple[float, float, float, float, float, float]:
    """Elements of a Sun-synchronous orbit of the Earth, for `from_elements`.

    J2 turns the plane once in a tropical year: ``cos i = -2/3 (p/R)^2 rate / (n J2)`` (Vallado, 4th ed., sec. 11.4.1).

    Args:
        height: semi-major axis above the equatorial radius, m. local_time: mean solar time of the ascending node, h.
        epoch_ns: of the elements, TAI ns since 2000-01-01T12:00:00 TAI. e, omega, f: of the orbit.

    Returns:
        a (m), e, i, Omega, omega, f (rad).

    Raises:
        ValueError: if no inclination does it (too high), or ``e`` or the local time is out of range.
    """
    if not 0.0 <= local_time < 24.0:
        raise ValueError(f"local_time: expected hours from 0 to 24, got {local_time}")
    if not 0.0 <= e < 1.0:
        raise ValueError(f"e: expected the eccentricity of an ellipse, 0 to below 1, got {e}")
    earth = body("Earth")
    a = earth.radius + height
    n, p = math.sqrt(earth.mu / a**3) if a > 0.0 else math.nan, a * (1.0 - e * e)
    rate = 2.0 * math.pi / TROPICAL_YEAR
    cosine = -2.0 / 3.0 * rate / (n * earth.zonals[0]) * (p / earth.field_radius) ** 2
    if not -1.0 <= cosine <= 1.0:
        raise ValueError(f"height: no orbit is Sun-synchronous at {height / 1e3:.0f} km; the highest is at 5,974 km")
    whole, rest = time.julian_dates(epoch_ns)
    days = whole - 2451545.0 + rest
    sun = math.radians(280.460 + 0.98564736 * days)  # mean longitude (Astronomical Almanac)
    node = (sun + (local_time - 12.0) * math.pi / 12.0) % (2.0 * math.pi)
    return a, e, math.acos(cosine), node, omega, f


def _require_earth(attitude: dict[str, Any]) -> None:
    planet = attitude.get("planet", "Earth")
    if body(planet).name != "Earth":
        raise ValueError(f"planet: expected the Earth, for which these coordinates are made, got {planet!r}")


def from_geodetic(
    latitude: float,
    longitude: float,
    height: float,
    dcm_EN: F64,
    *,
    heading: float | None = None,
    inclination: float | None = None,
    ascending: bool = True,
    **attitude: Any,
) -> Spacecraft.State:
    """Initial state on a circular orbit of the Earth through a place.

    Args:
        latitude, longitude: WGS84, rad. height: m. dcm_EN: (3, 3) orientation of the Earth at that time.
        heading: of the inertial velocity, rad from north towards east. inclination: instead of it, rad.
        ascending: with an inclination, whether the spacecraft goes north. attitude: as for `from_rv`, but the planet
            is always the Earth.

    Raises:
        ValueError: if not one of heading and inclination is given, or abs(latitude) <= i <= pi - abs(latitude) fails.
    """
    _require_earth(attitude)
    if (heading is None) == (inclination is None):
        raise ValueError("heading, inclination: expected one of the two")
    turn = np.asarray(dcm_EN, np.float64)
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-9) or np.linalg.det(turn) < 0.0:
        raise ValueError(f"dcm_EN: expected a rotation matrix (3, 3), got {turn.tolist()}")
    if not (math.isfinite(longitude) and math.isfinite(height)):
        raise ValueError(f"longitude, height: expected finite numbers (rad, m), got {longitude} and {height}")
    if heading is not None and not math.isfinite(heading):
        raise ValueError(f"heading: expected a finite angle (rad), got {heading}")
    if not abs(latitude) <= math.pi / 2.0:
        raise ValueError(f"latitude: expected -pi/2 to pi/2 rad, got {latitude}")
    r = turn.T @ np.array(plain(geodesy.ecef_from_geodetic)(latitude, longitude, height))
    distance = float(np.linalg.norm(r))
    across = math.hypot(r[0], r[1])
    if inclination is not None:
        cosine = math.cos(inclination) if across > _AT_POLE or abs(math.cos(inclination)) > 1e-12 else 0.0
        sine = cosine * distance / max(across, _AT_POLE)
        if not (abs(sine) <= 1.0 + 1e-12 and 0.0 <= inclination <= math.pi):
            low = math.degrees(math.acos(min(across / distance, 1.0)))
            got = math.degrees(inclination)
            raise ValueError(f"inclination: expected {low:.3f} to {180.0 - low:.3f} deg over this place, got {got:.3f}")
        angle = math.asin(max(-1.0, min(1.0, sine)))
        heading = angle if ascending else math.pi - angle
    assert heading is not None
    # a pole has no east: the heading then counts from the meridian of x
    east = np.array([-r[1], r[0], 0.0]) / across if across > _AT_POLE else np.array([0.0, 1.0, 0.0])
    north = np.cross(r / distance, east)
    v = math.sqrt(body("Earth").mu / distance) * (math.sin(heading) * east + math.cos(heading) * north)
    return from_rv(r, v, **attitude)


def from_tle(line1: str, line2: str, epoch_ns: int, **attitude: Any) -> Spacecraft.State:
    """Initial state in GCRF from two-line elements, whose mean elements only SGP4 turns into a position.

    SGP4's frame TEME goes to GCRF by ``NPB' R3(GMST82 - GAST06)``, which needs no Earth orientation data.

    Args:
        line1, line2: the elements. epoch_ns: of simulation time zero, TAI ns since 2000-01-01T12:00:00 TAI.
        attitude: as for `from_geodetic`.

    Raises:
        ValueError: if a line is damaged, the lines are of two satellites, the time is more than 60 days from the epoch
            of the elements, or SGP4 refuses them.
    """
    _require_earth(attitude)
    for number, line in enumerate((line1, line2), 1):
        text = line.rstrip()
        total = sum(int(c) if c.isdigit() else c == "-" for c in text[:68])
        if len(text) != 69 or not text.startswith(f"{number} ") or text[68] != str(total % 10):
            raise ValueError(f"line{number}: expected a line of two-line elements with a right checksum, got {text!r}")
    if line1[2:7] != line2[2:7]:
        raise ValueError(f"line2: expected the satellite of line1, {line1[2:7].strip()}, got {line2[2:7].strip()}")
    satellite = SATREC.twoline2rv(line1.rstrip(), line2.rstrip())
    whole, rest = time.julian_dates(epoch_ns, "utc")
    days = whole - satellite.jdsatepoch + (rest - satellite.jdsatepochF)
    if not abs(days) <= TLE_DAYS:
        when = (
            f"{time.calendar(epoch_ns)}, {abs(days):.0f} days {'after' if days > 0.0 else 'before'} that of the lines"
        )
        raise ValueError(f"epoch_ns: expected a time at most {TLE_DAYS:g} days from the elements, got {when}")
    code, r_km, v_km = satellite.sgp4(whole, rest)
    if code:
        why = SGP4_WORDS.get(code, f"code {code}")
        raise ValueError(f"SGP4 refuses the elements at {time.calendar(epoch_ns)}: {why}; get others")
    dcm = dcm_gcrf_teme(epoch_ns)
    return from_rv(dcm @ np.array(r_km) * 1e3, dcm @ np.array(v_km) * 1e3, **attitude)


def dcm_gcrf_teme(epoch_ns: int) -> F64:
    """(3, 3) from TEME, SGP4's frame, to GCRF. The difference of both sidereal times hardly depends on UT1."""
    tt, utc = time.julian_dates(epoch_ns), time.julian_dates(epoch_ns, "utc")
    angle = float(ERFA.gmst82(*utc)) - float(ERFA.gst06a(*utc, *tt))
    turn = ERFA.rz(angle, np.eye(3))
    return np.asarray(ERFA.pnm06a(*tt).T @ turn, np.float64)
