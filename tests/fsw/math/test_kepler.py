"""Orbits against Basilisk's vectors, mpmath's roots of Kepler's equation, and Vallado's worked examples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fsw.math import kepler as k

DATA: dict[str, Any] = json.loads((Path(__file__).parents[2] / "data" / "basilisk_orbital_motion.json").read_text())
WELL_KNOWN = [o for o in DATA["orbits"] if "thresholds" not in o["label"]]


def elements_of(case: dict[str, float]) -> k.Elements:
    return (case["a"], case["e"], case["i"], case["Omega"], case["omega"], case["f"])


def angle_error(a: float, b: float) -> float:
    return abs((a - b + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.parametrize("case", DATA["orbits"] + DATA["parabolas"])
def test_elements_to_rv_against_basilisk(case: dict[str, Any]) -> None:
    r, v = k.elements_to_rv(elements_of(case["elements"]), case["mu"])
    # cosines of angles of some radians carry a few rounding errors of the angle
    np.testing.assert_allclose(r, case["r"], rtol=0, atol=4e-15 * float(np.linalg.norm(case["r"])))
    np.testing.assert_allclose(v, case["v"], rtol=0, atol=4e-15 * float(np.linalg.norm(case["v"])))


@pytest.mark.parametrize("case", WELL_KNOWN + DATA["parabolas"])
def test_rv_to_elements_and_back(case: dict[str, Any]) -> None:
    (r0, r1, r2), (v0, v1, v2) = case["r"], case["v"]
    found = k.rv_to_elements((r0, r1, r2), (v0, v1, v2), case["mu"])
    given = elements_of(case["elements"])
    assert found[0] == pytest.approx(given[0], rel=1e-13)
    assert found[1] == pytest.approx(given[1], abs=2e-14)
    inclination = given[2] if given[2] <= np.pi else np.arccos(np.cos(given[2]))  # one case gives 10 rad
    assert angle_error(found[2], inclination) < 2e-14
    r, v = k.elements_to_rv(found, case["mu"])
    np.testing.assert_allclose(r, case["r"], rtol=0, atol=2e-13 * float(np.linalg.norm(case["r"])))
    np.testing.assert_allclose(v, case["v"], rtol=0, atol=2e-13 * float(np.linalg.norm(case["v"])))
    if given[1] > 1e-3 and 1e-3 < given[2] < 3.1:
        assert angle_error(found[3], given[3]) < 1e-13
        assert angle_error(found[4], given[4]) < 1e-12
        assert angle_error(found[5], given[5]) < 1e-12


def test_vallado_examples() -> None:
    """Vallado, 4th ed., examples 2-5 (elements of r, v), 2-1 (Kepler's equation) and 2-3 (hyperbola)."""
    r, v = (6524.834e3, 6862.875e3, 6448.296e3), (4.901327e3, 5.533756e3, -1.976341e3)
    a, e, i, node, peri, f = k.rv_to_elements(r, v, 398600.4418e9)
    assert a == pytest.approx(36127.343e3, abs=1e3)
    assert e == pytest.approx(0.832853, abs=1e-5)
    degrees = np.degrees([i, node, peri, f])
    np.testing.assert_allclose(degrees, [87.870, 227.898, 53.38, 92.335], rtol=0, atol=0.005)
    assert np.degrees(k.eccentric_anomaly(np.radians(235.4), 0.4)) == pytest.approx(220.512074767522, abs=1e-10)
    assert k.hyperbolic_anomaly(np.radians(235.4), 2.4) == pytest.approx(1.601376144, abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.3, 0.9, 0.999, 1 - 1e-12])
@pytest.mark.parametrize("mean", [0.0, 1e-9, 0.01, 1.0, 3.0, np.pi, -2.0, 5.0, 40.0])
def test_eccentric_anomaly_against_mpmath(e: float, mean: float) -> None:
    with mpmath.workdps(50):
        m, ecc = mpmath.mpf(mean), mpmath.mpf(e)
        low, high = m - ecc - mpmath.mpf("1e-30"), m + ecc + mpmath.mpf("1e-30")
        for _ in range(170):  # bisection
            middle = (low + high) / 2
            low, high = (middle, high) if middle - ecc * mpmath.sin(middle) < m else (low, middle)
        # rounding of M alone moves E by eps / (1 - e cos E)
        condition = 1 / (1 - ecc * mpmath.cos(low))
        tolerance = float(4e-16 * (1 + abs(m)) * condition + 1e-15 * abs(low))
        assert abs(k.eccentric_anomaly(mean, e) - float(low)) < tolerance


