"""Positions of the Sun, the Moon and the planets: series of ERFA at set-up, Chebyshev polynomials in kernels.

ERFA's series: Earth by `epv00`, Moon by `moon98`, other planets by `plan94`. RMS errors against JPL's DE421 from 1980
to 2040: Sun 4 km, Moon 6 km, Venus 1,100 km, Mars 7,600 km, outer planets 1e5 to 5e5 km. Axes of the GCRF, geometric:
no light time, no aberration. The scale TT stands for TDB: below 2 ms, which moves the Earth by less than 60 m.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import erfa
import numpy as np

from fsw.math.bodies import Body, body
from fsw.math.compiled import compiled
from fsw.math.epoch import DAY, J2000_JD, julian_dates
from fsw.math.forces import ASTRONOMICAL_UNIT
from fsw.math.vectors import V3
from messages.base import F64

ERFA: Any = erfa
ORDER = 14
"""Coefficients of a Chebyshev polynomial."""
SEGMENT_NS = 4 * DAY
"""Duration of one polynomial, ns."""
Position: TypeAlias = Callable[[F64, F64], F64]
"""Positions (n, 3), m, at n Julian dates in two parts, TT."""

SERIES = {10: 0, 199: 1, 299: 2, 301: 0, 399: 0, 499: 4, 599: 5, 699: 6, 799: 7, 899: 8}
"""Numbers of planets in `plan94` by NAIF identifier; 0 for Sun, Moon and Earth, which have other series."""
BODIES: dict[int, Body] = {k: body(k) for k in SERIES}
"""Bodies with an ephemeris, by NAIF identifier."""


def known_body(body_id: int, field: str) -> Body:
    """A body with an ephemeris.

    Raises:
        ValueError: if it has none; the text begins with ``field`` and lists what there is.
    """
    if body_id not in BODIES:
        known = ", ".join(f"{k} {b.name}" for k, b in BODIES.items())
        raise ValueError(f"{field}: expected the NAIF identifier of a body with an ephemeris ({known}), got {body_id}")
    return BODIES[body_id]


def heliocentric(body_id: int, whole: F64, rest: F64) -> tuple[F64, F64]:
    """Position and velocity of a body relative to the Sun, m and m/s, GCRF axes.

    Args:
        body_id: NAIF identifier, a key of `BODIES`.
        whole: (n,) first parts of Julian dates in TT, 1900 to 2100.
        rest: (n,) second parts.

    Returns:
        Two arrays (n, 3).
    """
    known_body(body_id, "body_id")
    pv: F64
    if body_id == 10:
        pv = np.zeros((np.size(whole), 2, 3))
    elif SERIES[body_id]:
        found = ERFA.plan94(whole, rest, SERIES[body_id])
        pv = np.stack([found["p"], found["v"]], axis=-2)
    else:
        around_sun, _ = ERFA.epv00(whole, rest)
        pv = np.stack([around_sun["p"], around_sun["v"]], axis=-2)
        if body_id == 301:
            moon = ERFA.moon98(whole, rest)
            pv += np.stack([moon["p"], moon["v"]], axis=-2)
    return pv[:, 0] * ASTRONOMICAL_UNIT, pv[:, 1] * (ASTRONOMICAL_UNIT / 86400.0)


def relative_position(body_id: int, center_id: int, whole: F64, rest: F64) -> F64:
    """Position (n, 3) of a body relative to another, m, GCRF axes; arguments as for `heliocentric`."""
    if {body_id, center_id} == {301, 399}:  # not by a difference of distances to the Sun
        moon = ERFA.moon98(whole, rest)["p"] * ASTRONOMICAL_UNIT
        return moon if body_id == 301 else -moon
    return heliocentric(body_id, whole, rest)[0] - heliocentric(center_id, whole, rest)[0]


def chebyshev_fit(position: Position, epoch_ns: int, segments: int) -> F64:
    """Coefficients (segments, 14, 3), m, of polynomials that interpolate a position at the Chebyshev points.

    Args:
        position: takes two parts of n Julian dates in TT (n,), (n,); returns positions (n, 3), m.
        epoch_ns: beginning of the first segment, TAI ns since 2000-01-01T12:00:00 TAI.
        segments: number of segments of four days.

    Raises:
        ValueError: if positions are not (n, 3) or not finite.
    """
    angles = np.pi * (np.arange(ORDER) + 0.5) / ORDER
    points = (0.5 * (1.0 - np.cos(angles)) * SEGMENT_NS).astype(np.int64)
    times = epoch_ns + SEGMENT_NS * np.arange(segments)[:, None] + points
    values = np.asarray(position(*julian_dates(times.ravel())), np.float64)
    if values.shape != (times.size, 3) or not np.all(np.isfinite(values)):
        raise ValueError(f"position: expected {times.size} rows of 3 finite numbers (m), got shape {values.shape}")
    x = 2.0 * points / SEGMENT_NS - 1.0
    vandermonde = np.polynomial.chebyshev.chebvander(x, ORDER - 1)
    table = np.linalg.solve(vandermonde, values.reshape(segments, ORDER, 3))
    return np.asarray(table, np.float64)


def chebyshev_table(body_id: int, center_id: int, epoch_ns: int, segments: int) -> F64:
    """`chebyshev_fit` of ERFA's series, for bodies of `BODIES`.

    Raises:
        ValueError: if a body is not known, or if a time is outside of 1900 to 2100.
    """

    def position(whole: F64, rest: F64) -> F64:
        if np.min(whole) < J2000_JD - 36524.0 or np.max(whole) > J2000_JD + 36524.0:
            raise ValueError("epoch_tai_ns: the series of Sun, Moon and planets hold from 1900 to 2100, got others")
        return relative_position(body_id, center_id, whole, rest)

    return chebyshev_fit(position, epoch_ns, segments)


@compiled
def chebyshev_state(table: F64, segment: int, x: float, rate: float) -> tuple[V3, V3]:
    """Value and time derivative of three Chebyshev sums, by Clenshaw's recursion.

    Args:
        table: (segments, n, 3) coefficients.
        segment: first index of the table.
        x: argument, -1 to 1.
        rate: time derivative of ``x``, 1/s.

    Returns:
        Value, in the unit of the coefficients, and derivative, per second.
    """
    x2 = 2.0 * x
    a0 = a1 = a2 = b0 = b1 = b2 = 0.0  # of the value
    c0 = c1 = c2 = d0 = d1 = d2 = 0.0  # derivatives of these by x
    for i in range(table.shape[1] - 1, 0, -1):
        c0, d0 = 2.0 * a0 + x2 * c0 - d0, c0
        c1, d1 = 2.0 * a1 + x2 * c1 - d1, c1
        c2, d2 = 2.0 * a2 + x2 * c2 - d2, c2
        a0, b0 = table[segment, i, 0] + x2 * a0 - b0, a0
        a1, b1 = table[segment, i, 1] + x2 * a1 - b1, a1
        a2, b2 = table[segment, i, 2] + x2 * a2 - b2, a2
    value = (
        table[segment, 0, 0] + x * a0 - b0,
        table[segment, 0, 1] + x * a1 - b1,
        table[segment, 0, 2] + x * a2 - b2,
    )
    return value, (rate * (a0 + x * c0 - d0), rate * (a1 + x * c1 - d1), rate * (a2 + x * c2 - d2))
