"""Ephemeris against ERFA between its nodes, the Almanac's formula of the Sun, and a printed example of the Moon."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import erfa
import numpy as np
import pytest

from fsw import ModuleError, Simulation, Task, s
from fsw.math.compiled import plain
from fsw.math.ephemeris import SEGMENT_NS, chebyshev_state
from fsw.math.epoch import DAY, epoch, julian_dates
from messages.base import F64, I64
from sim.environment.ephemeris import Ephemeris, of_positions

Criterion = Callable[[str, float], None]
START = epoch("2023-05-05T03:28:50Z")
AU = 149597870700.0
PLANETS = {199: 1, 299: 2, 499: 4, 599: 5, 699: 6, 799: 7, 899: 8}


def states(params: Ephemeris.Params, times: I64) -> tuple[F64, F64]:
    """Positions and velocities (n, 3) at run times, by the module's step."""
    module = Ephemeris("body", params)
    r, v = np.empty((len(times), 3)), np.empty((len(times), 3))
    for k, t in enumerate(times):
        module.step(int(t))
        r[k], v[k] = module.out_ephemeris.row["r_PN_N"][0], module.out_ephemeris.row["v_PN_N"][0]
    return r, v


def params_of(body_id: int, center_id: int = 399, days: float = 400.0) -> Ephemeris.Params:
    return Ephemeris.Params(body_id=body_id, center_id=center_id, epoch_tai_ns=START, span=86400.0 * days)


def instants(count: int, seed: int) -> I64:
    """Random run times in 400 days, and the joints between polynomials."""
    joints = SEGMENT_NS * np.arange(0, 101, 10)
    return np.concatenate([joints, np.random.default_rng(seed).integers(0, 400 * DAY, count)])


def dates(times: I64) -> tuple[Any, Any]:
    return julian_dates(START + times)


def test_moon_against_erfa(criterion: Criterion) -> None:
    times = instants(1000, 1)
    r, _ = states(params_of(301), times)
    criterion("EPHEMERIS-1", float(np.max(np.abs(r - erfa.moon98(*dates(times))["p"] * AU))))


def test_sun_against_erfa(criterion: Criterion) -> None:
    times = instants(1000, 2)
    r, _ = states(params_of(10), times)
    criterion("EPHEMERIS-2", float(np.max(np.abs(r + erfa.epv00(*dates(times))[0]["p"] * AU))))


def test_planets_against_erfa(criterion: Criterion) -> None:
    times = instants(100, 3)
    earth, worst = erfa.epv00(*dates(times))[0]["p"], 0.0
    for body_id, series in PLANETS.items():
        r, _ = states(params_of(body_id), times)
        expected = (erfa.plan94(*dates(times), series)["p"] - earth) * AU
        worst = max(worst, float(np.max(np.abs(r - expected))))
    r, _ = states(params_of(10, 499), times)
    worst = max(worst, float(np.max(np.abs(r + erfa.plan94(*dates(times), 4)["p"] * AU))))
    r, _ = states(params_of(301, 599), times)
    moon = earth + erfa.moon98(*dates(times))["p"] - erfa.plan94(*dates(times), 5)["p"]
    worst = max(worst, float(np.max(np.abs(r - moon * AU))))
    criterion("EPHEMERIS-3", worst)


def test_velocity_of_sun_and_moon(criterion: Criterion) -> None:
    times = instants(500, 4)
    _, sun = states(params_of(10), times)
    _, moon = states(params_of(301), times)
    worst = np.max(np.abs(sun + erfa.epv00(*dates(times))[0]["v"] * (AU / 86400.0)))
    worst = max(worst, np.max(np.abs(moon - erfa.moon98(*dates(times))["v"] * (AU / 86400.0))))
    criterion("EPHEMERIS-4", float(worst))


def test_velocity_is_the_derivative(criterion: Criterion) -> None:
    h, worst = s(100), 0.0
    times = np.random.default_rng(5).integers(3 * h, 30 * DAY - 3 * h, 200)
    times = times[(times % SEGMENT_NS > 2 * h) & (times % SEGMENT_NS < SEGMENT_NS - 2 * h)]
    for body_id in (301, 10):
        params = params_of(body_id, days=30.0)
        _, v = states(params, times)
        near = states(params, times + h)[0] - states(params, times - h)[0]
        far = states(params, times + 2 * h)[0] - states(params, times - 2 * h)[0]
        worst = max(worst, float(np.max(np.abs(v - (8.0 * near - far) / (12.0 * 100.0)))))
    criterion("EPHEMERIS-5", worst)


def test_sun_against_the_almanac(criterion: Criterion) -> None:
    """Low-precision formula (Astronomical Almanac, page C5), right ascension and declination of date.

    Its frame is the mean equator and equinox of date, into which the position is turned by ERFA's precession; the
    aberration of 20 arcseconds is part of the formula and put back.
    """
    times, worst = np.arange(0, 400, 7) * DAY, 0.0
    r, v = states(params_of(10), times)
    for k, t in enumerate(times):
        whole, rest = julian_dates(int(START + t))
        n = whole - 2451545.0 + rest
        mean, anomaly = np.radians(280.460 + 0.9856474 * n), np.radians(357.528 + 0.9856003 * n)
        longitude = mean + np.radians(1.915 * np.sin(anomaly) + 0.020 * np.sin(2 * anomaly))
        tilt = np.radians(23.439 - 0.0000004 * n)
        expected = [np.cos(longitude), np.cos(tilt) * np.sin(longitude), np.sin(tilt) * np.sin(longitude)]
        late = r[k] - v[k] * (np.linalg.norm(r[k]) / 299792458.0)
        found = erfa.pmat06(whole, rest) @ late
        angle = np.linalg.norm(np.cross(found, expected)) / np.linalg.norm(found)
        worst = max(worst, float(np.degrees(angle)) if found @ expected > 0 else 180.0)
    criterion("EPHEMERIS-6", worst)