@pytest.mark.parametrize("case", DATA["anomalies"])
def test_anomalies_of_ellipses_against_basilisk(case: dict[str, Any]) -> None:
    e, x = case["e"], case["x"]
    assert angle_error(k.eccentric_anomaly(x, e), case["M2E"]) < 1e-11 / (1 - e)  # Basilisk stops at 1e-13 in M
    assert angle_error(k.true_to_mean(case["E2f"], e), case["E2M"]) < 1e-14
    assert angle_error(k.mean_to_true(case["E2M"], e), case["E2f"]) < 2e-14 / (1 - e)


@pytest.mark.parametrize("case", DATA["hyperbolic_anomalies"])
def test_anomalies_of_hyperbolas_against_basilisk(case: dict[str, Any]) -> None:
    e, x = case["e"], case["x"]
    assert k.hyperbolic_anomaly(x, e) == pytest.approx(case["N2H"], rel=1e-11)
    assert k.true_to_mean(case["H2f"], e) == pytest.approx(case["H2N"], rel=1e-12)
    assert k.mean_to_true(case["H2N"], e) == pytest.approx(case["H2f"], rel=1e-12)


def test_whole_turns_are_kept() -> None:
    assert k.mean_to_true(20.0 * np.pi + 0.5, 0.1) == pytest.approx(k.mean_to_true(0.5, 0.1) + 20.0 * np.pi, abs=2e-14)
    assert k.true_to_mean(-6.0 * np.pi - 0.5, 0.1) == pytest.approx(-k.true_to_mean(0.5, 0.1) - 6.0 * np.pi, abs=2e-14)


def test_what_is_no_orbit_gives_nan() -> None:
    assert np.isnan(k.elements_to_rv((7e6, 1.0, 0.1, 0.1, 0.1, 0.1), 4e14)).all()
    assert np.isnan(k.elements_to_rv((7e6, -0.1, 0.1, 0.1, 0.1, 0.1), 4e14)).all()
    assert np.isnan(k.elements_to_rv((-7e6, 1.5, 0.1, 0.1, 0.1, 3.1), 4e14)).all()
    assert np.isnan(k.rv_to_elements((7e6, 0.0, 0.0), (1e3, 0.0, 0.0), 4e14)).all()
    assert np.isnan(k.rv_to_elements((7e6, 0.0, 0.0), (1e3, 1e-10, 0.0), 4e14)).all()
    assert np.isnan([k.eccentric_anomaly(1.0, 1.0), k.hyperbolic_anomaly(1.0, 0.9), k.true_to_mean(3.1, 1.5)]).all()
    assert np.isnan([k.true_to_mean(np.pi, 1.0), k.mean_to_true(np.nan, 0.1), k.mean_motion(7e6, 1.0, 4e14)]).all()
    assert np.isnan([k.mean_motion(-7e6, 0.5, 4e14), k.mean_motion(7e6, 1.5, 4e14)]).all()


