"""Epochs against ERFA's scales and the leap seconds of the IERS's bulletins."""

from __future__ import annotations

from typing import Any

import erfa
import numpy as np
import pytest

from fsw.math.epoch import (
    DAY,
    SECOND,
    Scale,
    calendar,
    epoch,
    julian_dates,
    tai_minus_utc,
    tt_days,
    ut1_julian_date,
)

ERFA: Any = erfa


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("1972-01-01T00:00:00Z", (1972, 1, 1, 0, 0, 0.0)),
        ("1999-12-31T23:59:59.5Z", (1999, 12, 31, 23, 59, 59.5)),
        ("2016-12-31T23:59:60.25Z", (2016, 12, 31, 23, 59, 60.25)),
        ("2017-01-01", (2017, 1, 1, 0, 0, 0.0)),
        ("2023-05-05 03:28:50", (2023, 5, 5, 3, 28, 50.0)),
        ("2024-02-29T12:30", (2024, 2, 29, 12, 30, 0.0)),
    ],
)
def test_utc_against_erfa(text: str, parts: tuple[int, int, int, int, int, float]) -> None:
    tai = ERFA.utctai(*ERFA.dtf2d("UTC", *parts))
    wanted = (tai[0] - 2451545.0 + tai[1]) * 86400.0
    assert abs(epoch(text) / 1e9 - wanted) < 2e-7  # the last digit of a Julian date counted from 2000
    utc1, utc2 = julian_dates(epoch(text), "utc")
    known = ERFA.dtf2d("UTC", *parts)
    assert abs((utc1 - known[0]) + (utc2 - known[1])) < 1e-15 * 2e6  # ERFA's own split of the day
    tt1, tt2 = julian_dates(epoch(text), "tt")
    expected = ERFA.taitt(*tai)
    assert abs((tt1 - expected[0]) + (tt2 - expected[1])) < 2e-11


def test_whole_numbers_are_exact() -> None:
    assert epoch("2000-01-01T12:00:00", "tai") == 0
    assert epoch("2000-01-01T12:00:00", "tt") == -32_184_000_000
    assert epoch("2000-01-01T12:00:00Z") == 32 * SECOND
    assert epoch("2023-05-05T03:28:50.123456789Z") - epoch("2023-05-05T03:28:50Z") == 123_456_789
    assert epoch("1950-01-01", "tai") == -(18262 * DAY + DAY // 2)


@pytest.mark.parametrize("day", ["1972-06-30", "1979-12-31", "2005-12-31", "2012-06-30", "2016-12-31"])
def test_leap_seconds_of_the_bulletins_last_a_second(day: str) -> None:
    before, leap = epoch(f"{day}T23:59:59Z"), epoch(f"{day}T23:59:60Z")
    assert leap - before == SECOND
    assert calendar(leap + 999_999_999, decimals=9) == f"{day}T23:59:60.999999999Z"
    assert calendar(leap + SECOND, decimals=0).endswith("T00:00:00Z")
    assert tai_minus_utc(leap + SECOND) - tai_minus_utc(leap) == 1
    assert epoch(calendar(leap + SECOND)) - leap == SECOND


def test_a_newer_table_of_leap_seconds_counts_at_once() -> None:
    """ERFA's table is the only one: a leap second that is announced and put there is known here."""
    table, late = ERFA.leap_seconds.get(), epoch("2034-03-01", "tai")
    assert tai_minus_utc(late) == 37
    newer = np.append(table, np.array([(2033, 7, 38.0)], table.dtype))
    try:
        ERFA.leap_seconds.set(newer)
        assert tai_minus_utc(late) == 38
        assert epoch("2033-07-01") - epoch("2033-06-30T23:59:59Z") == 2 * SECOND
    finally:
        ERFA.leap_seconds.set(table)
    assert tai_minus_utc(late) == 37


def test_text_and_back_at_random() -> None:
    rng = np.random.default_rng(1)
    scales: list[Scale] = ["utc", "tai", "tt"]
    for t in rng.integers(epoch("1972-01-02"), epoch("2034-12-30"), 300):
        for scale in scales:
            assert epoch(calendar(int(t), scale, 9), scale) == t


@pytest.mark.parametrize(
    ("text", "scale", "says"),
    [
        ("2015-12-31T23:59:60Z", "utc", "UTC had no leap second at the end of 2015-12-31"),
        ("2016-12-31T22:59:60Z", "utc", "expected a time from 00:00:00 to 23:59:59"),
        ("2016-12-31T23:59:60", "tai", "expected a time from 00:00:00 to 23:59:59"),
        ("2023-05-05T24:00:00Z", "utc", "expected a time from 00:00:00 to 23:59:59"),
        ("2023-02-29", "utc", "expected a day of the calendar"),
        ("1971-12-31", "utc", "UTC has no whole seconds before 1972"),
        ("2035-01-01", "utc", "leap seconds are not decided"),
        ("05/05/2023", "utc", "expected a date and time such as 2023-05-05T03:28:50.25Z"),
        ("2023-05-05T03:28:50.1234567891Z", "utc", "at most nine decimals"),
        ("2023-05-05T03:28:50Z", "tt", "without Z"),
        ("1600-01-01", "tt", "expected a year from 1709 to 2291"),
        ("2292-01-01", "tai", "expected a year from 1709 to 2291"),
        ("2023-05-05", "ut1", "UT1 needs Earth orientation data"),
    ],
)
def test_what_is_no_epoch_is_refused(text: str, scale: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        epoch(text, scale)


def test_utc_beyond_what_is_known_is_refused() -> None:
    late, early = epoch("2035-01-02", "tai"), epoch("1971-12-31", "tai")
    for t in (late, early):
        assert calendar(t, "tai").startswith(("2035-01-02", "1971-12-31"))
        with pytest.raises(ValueError, match="expected a day from 1972 to 2034"):
            calendar(t)
        with pytest.raises(ValueError, match="expected a day from 1972 to 2034"):
            julian_dates(np.array([0, t]), "utc")


def test_many_and_one_agree() -> None:
    times = np.array([epoch("2017-01-01"), epoch("2031-07-01T05:06:07.5Z")])
    whole, rest = julian_dates(times)
    for k, t in enumerate(times.tolist()):
        assert julian_dates(t) == (whole[k], rest[k])
        # J2000.0 is a date of TT
        assert abs(tt_days(t) - ((whole[k] - 2451545.0) + rest[k])) < 2e-12
    ut1 = ut1_julian_date(int(times[0]), -36.4)
    known = ERFA.taiut1(*julian_dates(int(times[0]), "tai"), -36.4)
    assert abs((ut1[0] - known[0]) + (ut1[1] - known[1])) < 1e-15