def test_moon_against_meeus(criterion: Criterion) -> None:
    """1992 April 12, 0h TD: longitude 133.162655, latitude -3.229126 degrees of date, distance 368409.7 km."""
    start = epoch("1992-04-12T00:00:00", "tt")
    r, _ = states(Ephemeris.Params(body_id=301, epoch_tai_ns=start), np.array([0]))
    of_date = erfa.ecm06(*julian_dates(start)) @ r[0]
    longitude, latitude = np.arctan2(of_date[1], of_date[0]), np.arcsin(of_date[2] / np.linalg.norm(of_date))
    criterion(
        "EPHEMERIS-7",
        max(
            abs(longitude - np.radians(133.162655)),
            abs(latitude - np.radians(-3.229126)),
            abs(float(np.linalg.norm(r[0])) / 368409.7e3 - 1.0),
        ),
    )


def test_constants_of_the_body() -> None:
    module = Ephemeris("moon", Ephemeris.Params(body_id=301))
    module.step(0)
    message = module.out_ephemeris.latest()
    assert message is not None
    assert (message.body_id, message.radius) == (301, 1737.4e3)
    assert message.mu == pytest.approx(4.9028e12, rel=1e-5)
    assert Ephemeris.Params(body_id=301, mu=4.9e12, radius=1.738e6).mu == 4.9e12


def test_given_table_is_used() -> None:
    """The first coefficient is a place, the second a motion."""
    table = np.zeros((100, 14, 3))
    table[0, 0], table[0, 1] = [1e9, 2e9, 3e9], [0.0, 1e6, 0.0]
    r, v = states(Ephemeris.Params(table=table), np.array([0, SEGMENT_NS // 2, SEGMENT_NS]))
    np.testing.assert_allclose(r[:2], [[1e9, 1.999e9, 3e9], [1e9, 2e9, 3e9]], rtol=1e-15)
    np.testing.assert_allclose(v[0], [0.0, 1e6 / (2 * 86400.0), 0.0], rtol=1e-15)


def test_positions_from_elsewhere() -> None:
    """A body on a circle of ten days, as a function of TT; also in the last, partly used segment."""
    start, rate = epoch("2024-02-28"), 2.0 * np.pi / 10.0

    def circle(whole: F64, rest: F64) -> F64:
        angle = rate * ((whole - 2460369.0) + rest)
        return 4e8 * np.column_stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(angle)])

    times = np.arange(0, 6 * DAY, DAY // 7)
    r, v = states(of_positions(circle, 301, start, span=6.0 * 86400.0), times)
    whole, rest = julian_dates(start + times)
    # 14 coefficients over 0.4 turns: the next one, 2 J14(0.4 pi), is 4e-14 of the radius
    np.testing.assert_allclose(r, circle(whole, rest), rtol=0, atol=1e-3)
    angle = rate * ((whole - 2460369.0) + rest)
    np.testing.assert_allclose(v[:, 0], -4e8 * rate / 86400.0 * np.sin(angle), rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("position", "says"),
    [
        (lambda whole, rest: np.full((whole.size, 3), np.nan), "position: expected 14 rows of 3 finite numbers"),
        (lambda whole, rest: np.zeros((3, whole.size)), r"position: expected 14 rows of 3.*got shape \(3, 14\)"),
    ],
)
def test_wrong_positions_from_elsewhere(position: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        of_positions(position, 301, 0, span=86400.0)


def test_clenshaw_against_numpy() -> None:
    table, x = np.random.default_rng(6).normal(size=(2, 14, 3)), 0.37
    r, v = plain(chebyshev_state)(table, 1, x, 2.0)
    np.testing.assert_allclose(r, np.polynomial.chebyshev.chebval(x, table[1]), rtol=1e-14)
    slope = np.polynomial.chebyshev.chebval(x, np.polynomial.chebyshev.chebder(table[1]))
    np.testing.assert_allclose(v, 2.0 * slope, rtol=1e-13)


def test_time_outside_stops_the_run() -> None:
    module = Ephemeris("sun", Ephemeris.Params(span=10.0))
    with pytest.raises(ModuleError, match="span: the time is outside of the table"):
        Simulation([Task("truth", s(4), [module])]).run_until(s(12))
    assert module.out_ephemeris.t_ns == s(8)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"body_id": 12}, r"body_id: expected .*301 Moon.*got 12"),
        ({"center_id": 0}, "center_id: expected"),
        ({"body_id": 399}, "body_id: expected another body than center_id"),
        ({"span": 4e7}, "span: expected .*<= 3.456e"),
        ({"span": 0.0}, "> 0"),
        ({"span": np.nan}, "span.*NaN"),
        ({"epoch_tai_ns": 101 * 365 * DAY}, "epoch_tai_ns: .*1900 to 2100"),
        ({"epoch_tai_ns": -101 * 366 * DAY}, "epoch_tai_ns: .*1900 to 2100"),
        ({"mu": -1.0}, "mu"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Ephemeris.Params(**change)
