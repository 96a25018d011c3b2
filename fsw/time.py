"""Simulation time: integer nanoseconds everywhere; these make them from the units people write."""

from __future__ import annotations

from fractions import Fraction


def ns(seconds: float | Fraction) -> int:
    """Nanoseconds, rounded to the nearest, in a number of seconds (exact for a `Fraction`)."""
    return round(Fraction(seconds).limit_denominator(10**12) * 10**9)


def ms(milliseconds: float) -> int:
    """Nanoseconds in a number of milliseconds."""
    return ns(Fraction(milliseconds) / 1000)


def s(seconds: float | Fraction) -> int:
    """Nanoseconds in a number of seconds."""
    return ns(seconds)


def minutes(count: float) -> int:
    """Nanoseconds in a number of minutes."""
    return ns(Fraction(count) * 60)


def hours(count: float) -> int:
    """Nanoseconds in a number of hours."""
    return ns(Fraction(count) * 3600)


def hz(rate: float | Fraction) -> int | Fraction:
    """Period of a rate, ns: exact also where it is no whole number, so that tasks at 3 Hz and 1 Hz meet every second.

    Raises:
        ValueError: if the rate is not positive.
    """
    if not rate > 0:
        raise ValueError(f"a rate is positive, got {rate} Hz")
    period = 10**9 / Fraction(rate)
    return period.numerator if period.denominator == 1 else period


def text(t_ns: float | Fraction) -> str:
    """A time for people: ``12.5 s``."""
    return f"{float(t_ns) / 1e9:.9g} s"
