"""Two-body orbits: Kepler's equation, anomalies, classical elements to position and velocity and back.

Elements are (a, e, i, Omega, omega, f): semi-major axis (m, negative for a hyperbola), eccentricity, inclination,
right ascension of the ascending node, argument of periapsis, true anomaly (rad). A parabola (e exactly 1) has no
semi-major axis: its a is minus the radius of periapsis, as in Basilisk; near it a and e together are good to
1e-16 / |1 - e| only, as e is rounded. Straight lines through the centre are refused (NaN). Angles come from
two-argument arc tangents; Basilisk takes inclination and angles from cosines, and so loses an inclination below 1e-8
and half of the digits near 0 and pi. Source: Vallado, "Fundamentals of Astrodynamics and Applications", 4th ed., ch. 2.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.vectors import V3, cross, dot, norm

Elements: TypeAlias = tuple[float, float, float, float, float, float]
"""a (m), e, i, Omega, omega, f (rad)."""

SMALL = 1e-11
"""Below it an eccentricity or the sine of an inclination counts as 0: omega or Omega is then 0."""

PARALLEL = 1e-12
"""Below this sine of their angle position and velocity have no plane."""

PARABOLIC = 1e-14
"""An orbit whose energy is below this part of mu / r is a parabola."""


@compiled
def full_turns(angle: float) -> float:
    """The multiple of 2 pi nearest to an angle, rad; what is left of the angle lies in [-pi, pi]."""
    return 2.0 * math.pi * np.rint(angle / (2.0 * math.pi))


@compiled
def positive_angle(angle: float) -> float:
    """The same angle in [0, 2 pi), rad."""
    full = 2.0 * math.pi
    rest = angle % full
    return rest if rest < full else 0.0  # the rest of a tiny negative angle rounds to a whole turn


@compiled
def eccentric_anomaly(mean: float, e: float) -> float:
    """E (rad) of M = E - e sin E for 0 <= e < 1; Newton's method, guarded by bisection, so that it always converges."""
    if not 0.0 <= e < 1.0:
        return math.nan
    turns = full_turns(mean)
    m = mean - turns
    low, high = m - e, m + e
    x = m + math.copysign(0.85 * e, m)  # Danby (1987)
    for _ in range(100):
        error = x - e * math.sin(x) - m
        if error > 0.0:
            high = min(high, x)
        else:
            low = max(low, x)
        step = error / (1.0 - e * math.cos(x))
        new = x - step
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * (1.0 + abs(x)):
            x = new
            break
        x = new
    return x + turns


@compiled
def hyperbolic_anomaly(mean: float, e: float) -> float:
    """H of N = e sinh H - H for e > 1; Newton's method, guarded by bisection."""
    if not e > 1.0:
        return math.nan
    n = abs(mean)
    low, high = 0.0, math.asinh(n / (e - 1.0)) + 1e-300
    x = math.asinh(n / e)
    for _ in range(200):
        error = e * math.sinh(x) - x - n
        if error > 0.0:
            high = min(high, x)
        else:
            low = max(low, x)
        new = x - error / (e * math.cosh(x) - 1.0)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * (1.0 + abs(x)):
            x = new
            break
        x = new
    return math.copysign(x, mean)


@compiled
def true_to_mean(f: float, e: float) -> float:
    """Mean anomaly (rad) of a true anomaly; NaN where a hyperbola does not go.

    That of a parabola is the time since periapsis times sqrt(mu / (2 rp^3)) (Barker's equation).
    """
    if 0.0 <= e < 1.0:
        turns = full_turns(f)
        b = math.sqrt(1.0 - e * e)
        x = math.atan2(b * math.sin(f), e + math.cos(f))
        return x - e * math.sin(x) + turns
    if e > 1.0 and 1.0 + e * math.cos(f) > 0.0:
        sinh = math.sqrt(e * e - 1.0) * math.sin(f) / (1.0 + e * math.cos(f))
        return e * sinh - math.asinh(sinh)
    if e == 1.0 and math.cos(f) > -1.0:
        x = math.tan(0.5 * f)
        return x + x * x * x / 3.0
    return math.nan


