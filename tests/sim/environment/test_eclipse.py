"""Eclipse against an integral over the Sun's disk, counted rays, and the cones that touch Sun and planet."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest

from fsw.math.compiled import plain
from fsw.math.eclipse import visible_fraction
from messages.base import F64
from messages.environment import EphemerisMsg
from sim.environment.eclipse import Eclipse
from tests.sim.environment.environment_rig import Criterion, Sky, body_at

R_SUN, R_EARTH, AU = 695700e3, 6378137.0, 149597870700.0
visible = plain(visible_fraction)


def integrated(sun_radius: float, sun: F64, body_radius: float, body: F64) -> float:
    """Visible part by integrating over rings around the Sun's centre, with 30 digits.

    Of the ring at an angle t the body hides the azimuths with cos t cos c + sin t sin c cos(azimuth) > cos b.
    """
    with mpmath.workdps(30):
        p, q = mpmath.matrix(sun.tolist()), mpmath.matrix(body.tolist())
        far, near = mpmath.norm(p), mpmath.norm(q)
        a, b = mpmath.asin(sun_radius / far), mpmath.asin(body_radius / near)
        c = mpmath.acos((p.T * q)[0] / (far * near))

        def hidden(t: Any) -> Any:
            k = (mpmath.cos(b) - mpmath.cos(t) * mpmath.cos(c)) / (mpmath.sin(t) * mpmath.sin(c))
            return mpmath.sin(t) * (0 if k >= 1 else mpmath.pi if k <= -1 else mpmath.acos(k)) / mpmath.pi

        # the integrand has corners where a ring begins and ceases to be cut
        corners = [abs(c - b), c + b]
        limits = [mpmath.mpf(0), *sorted(x for x in corners if 0 < x < a), a]
        return float(1 - mpmath.quad(hidden, limits) / (1 - mpmath.cos(a)))


def at_angle(distance: float, angle: float) -> F64:
    """A position whose direction is ``angle`` from the x axis."""
    return distance * np.array([math.cos(angle), 0.6 * math.sin(angle), 0.8 * math.sin(angle)])


def worst_of(sun_distance: float, sun_radius: float, distance: float, radius: float) -> float:
    """Largest error over nine depths of an eclipse."""
    a, b = math.asin(sun_radius / sun_distance), math.asin(radius / distance)
    sun, worst = np.array([sun_distance, 0.0, 0.0]), 0.0
    for part in np.linspace(0.02, 0.98, 9):
        body = at_angle(distance, abs(a - b) + part * 2.0 * min(a, b))
        found = visible(tuple(sun), sun_radius, tuple(body), radius)
        worst = max(worst, abs(found - integrated(sun_radius, sun, radius, body)))
    return worst


def test_penumbra_against_integration(criterion: Criterion) -> None:
    heights = (200e3, 2e7, 1.2e9)
    criterion("ECLIPSE-1", max(worst_of(AU, R_SUN, R_EARTH + h, R_EARTH) for h in heights))


def test_small_bodies_against_integration(criterion: Criterion) -> None:
    """The Moon from low Earth orbit, Venus before the Sun, Phobos from Mars, Jupiter's own shadow."""
    cases = [
        (AU, R_SUN, 3.8e8, 1737.4e3),
        (AU, R_SUN, 4e10, 6051.8e3),
        (2.28e11, R_SUN, 6e6, 11e3),
        (7.78e11, R_SUN, 8e7, 71492e3),
    ]
    criterion("ECLIPSE-2", max(worst_of(*case) for case in cases))


def test_against_counted_rays(criterion: Criterion) -> None:
    """Rays in random directions of the Sun's cap; those that meet the sphere are dark."""
    rng, count, worst = np.random.default_rng(8), 40_000, 0.0
    half = math.asin(R_SUN / AU)
    cosine, azimuth = 1.0 - rng.random(count) * (1.0 - math.cos(half)), rng.random(count) * 2.0 * np.pi
    sine = np.sqrt(1.0 - cosine**2)
    rays = np.column_stack([cosine, sine * np.cos(azimuth), sine * np.sin(azimuth)])
    for distance, offset in [(6.9e6, -0.002), (6.9e6, 0.001), (4.2e7, 0.003)]:
        body = at_angle(distance, math.asin(R_EARTH / distance) + offset)
        along = rays @ body
        dark = (along > 0) & (body @ body - along**2 < R_EARTH**2)
        found = visible((AU, 0.0, 0.0), R_SUN, tuple(body), R_EARTH)
        worst = max(worst, abs(found - (1.0 - float(np.mean(dark)))))
    criterion("ECLIPSE-3", worst)


def module_with(r: Any, moon: EphemerisMsg | None = None, radius: float = R_EARTH) -> float:
    without = ("in_moon",) if moon is None else ()
    sky = Sky(Eclipse("eclipse", Eclipse.Params(radius=radius)), without=without)
    sky.place(r)
    sky.out_sun.write(body_at([AU, 0.0, 0.0], R_SUN), 0)
    if moon is not None:
        sky.out_moon.write(moon, 0)
    return sky.answer().illumination


def edge(x: float, dark: bool) -> float:
    """Distance from the axis at which the light is no longer full (or begins), by halving."""
    low, high = R_EARTH * 0.9, R_EARTH * 1.1
    for _ in range(45):
        y = 0.5 * (low + high)
        light = visible((AU - x, -y, 0.0), R_SUN, (-x, -y, 0.0), R_EARTH)
        inside = light == 0.0 if dark else light < 1.0
        low, high = (y, high) if inside else (low, y)
    return low