@pytest.mark.parametrize("case", WELL_KNOWN)
def test_elements_are_those_of_basilisk(case: dict[str, Any]) -> None:
    """Its own inverse of its r and v: the choices at circular, equatorial and retrograde orbits too."""
    (r0, r1, r2), (v0, v1, v2), known = case["r"], case["v"], case["rv2elem"]
    a, e, i, node, peri, f = k.rv_to_elements((r0, r1, r2), (v0, v1, v2), case["mu"])
    assert a == pytest.approx(known["a"], rel=4e-15 * max(1.0, abs(a) / float(np.linalg.norm(case["r"]))) * 4)
    assert e == pytest.approx(known["e"], abs=4e-15)
    for mine, its in ((i, known["i"]), (node, known["Omega"])):
        assert angle_error(mine, its) < 2e-14
    # Basilisk takes these from cosines, which loses half of the digits near 0 and pi
    assert angle_error(peri, known["omega"]) < 1e-12
    assert angle_error(f, known["f"]) < 1e-12


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("e", [0.0, 0.3, 1.0, 1.7])
def test_equatorial_orbits_both_ways(sense: float, e: float) -> None:
    """Angles by hand: counted from x along the motion, also against the Earth's rotation."""
    mu, p, lon, f = 4e14, 9e6, 2.1, 0.4
    r1, peri = p / (1.0 + e * np.cos(f)), lon - f
    r = (r1 * np.cos(lon), sense * r1 * np.sin(lon), 0.0)
    speed = np.sqrt(mu / p)
    v = (-speed * (np.sin(lon) + e * np.sin(peri)), sense * speed * (np.cos(lon) + e * np.cos(peri)), 0.0)
    a, ecc, i, node, omega, anomaly = k.rv_to_elements(r, v, mu)
    assert (i, node) == (0.0 if sense > 0.0 else np.pi, 0.0)
    assert a == pytest.approx(-0.5 * p if e == 1.0 else p / (1.0 - e * e), rel=1e-14)
    assert ecc == pytest.approx(e, abs=1e-15)
    if e == 0.0:
        assert omega == 0.0
        assert anomaly == pytest.approx(lon, abs=4e-15)
    else:
        assert omega == pytest.approx(peri, abs=4e-15)
        assert anomaly == pytest.approx(f, abs=4e-15)
    back = k.elements_to_rv((a, ecc, i, node, omega, anomaly), mu)
    np.testing.assert_allclose(back[0], r, rtol=0, atol=1e-14 * r1)
    np.testing.assert_allclose(back[1], v, rtol=0, atol=1e-14 * speed)


@pytest.mark.parametrize("mean", [0.0, 1e-12, 1e-3, 0.8, -2.0, 50.0, -1e6])
def test_barkers_equation_against_mpmath(mean: float) -> None:
    with mpmath.workdps(40):
        m = mpmath.mpf(mean)
        start = mpmath.sign(m) * mpmath.cbrt(3 * abs(m) + 1)
        exact = 2 * mpmath.atan(mpmath.findroot(lambda x: x + x**3 / 3 - m, start))
    assert k.mean_to_true(mean, 1.0) == pytest.approx(float(exact), rel=4e-16, abs=0.0)
    if abs(mean) < 1e3:
        assert k.true_to_mean(float(exact), 1.0) == pytest.approx(mean, rel=1e-14 * (1.0 + abs(mean)))


@pytest.mark.parametrize(("a", "e"), [(8e6, 0.2), (-2e7, 1.5), (-7e6, 1.0)])
def test_mean_motion_is_the_time_law(a: float, e: float) -> None:
    """One step along the orbit by the time law ends where an integrator of high order ends."""
    mu = 3.986004415e14
    at_start = (a, e, 0.8, 0.3, 1.2, 0.5)
    later = k.mean_to_true(k.true_to_mean(0.5, e) + k.mean_motion(a, e, mu) * 900.0, e)

    def motion(_: float, y: Any) -> Any:
        return np.concatenate([y[3:], -mu * y[:3] / np.linalg.norm(y[:3]) ** 3])

    start = np.concatenate(k.elements_to_rv(at_start, mu))
    end = solve_ivp(motion, (0.0, 900.0), start, method="DOP853", rtol=1e-13, atol=1e-6).y[:, -1]
    r, v = k.elements_to_rv((a, e, 0.8, 0.3, 1.2, later), mu)
    np.testing.assert_allclose(r, end[:3], rtol=0, atol=1e-4)
    np.testing.assert_allclose(v, end[3:], rtol=0, atol=1e-7)


def test_angles_stay_below_a_whole_turn() -> None:
    assert k.positive_angle(-1e-17) == 0.0
    assert k.positive_angle(-1.0) == pytest.approx(2.0 * np.pi - 1.0)
