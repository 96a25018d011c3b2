"""EarthOrientation against ERFA, whose whole chain c2t06a is not what the module's table is made of."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest

from fsw import Simulation, Task, minutes, s
from fsw.math.earth_orientation import EarthParameters, assumed_parameters, read_parameters
from fsw.math.epoch import DAY, SECOND, epoch
from messages.base import F64
from sim.environment.earth_orientation import EarthOrientation, aligned, earth_rotation, iau2006

ERFA: Any = erfa
Criterion = Callable[[str, float], None]
ROOT = Path(__file__).parents[3]
RADIUS = 6.378137e6
C04 = ROOT / "tests/data/eopc04_2023-06-29_2023-08-30.txt"
FINALS = ROOT / "tests/data/finals2000A_extract.txt"


def at(params: EarthOrientation.Params, t_ns: int) -> tuple[F64, F64]:
    """Rotation and rate that the module publishes when it runs at one time."""
    module = EarthOrientation("earth", params)
    Simulation([Task("truth", s(1), [module], phase=t_ns)]).run_until(t_ns)
    message = module.out_orientation.latest()
    assert message is not None
    return message.dcm_EN, message.omega_EN_N


def by_erfa(t: int, parameters: EarthParameters) -> F64:
    """The classical chain of ERFA with matrices of IAU 2006 precession and nutation, times by its own functions."""
    ut1_tai, xp, yp, dx, dy = parameters.at(t)
    tai = (2451545.0 + t // DAY, t % DAY / DAY)
    tt = ERFA.taitt(*tai)
    ut1 = ERFA.taiut1(*tai, ut1_tai)
    if dx == dy == 0.0:
        return ERFA.c2t06a(*tt, *ut1, xp, yp)
    x, y = ERFA.bpn2xy(ERFA.pnm06a(*tt))
    return ERFA.c2txy(*tt, *ut1, x + dx, y + dy, xp, yp)


def recorded(params: EarthOrientation.Params, times: list[int]) -> list[F64]:
    """Rotations at many times."""
    earth = EarthOrientation("earth", params)
    simulation = Simulation([Task("truth", minutes(7), [earth])])
    record = earth.out_orientation.record()
    simulation.run_until(times[-1])
    dcm: F64 = record["dcm_EN"]
    return [dcm[t // minutes(7)] for t in times]


def test_iau2006_against_erfa(criterion: Criterion) -> None:
    parameters, start = read_parameters(C04), epoch("2023-06-30T05:11:00Z")
    picks = np.random.default_rng(3).choice(60 * 24 * 60 // 7, 300, replace=False)
    times = sorted(int(k) * minutes(7) for k in picks)
    worst = 0.0
    for t, dcm in zip(times, recorded(iau2006(start, 60 * DAY, parameters), times), strict=True):
        worst = max(worst, float(np.abs(dcm - by_erfa(start + t, parameters)).max()) * RADIUS)
    # without offsets of the pole ERFA has the whole chain in one function
    plain, start = assumed_parameters(start, 0.2), epoch("2031-03-01")
    times = times[::10]
    for t, dcm in zip(times, recorded(iau2006(start, 60 * DAY, plain), times), strict=True):
        worst = max(worst, float(np.abs(dcm - by_erfa(start + t, plain)).max()) * RADIUS)
    criterion("EARTHORIENT-1", worst)


def test_leap_second(criterion: Criterion) -> None:
    """Around the leap second at the end of 2016 the rotation goes on evenly, and UT1 is that of the file."""
    parameters, start = read_parameters(FINALS), epoch("2016-12-31T12:00:00Z")
    params = iau2006(start, DAY, parameters)
    worst = 0.0
    for text in ("2016-12-31T23:59:59Z", "2016-12-31T23:59:60Z", "2017-01-01T00:00:00Z", "2017-01-01T07:00:00Z"):
        t = epoch(text)
        dcm, _ = at(params, t - start)
        worst = max(worst, float(np.abs(dcm - by_erfa(t, parameters)).max()) * RADIUS)
    criterion("EARTHORIENT-2", worst)
    # UT1 - UTC of the file at midnight is 0.5912821 s; a leap second missed would be 465 m
    assert float(parameters.at(epoch("2017-01-01"))[0]) == pytest.approx(0.5912821 - 37.0, abs=1e-12)
    before, after = parameters.at(epoch("2017-01-01") - SECOND), parameters.at(epoch("2017-01-01"))
    assert abs(float(after[0] - before[0])) < 1e-7


def test_rate_is_that_of_the_rotation(criterion: Criterion) -> None:
    parameters, start = read_parameters(C04), epoch("2023-07-10T00:00:00Z")
    params, step, worst = iau2006(start, 10 * DAY, parameters), 10 * SECOND, 0.0
    for t in (7 * SECOND + DAY // 3, 3 * DAY + 11 * SECOND, 8 * DAY):
        dcm, omega = at(params, t)
        ahead, behind = at(params, t + step)[0], at(params, t - step)[0]
        turn = ahead @ behind.T  # by 20 s of rate, exactly a rotation vector
        vector = np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]])
        sine = np.linalg.norm(vector) / 2.0
        numeric = vector / (2.0 * sine) * math.asin(sine) / 20.0
        worst = max(worst, float(np.abs(dcm.T @ numeric - omega).max()))
    criterion("EARTHORIENT-3", worst)


def test_earth_rotation_angle_against_erfa(criterion: Criterion) -> None:
    parameters, start = read_parameters(C04), epoch("2023-07-10T00:00:00Z")
    params, worst = earth_rotation(start, parameters), 0.0
    for t in (0, 12345 * SECOND, 200 * DAY + 77 * SECOND):
        dcm, omega = at(params, t)
        day = ERFA.taiut1(2451545.0 + (start + t) // DAY, (start + t) % DAY / DAY, params.ut1_minus_tai)
        wanted = ERFA.era00(*day)
        found = math.atan2(dcm[0, 1], dcm[0, 0])
        worst = max(worst, abs(math.remainder(found - wanted, 2.0 * math.pi)))
        np.testing.assert_allclose(omega, [0.0, 0.0, 7.292115e-5], rtol=1e-7)
    criterion("EARTHORIENT-4", worst)


def test_aligned_at_start(criterion: Criterion) -> None:
    """E's x axis, in N, goes from x towards y: the source has this rotation transposed."""
    first, _ = at(aligned(), 0)
    np.testing.assert_array_equal(first, np.eye(3))
    dcm, omega = at(aligned(), 6 * 3600 * SECOND)
    angle = 7.292115e-5 * 6 * 3600
    axis = dcm.T @ [1.0, 0.0, 0.0]
    criterion("EARTHORIENT-5", float(np.abs(axis - [math.cos(angle), math.sin(angle), 0.0]).max()))
    assert axis[1] > 0.9
    np.testing.assert_array_equal(omega, [0.0, 0.0, 7.292115e-5])