def test_edges_are_the_tangent_cones(criterion: Criterion) -> None:
    """Behind the planet at x the umbra's edge is on the outer, the penumbra's on the inner common tangent."""
    worst, x = 0.0, -7e6
    for sign in (1.0, -1.0):
        slope = math.asin((R_SUN - sign * R_EARTH) / AU)  # half angle of the cone
        apex = sign * R_EARTH / math.sin(slope)
        expected = abs(apex + x) * math.tan(slope)
        worst = max(worst, abs(edge(x, dark=sign > 0) - expected))
    criterion("ECLIPSE-4", worst)


def test_full_light_umbra_and_antumbra() -> None:
    assert module_with([7e6, 0.0, 0.0]) == 1.0
    assert module_with([0.0, 7e6, 0.0]) == 1.0
    assert module_with([-7e6, 1e5, 0.0]) == 0.0
    assert module_with([1e6, 0.0, 0.0]) == 0.0
    distance = 2e9  # beyond the apex of the umbra at 1.38e9 m: a transit
    ratio = (R_EARTH / distance) / (R_SUN / (AU + distance))
    assert module_with([-distance, 0.0, 0.0]) == pytest.approx(1.0 - ratio**2, rel=1e-4)


def test_light_is_monotonic_across_the_shadow() -> None:
    light = [module_with([-6.8e6, y, 0.0]) for y in np.linspace(6.2e6, 6.6e6, 60)]
    assert light[0] == 0.0
    assert light[-1] == 1.0
    assert np.all(np.diff(light) >= 0.0)


def test_planar_formula_differs_by_the_curvature() -> None:
    """A circle of radius b on the sphere has the curvature cot b, on a plane 1/b.

    Over the Sun's disk that adds up to a (1/b - cot b) / (3 pi), to first order in a: 2e-4 in low orbit, 3e-6 at the
    Moon.
    """
    for distance in (R_EARTH + 4e5, 3.6e8):
        a, b = math.asin(R_SUN / AU), math.asin(R_EARTH / distance)
        c = math.hypot(a, b)
        x = (c * c + a * a - b * b) / (2 * c)
        y = math.sqrt(a * a - x * x)
        plane = 1 - (a * a * math.acos(x / a) + b * b * math.acos((c - x) / b) - c * y) / (math.pi * a * a)
        found = visible((AU, 0.0, 0.0), R_SUN, tuple(at_angle(distance, c)), R_EARTH)
        assert plane - found == pytest.approx(a * (1 / b - 1 / math.tan(b)) / (3 * math.pi), rel=0.03)


def test_moon_hides_the_sun() -> None:
    """A total eclipse of the Sun over the lit side; the deeper of two shadows counts."""
    assert module_with([7e6, 0.0, 0.0], body_at([3.6e8, 0.0, 0.0], 1737.4e3)) == 0.0
    assert module_with([7e6, 0.0, 0.0], body_at([0.0, 3.6e8, 0.0], 1737.4e3)) == 1.0
    assert module_with([-7e6, 0.0, 0.0], body_at([0.0, 3.6e8, 0.0], 1737.4e3)) == 0.0
    assert module_with([7e6, 0.0, 0.0], body_at([2 * AU, 0.0, 0.0], 1737.4e3)) == 1.0


@pytest.mark.parametrize("bad", ["state", "sun", "moon"])
def test_nan_stops_the_run(bad: str) -> None:
    eclipse = Eclipse("eclipse")
    sky = Sky(eclipse)
    sky.place([7e6, 0.0, 0.0])
    sky.out_sun.write(body_at([AU, 0.0, 0.0], R_SUN), 0)
    sky.out_moon.write(body_at([0.0, 3.6e8, 0.0], 1737.4e3), 0)
    source = {"state": sky.out_state, "sun": sky.out_sun, "moon": sky.out_moon}[bad]
    source.row["r_BN_N" if bad == "state" else "r_PN_N"] = np.nan
    with pytest.raises(ValueError, match="r_BN_N, in_sun or in_moon r_PN_N: expected finite"):
        eclipse.step(0)
    assert eclipse.out_eclipse.latest() is None


def test_nothing_without_state_or_sun() -> None:
    for missing in ("in_state", "in_sun"):
        eclipse = Eclipse("eclipse")
        sky = Sky(eclipse, without=("in_moon",))
        if missing != "in_state":
            sky.place([7e6, 0.0, 0.0])
        if missing != "in_sun":
            sky.out_sun.write(body_at([AU, 0.0, 0.0], R_SUN), 0)
        eclipse.step(0)
        assert eclipse.out_eclipse.latest() is None


def test_nan_is_no_light_inside_the_body_either() -> None:
    assert math.isnan(visible((math.nan, 0.0, 0.0), R_SUN, (1e6, 0.0, 0.0), R_EARTH))
    assert math.isnan(visible((AU, 0.0, 0.0), R_SUN, (math.nan, 0.0, 0.0), R_EARTH))
    assert visible((AU, 0.0, 0.0), R_SUN, (1e6, 0.0, 0.0), R_EARTH) == 0.0


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan])
def test_wrong_radius(radius: float) -> None:
    with pytest.raises(ValueError, match="radius"):
        Eclipse.Params(radius=radius)
