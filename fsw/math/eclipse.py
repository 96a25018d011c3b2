"""Eclipse: the visible part of the Sun's disk behind a sphere, exact on the celestial sphere. Compiled."""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.vectors import V3, cross, dot, norm


@compiled
def cap_overlap(a: float, b: float, c: float) -> float:
    """Solid angle common to two circular caps of angular radii ``a`` and ``b``, whose centres are ``c`` apart.

    All in rad, 0 < a, b <= pi/2, and the circles must cross: abs(a - b) < c < a + b. The lens is two sectors less the
    two spherical triangles between centres and crossings: 2 (alpha (1 - cos a) + beta (1 - cos b) - E). Angles by the
    half-angle formulas and the excess E by L'Huilier's (Todhunter, "Spherical Trigonometry", art. 45 and 102), so that
    small caps lose no digits. Result in sr.
    """
    s, sa, sb, sc = 0.5 * (a + b + c), 0.5 * (b + c - a), 0.5 * (a + c - b), 0.5 * (a + b - c)
    k = math.sin(sc) / math.sin(s)
    ratio = math.sin(sa) / math.sin(sb)
    alpha = 2.0 * math.atan(math.sqrt(k * ratio))
    beta = 2.0 * math.atan(math.sqrt(k / ratio))
    product = math.tan(0.5 * s) * math.tan(0.5 * sa) * math.tan(0.5 * sb) * math.tan(0.5 * sc)
    excess = 4.0 * math.atan(math.sqrt(product))
    sin_a, sin_b = math.sin(0.5 * a), math.sin(0.5 * b)
    return 2.0 * (2.0 * alpha * sin_a * sin_a + 2.0 * beta * sin_b * sin_b - excess)


@compiled
def visible_fraction(sun: V3, sun_radius: float, body: V3, body_radius: float) -> float:
    """Visible part of the solid angle of the Sun's disk, 0 to 1, from the origin, with a spherical body before it.

    Args:
        sun: position of the Sun's centre relative to the observer, m.
        sun_radius: m.
        body: position of the body's centre relative to the observer, m, in the same components.
        body_radius: m.

    Returns:
        1 in full light, 0 in the umbra and inside the body; NaN if a position is NaN.
    """
    far2, near2, along = dot(sun, sun), dot(body, body), dot(sun, body)
    over_sun, over_body = far2 - sun_radius * sun_radius, near2 - body_radius * body_radius
    if over_sun > 0.0 and over_body > 0.0:
        # cosines of c, a + b and b - a, times far * near, settle most of an orbit; the margin is for rounding
        cosines, sines = math.sqrt(over_sun * over_body), sun_radius * body_radius
        margin = 1e-12 * math.sqrt(far2 * near2)
        if along < cosines - sines - margin:
            return 1.0
        if along > cosines + sines + margin and far2 > near2 and body_radius**2 * far2 > sun_radius**2 * near2:
            return 0.0
    far, near = math.sqrt(far2), math.sqrt(near2)
    c = math.atan2(norm(cross(sun, body)), dot(sun, body))
    if math.isnan(c):
        return math.nan
    if near <= body_radius:
        return 0.0
    if far <= sun_radius:
        return 1.0
    a, b = math.asin(sun_radius / far), math.asin(body_radius / near)
    if c >= a + b or far <= near - body_radius:
        return 1.0
    if c <= b - a:
        return 0.0
    if c <= a - b:
        ratio = math.sin(0.5 * b) / math.sin(0.5 * a)
        return 1.0 - ratio * ratio
    half = math.sin(0.5 * a)
    hidden = cap_overlap(a, b, c) / (4.0 * math.pi * half * half)
    light = 1.0 - hidden
    return 0.0 if light < 0.0 else min(light, 1.0)