def test_what_is_not_covered_is_refused() -> None:
    parameters = read_parameters(C04)
    with pytest.raises(ValueError, match=r"eopc04.*expected an epoch from 2023-06-29.*got 2023-05-05"):
        iau2006(epoch("2023-05-05"), DAY, parameters)
    with pytest.raises(ValueError, match="expected an epoch from"):
        iau2006(epoch("2023-08-29"), 2 * DAY, parameters)
    with pytest.raises(ValueError, match="expected 0 to 399 days, got 500 days"):
        iau2006(0, 500 * DAY, assumed_parameters(0, 0.0))
    with pytest.raises(ValueError, match=r"ut1_minus_tai: expected UT1 - TAI"):
        EarthOrientation.Params(mode=1, epoch_tai_ns=0)
    with pytest.raises(ValueError, match=r"table_rows: expected a table"):
        EarthOrientation.Params(mode=2, epoch_tai_ns=0)
    with pytest.raises(ValueError, match="mode"):
        EarthOrientation.Params(mode=3, epoch_tai_ns=0)
    start = epoch("2023-07-10T00:00:00Z")
    earth = EarthOrientation("earth", iau2006(start, DAY, parameters))
    with pytest.raises(Exception, match=r"Params\.table"):
        Simulation([Task("truth", s(3600), [earth])]).run_until(2 * DAY)
