"""Files of the IERS: what is read, what is between the days, what is refused; orientation from them against ERFA."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest

from fsw.math.compiled import plain
from fsw.math.earth_orientation import (
    ROWS,
    EarthParameters,
    assumed_parameters,
    earth_rotation_angle,
    gcrf_to_itrf,
    orientation,
    orientation_table,
    read_parameters,
)
from fsw.math.epoch import DAY, SECOND, epoch, julian_dates

ERFA: Any = erfa
ROOT = Path(__file__).parents[3]
C04 = ROOT / "tests/data/eopc04_2023-06-29_2023-08-30.txt"
FINALS = ROOT / "tests/data/finals2000A_extract.txt"
SERIES_14 = """\
                         EOP (IERS) 14 C04 TIME SERIES
      Date      MJD      x          y        UT1-UTC       LOD         dX        dY
2015   6  29  57202   0.131000   0.433000  -0.6748000   0.0005000   0.000100  -0.000200
2015   6  30  57203   0.132000   0.432000  -0.6755000   0.0008000   0.000110  -0.000210
2015   7   1  57204   0.133000   0.431000   0.3236000   0.0010000   0.000120  -0.000220
2015   7   2  57205   0.134000   0.430000   0.3225000   0.0010000   0.000130  -0.000230
"""


def test_days_of_files_are_read_as_they_stand() -> None:
    known = read_parameters(C04).at(epoch("2023-07-03"))
    wanted = [-0.0344896 - 37.0, *(np.array([0.190506, 0.507598, 0.000334, -0.000133]) * ERFA.DAS2R)]
    np.testing.assert_allclose(known, wanted, rtol=1e-14, atol=1e-20)
    known = read_parameters(FINALS).at(epoch("2016-12-31"))
    wanted = [-0.4077601 - 36.0, *(np.array([0.081400, 0.263094, 0.000025, -0.000169]) * ERFA.DAS2R)]
    np.testing.assert_allclose(known, wanted, rtol=1e-14, atol=1e-20)


def test_predictions_end_where_ut1_does() -> None:
    parameters = read_parameters(FINALS)
    assert len(parameters.epoch_ns) == 15
    parameters.require(epoch("2017-01-05"))
    with pytest.raises(ValueError, match=r"finals2000A_extract\.txt: expected an epoch from 2016-12-22.*2017-01-05"):
        parameters.at(epoch("2017-01-05T00:00:01Z"))
    with pytest.raises(ValueError, match="give a file of the IERS"):
        parameters.at(epoch("2035-05-05", "tai"))  # also where UTC is not known


def test_series_14_and_its_leap_second(tmp_path: Path) -> None:
    path = tmp_path / "eopc04_IAU2000.15"
    path.write_text(SERIES_14)
    parameters = read_parameters(path)
    np.testing.assert_allclose(parameters.values[:, 0], [-35.6748, -35.6755, -35.6764, -35.6775], rtol=1e-14)
    np.testing.assert_allclose(parameters.values[:, 3] / ERFA.DAS2R, [1e-4, 1.1e-4, 1.2e-4, 1.3e-4], rtol=1e-12)
    between = float(parameters.at(epoch("2015-06-30T12:00:00Z"))[0])
    assert -35.6764 < between < -35.6755


def test_interpolation_skips_a_day_well() -> None:
    """Every second day of the file predicts the days between to the scatter of the Earth itself."""
    whole = read_parameters(C04)
    half = type(whole)("every second day", whole.epoch_ns[::2], whole.values[::2])
    worst = max(abs(float(half.at(t)[0] - whole.at(t)[0])) for t in whole.epoch_ns[3:-3:2])
    assert worst < 60e-6  # s; tides of 13.7 days sampled every 2 days, and the noise of the series


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda text: text.replace("161227 57749.00", "161227 57759.00"), "a gap or step back after MJD 57748"),
        (lambda text: text.replace("-0.4035526", "-0.40355x6"), "line 5: expected a day of finals2000A"),
        (lambda text: "latitude,longitude\n" * 5, "line 1: expected a day of finals2000A"),
        (lambda text: "\n".join(text.splitlines()[:3]), "4 days or more"),
        (lambda text: "", "4 days or more"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, change: Any, says: str) -> None:
    path = tmp_path / "broken.txt"
    path.write_text(change(FINALS.read_text()))
    with pytest.raises(ValueError, match=says):
        read_parameters(path)


def test_broken_c04_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "broken.txt"
    path.write_text(SERIES_14.replace("-0.6755000   0.0008000   0.000110  -0.000210", "-0.67"))
    with pytest.raises(ValueError, match="line 4: expected a day of EOP C04"):
        read_parameters(path)


def test_assumed_ut1_must_be_near_utc() -> None:
    with pytest.raises(ValueError, match=r"ut1_minus_utc: expected at most 0\.9 s"):
        assumed_parameters(0, 37.0)
    with pytest.raises(ValueError, match="expected a day from 1972 to 2034"):
        assumed_parameters(epoch("2040-01-01", "tai"), 0.0)


def test_earth_rotation_angle_against_erfa() -> None:
    for t, ut1_tai in ((0, -32.0), (epoch("2023-05-05T03:28:50.25Z"), -37.03), (epoch("1972-02-03"), -9.5)):
        wanted = ERFA.era00(*ERFA.taiut1(2451545.0 + t // DAY, t % DAY / DAY, ut1_tai))
        assert (
            abs(math.remainder(earth_rotation_angle(t, ut1_tai) - wanted, 2.0 * math.pi)) < 5e-14
        )  # both round the product of days and turns, some 24 turns of 3.6e-15


def published_parameters(start: int) -> EarthParameters:
    """Those of the paper. It keeps the date of UT1 in one number, whose last digit is 40 us (2 cm of the place)."""
    whole, rest = julian_dates(start, "tai")
    ut1_minus_tai = ((2453101.827406783 - whole) - rest) * 86400.0
    assert ut1_minus_tai == pytest.approx(-32.4399619, abs=20e-6)
    pole = np.array([-0.140682, 0.333309, -0.000199, -0.000252]) * ERFA.DAS2R
    return EarthParameters("the paper", (), np.array([[ut1_minus_tai, *pole]]))


def test_published_example_of_gcrf_to_itrf() -> None:
    """Vallado, Seago and Seidelmann (2006), "Implementation Issues Surrounding the New IAU Reference Systems"."""
    start = epoch("2004-04-06T07:51:28.386009Z")
    parameters = published_parameters(start)
    r_itrf = np.array([-1033.4793830e3, 7901.2952754e3, 6380.3565958e3])
    r_gcrf = np.array([5102.5089530e3, 6123.0113955e3, 6378.1369371e3])
    # the paper has X and Y of IAU 2000A: with them ERFA gives its place to the last printed digit
    _, xp, yp, dx, dy = parameters.values[0]
    tt, ut1 = julian_dates(start, "tt"), (2453101.827406783, 0.0)
    x, y, s = ERFA.xys00a(*tt)
    old = ERFA.c2tcio(ERFA.c2ixys(x + dx, y + dy, s), ERFA.era00(*ut1), ERFA.pom00(xp, yp, ERFA.sp00(*tt)))
    np.testing.assert_allclose(old @ r_gcrf, r_itrf, rtol=0, atol=1.5e-4)
    # the precession of 2006 moves the pole by 23 micro arc seconds in four years: 1 mm at 10,200 km
    np.testing.assert_allclose(gcrf_to_itrf(start, parameters) @ r_gcrf, r_itrf, rtol=0, atol=1.3e-3)
    first, rows, table = orientation_table(start, DAY, parameters)
    dcm, _ = plain(orientation)(start, first, rows, table)
    np.testing.assert_allclose(np.array(dcm) @ r_gcrf, r_itrf, rtol=0, atol=1.3e-3)


def test_a_long_table_stays_below_a_millimetre() -> None:
    start = epoch("2024-02-02T13:00:00Z")
    parameters = assumed_parameters(start, -0.01)
    turned = plain(orientation)
    first, rows, table = orientation_table(start, 399 * DAY, parameters)
    assert rows <= ROWS
    times = [start, start + 399 * DAY, *(start + np.random.default_rng(4).integers(0, 399 * DAY, 80)).tolist()]
    for t in times:
        dcm = np.array(turned(int(t), first, rows, table)[0])
        assert np.abs(dcm - gcrf_to_itrf(int(t), parameters)).max() * 6.378137e6 < 1e-3
    assert np.isnan(turned(start - DAY, first, rows, table)[0]).all()
    assert np.isnan(turned(start + 401 * DAY, first, rows, table)[0]).all()


def test_a_moment_needs_two_rows_only() -> None:
    parameters = read_parameters(C04)
    end = epoch("2023-08-30")
    for start in (end, end - SECOND, epoch("2023-06-29")):
        first, rows, table = orientation_table(start, 0, parameters)
        assert rows == 2
        np.testing.assert_allclose(
            plain(orientation)(start, first, rows, table)[0], gcrf_to_itrf(start, parameters), atol=2e-11
        )
