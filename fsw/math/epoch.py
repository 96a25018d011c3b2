"""Epochs: UTC text, and the time scales UTC, TAI, TT and UT1, as one integer.

An epoch is a count of TAI nanoseconds since 2000-01-01T12:00:00 TAI. TAI runs evenly, so a difference of two epochs is
a duration, leap seconds included. Julian dates come in two parts, as ERFA takes them: whole days (ending in .5 or .0,
exact) and the rest of a day, good to 1e-11 s.

Simulation time zero is an epoch that a scenario chooses and hands to every module that needs the calendar::

    start = epoch("2023-07-03T12:00:00Z")
    sun = Ephemeris("sun", Ephemeris.Params(epoch_tai_ns=start))
    earth = EarthOrientation("earth", iau2006(start, hours(24), read_parameters("finals2000A.all")))
    print(calendar(start + t_ns))  # the time of a message, for people

Leap seconds are those of ERFA's table, up to the one at the end of 2016; `erfa.leap_seconds.update` takes a newer one.
UTC is used from 1972 to 2034: earlier it had another definition, later leap seconds are not decided (CGPM 2022,
resolution 4). Dates outside are refused in UTC and accepted in TAI and TT. Source: Explanatory Supplement to the
Astronomical Almanac, 3rd ed., ch. 3.
"""

from __future__ import annotations

import functools
import re
from bisect import bisect_right
from datetime import date
from typing import Any, Literal, TypeAlias, overload

import erfa
import numpy as np

from fsw.math.compiled import compiled
from messages.base import F64, I64

ERFA: Any = erfa

Scale: TypeAlias = Literal["utc", "tai", "tt"]

SECOND = 10**9
DAY = 86_400 * SECOND
"""Nanoseconds of a day without leap second."""
TT_MINUS_TAI = 32_184_000_000
"""TT - TAI [ns], by definition."""
J2000_JD = 2451545.0
"""Julian date of 2000-01-01T12:00:00 in the scale it is used with."""

_NOON = date(2000, 1, 1).toordinal()
_TEXT = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d)(?:\.(\d+))?)?)?(Z?)")
_UTC_END = date(2035, 1, 1)


def _leap_table() -> tuple[list[date], list[int], list[int]]:
    """Days at whose beginning TAI - UTC changes, from 1972, the seconds that it then has, and the days' epochs."""
    return _read_leap_table(ERFA.leap_seconds.get().tobytes())