@compiled
def mean_to_true(mean: float, e: float) -> float:
    """True anomaly (rad) of a mean anomaly: the inverse of `true_to_mean`."""
    if 0.0 <= e < 1.0:
        turns = full_turns(mean)
        x = eccentric_anomaly(mean - turns, e)
        return math.atan2(math.sqrt(1.0 - e * e) * math.sin(x), math.cos(x) - e) + turns
    if e > 1.0:
        x = hyperbolic_anomaly(mean, e)
        return math.atan2(math.sqrt(e * e - 1.0) * math.sinh(x), e - math.cosh(x))
    if e == 1.0:
        return 2.0 * math.atan(2.0 * math.sinh(math.asinh(1.5 * mean) / 3.0))
    return math.nan


@compiled
def mean_motion(a: float, e: float, mu: float) -> float:
    """Rate of the mean anomaly, rad/s; NaN if a and e are of no orbit."""
    if e == 1.0:
        return math.sqrt(-0.5 * mu / (a * a * a)) if a < 0.0 else math.nan
    q = mu / (a * a * a)
    if e > 1.0:
        q = -q
    return math.sqrt(q) if q > 0.0 else math.nan


@compiled
def elements_to_rv(elements: Elements, mu: float) -> tuple[V3, V3]:
    """Position (m) and velocity (m/s), inertial, for the gravitational parameter ``mu`` (m^3/s^2).

    NaN if the elements are of no orbit: a (1 - e^2) not positive, or f beyond the asymptotes of a hyperbola.
    """
    a, e, i, node, peri, f = elements
    p = -2.0 * a if e == 1.0 else a * (1.0 - e * e)
    q = 1.0 + e * math.cos(f)
    if not (p > 0.0 and q > 0.0 and e >= 0.0):
        nan = (math.nan, math.nan, math.nan)
        return nan, nan
    r = p / q
    k = math.sqrt(mu / p)
    u = peri + f
    cu, su, cn, sn, ci, si = math.cos(u), math.sin(u), math.cos(node), math.sin(node), math.cos(i), math.sin(i)
    x, y = su + e * math.sin(peri), cu + e * math.cos(peri)
    return (
        (r * (cn * cu - sn * su * ci), r * (sn * cu + cn * su * ci), r * su * si),
        (-k * (cn * x + sn * y * ci), -k * (sn * x - cn * y * ci), k * y * si),
    )


@compiled
def rv_to_elements(r: V3, v: V3, mu: float) -> Elements:
    """Elements of a position (m) and velocity (m/s); angles in [0, 2 pi), f of a hyperbola in (-pi, pi).

    A circular orbit has omega = 0 and f counted from the node; an equatorial one Omega = 0 and omega counted from x,
    in the sense of the motion also if it is retrograde. NaN if r and v are parallel (no plane).
    """
    h = cross(r, v)
    h1, r1 = norm(h), norm(r)
    if not h1 > PARALLEL * r1 * norm(v):
        return (math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
    c = cross(v, h)
    ecc = (c[0] / mu - r[0] / r1, c[1] / mu - r[1] / r1, c[2] / mu - r[2] / r1)
    e = norm(ecc)
    energy = 2.0 - r1 * dot(v, v) / mu
    parabola = abs(energy) < PARABOLIC
    a = -0.5 * h1 * h1 / mu if parabola else r1 / energy
    e = 1.0 if parabola else e
    hxy = math.hypot(h[0], h[1])
    inclination = math.atan2(hxy, h[2])
    # n and m span the orbit's plane: n towards the ascending node, m ahead of it by 90 degrees
    n = (-h[1] / hxy, h[0] / hxy, 0.0) if hxy > SMALL * h1 else (1.0, 0.0, 0.0)
    node = math.atan2(n[1], n[0])
    m0 = cross(h, n)
    m = (m0[0] / h1, m0[1] / h1, m0[2] / h1)
    u = math.atan2(dot(r, m), dot(r, n))
    peri = math.atan2(dot(ecc, m), dot(ecc, n)) if e > SMALL else 0.0
    # angle from periapsis to r without the difference of two angles, which would lose digits near periapsis
    f = math.atan2(h1 * dot(r, v) / mu, h1 * h1 / mu - r1) if e > SMALL else u
    return (a, e, inclination, positive_angle(node), positive_angle(peri), positive_angle(f) if e < 1.0 else f)