@functools.lru_cache(maxsize=1)
def _read_leap_table(_: bytes) -> tuple[list[date], list[int], list[int]]:
    """ERFA's table, whose bytes are the argument: read again only when it has changed."""
    rows = [r for r in ERFA.leap_seconds.get() if r["year"] >= 1972]
    days, seconds = [date(int(r["year"]), int(r["month"]), 1) for r in rows], [round(float(r["tai_utc"])) for r in rows]
    starts = [(d.toordinal() - _NOON) * DAY - DAY // 2 + s * SECOND for d, s in zip(days, seconds, strict=True)]
    return days, seconds, starts


def _tai_minus_utc(day: date, what: str) -> int:
    days, seconds, _ = _leap_table()
    if not days[0] <= day < _UTC_END:
        why = "UTC has no whole seconds before 1972" if day < days[0] else "leap seconds are not decided from 2035 on"
        raise ValueError(f"{what}: expected a day from 1972 to 2034, got {day}: {why}; give the epoch in TAI or TT")
    return seconds[bisect_right(days, day) - 1]


def _has_leap_second(day: date) -> bool:
    days, _, _ = _leap_table()
    return date.fromordinal(day.toordinal() + 1) in days[1:]


def epoch(text: str, scale: Scale = "utc") -> int:
    """The epoch of a calendar date and time.

    Args:
        text: ``2023-05-05T03:28:50.25Z``; time, seconds and up to nine decimals may be left out. Seconds are 60 in a
            leap second. The Z is allowed for UTC only.
        scale: "utc", "tai" or "tt".

    Returns:
        TAI nanoseconds since 2000-01-01T12:00:00 TAI.

    Raises:
        ValueError: if the text is no date or time, or names a leap second that was not, or UTC is not known then, or
            the year is not from 1709 to 2291.
    """
    where = f"epoch({text!r}, {scale!r})"
    if scale not in ("utc", "tai", "tt"):
        raise ValueError(f"{where}: expected the scale utc, tai or tt; UT1 needs Earth orientation data")
    found = _TEXT.fullmatch(text.strip())
    if found is None or (found[8] and scale != "utc") or len(found[7] or "") > 9:
        example = "2023-05-05T03:28:50.25Z" if scale == "utc" else "2023-05-05T03:28:50.25 (without Z)"
        raise ValueError(f"{where}: expected a date and time such as {example}, at most nine decimals")
    try:
        day = date(int(found[1]), int(found[2]), int(found[3]))
    except ValueError as error:
        raise ValueError(f"{where}: expected a day of the calendar: {error}") from None
    hour, minute, second = (int(found[k] or 0) for k in (4, 5, 6))
    offset = _tai_minus_utc(day, where) * SECOND if scale == "utc" else 0
    leap = scale == "utc" and (hour, minute, second) == (23, 59, 60)
    if leap and not _has_leap_second(day):
        raise ValueError(f"{where}: expected seconds up to 59, got 60: UTC had no leap second at the end of {day}")
    if hour > 23 or minute > 59 or (second > 59 and not leap):
        raise ValueError(f"{where}: expected a time from 00:00:00 to 23:59:59, got {hour:02}:{minute:02}:{second:02}")
    fraction = int((found[7] or "").ljust(9, "0"))
    clock = ((hour * 60 + minute) * 60 + second) * SECOND + fraction
    if not 1709 <= day.year <= 2291:
        raise ValueError(
            f"{where}: expected a year from 1709 to 2291, got {day.year}: 64 bits hold no other nanoseconds"
        )
    count = (day.toordinal() - _NOON) * DAY - DAY // 2 + clock
    return count + (offset if scale == "utc" else -TT_MINUS_TAI if scale == "tt" else 0)


def tai_minus_utc(epoch_ns: int) -> int:
    """TAI - UTC [s] at an epoch; during a leap second still the old value.

    Raises:
        ValueError: if UTC is not known at the epoch (before 1972, from 2035 on).
    """
    _, seconds, starts = _leap_table()
    k = bisect_right(starts, epoch_ns) - 1
    day = date.fromordinal(_NOON + (epoch_ns + DAY // 2 - seconds[k] * SECOND) // DAY)
    return seconds[k] if k >= 0 and day < _UTC_END else _tai_minus_utc(day, f"epoch {epoch_ns} ns")


def calendar(epoch_ns: int, scale: Scale = "utc", decimals: int = 3) -> str:
    """The date and time of an epoch, ``2023-05-05T03:28:50.250Z``: the inverse of `epoch`.

    Args:
        epoch_ns: TAI nanoseconds since 2000-01-01T12:00:00 TAI.
        scale: "utc", "tai" or "tt"; only UTC ends in Z.
        decimals: of the seconds, 0 to 9; further ones are cut off, so that a time never moves to the next second.

    Raises:
        ValueError: if UTC is not known at the epoch.
    """
    offset = tai_minus_utc(epoch_ns) * SECOND if scale == "utc" else 0
    local = epoch_ns + (TT_MINUS_TAI if scale == "tt" else 0) - offset + DAY // 2
    days, clock = divmod(local, DAY)
    day, extra = date.fromordinal(_NOON + days), 0
    if scale == "utc" and _tai_minus_utc(day, "calendar") * SECOND > offset:  # the leap second: still the day before
        day, clock, extra = date.fromordinal(_NOON + days - 1), DAY - SECOND + clock, 1
    seconds, fraction = divmod(clock, SECOND)
    text = f"{day.isoformat()}T{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60 + extra:02}"
    part = f".{fraction:09}"[: decimals + 1] if decimals > 0 else ""
    return text + part + ("Z" if scale == "utc" else "")


@overload
def julian_dates(epoch_ns: int, scale: Scale = "tt") -> tuple[float, float]: ...
@overload
def julian_dates(epoch_ns: I64, scale: Scale = "tt") -> tuple[F64, F64]: ...
def julian_dates(epoch_ns: Any, scale: Scale = "tt") -> tuple[Any, Any]:
    """Two-part Julian date of an epoch, or of many (n,).

    Args:
        epoch_ns: TAI nanoseconds since 2000-01-01T12:00:00 TAI.
        scale: "tt", "tai" or "utc". UTC is ERFA's quasi Julian date, whose day is longer if it has a leap second.

    Returns:
        Whole days and the rest [days]; their sum is the date.

    Raises:
        ValueError: if UTC is not known at an epoch.
    """
    if scale == "utc":
        if np.ndim(epoch_ns) == 0:
            tai_minus_utc(int(epoch_ns))
        else:
            tai_minus_utc(int(np.min(epoch_ns)))
            tai_minus_utc(int(np.max(epoch_ns)))
        return ERFA.taiutc(*julian_dates(epoch_ns, "tai"))
    count = epoch_ns + (TT_MINUS_TAI if scale == "tt" else 0)
    return J2000_JD + count // DAY, count % DAY / DAY


def ut1_julian_date(epoch_ns: int, ut1_minus_tai: float) -> tuple[float, float]:
    """Two-part Julian date in UT1.

    Args:
        epoch_ns: TAI nanoseconds since 2000-01-01T12:00:00 TAI.
        ut1_minus_tai: UT1 - TAI [s] at the epoch, from Earth orientation data; it has no leap seconds.
    """
    whole, rest = julian_dates(epoch_ns, "tai")
    return whole, rest + ut1_minus_tai / 86400.0


@compiled
def tt_days(epoch_ns: int) -> float:
    """Days of TT since J2000.0 (2000-01-01T12:00:00 TT), for series in a kernel; good to 1e-12 days within 20 years."""
    return (epoch_ns + 32_184_000_000) / 86_400e9
