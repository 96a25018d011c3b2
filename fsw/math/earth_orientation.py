"""How the Earth is turned: orientation parameters from IERS files, and GCRF to ITRF by IAU 2006/2000A.

The matrix is ``dcm_EN = W R3(ERA - s + s') M(X, Y)`` with the celestial pole X, Y, its locator s, the Earth rotation
angle ERA of UT1 and polar motion W (IERS Conventions 2010, ch. 5). All but ERA change slowly: `orientation_table`
samples them with ERFA every half day, and the compiled `orientation` interpolates them (cubic Hermite), which agrees
with ERFA to below 0.1 mm at the surface. Tides of less than a day are left out: 0.1 ms of UT1 (5 cm at the equator),
1 mas of the pole (3 cm).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import erfa
import numpy as np
from scipy.interpolate import CubicSpline

from fsw.math.compiled import compiled
from fsw.math.epoch import DAY, calendar, epoch, julian_dates, tai_minus_utc, ut1_julian_date
from fsw.math.vectors import M3, V3, axpy, cross, matmul
from messages.base import F64, I64

ERFA: Any = erfa
SPLINE: Any = CubicSpline

ROWS = 800
"""Most rows of a table: half-day steps for 399 days."""
STEP = DAY // 2
"""Between rows of a table [ns]."""
COLUMNS = 12
"""X, Y, s' - s, pole x, pole y [rad], UT1 - TAI [s], then their derivatives per day."""

ARCSEC = math.pi / 648000.0
OMEGA_EARTH = 7.292115e-5
"""Rate of the Earth, WGS84 [rad/s]."""
_MARGIN = 8  # rows beyond both ends of a table, so that the slopes of the spline through them are good
_MJD_ZERO = date(1858, 11, 17).toordinal()


@dataclass(frozen=True)
class EarthParameters:
    """Orientation of the Earth at 0 h UTC of successive days, or assumed constants.

    Attributes:
        source: where they come from, for messages.
        epoch_ns: (n,) epochs, TAI ns since 2000-01-01T12:00:00 TAI; empty if assumed.
        values: (n, 5): UT1 - TAI [s], pole x, y [rad], celestial pole offsets dX, dY [rad]; one row if assumed.
    """

    source: str
    epoch_ns: tuple[int, ...]
    values: F64

    def at(self, epoch_ns: int) -> F64:
        """Values (5,) at an epoch, by cubic splines.

        UT1 - TAI is interpolated, not UT1 - UTC, so that leap seconds leave no step.

        Raises:
            ValueError: if the epoch is outside the data.
        """
        self.require(epoch_ns)
        return self.sample(np.array([epoch_ns]))[0][0]

    def require(self, epoch_ns: int) -> None:
        """Check that an epoch is within the data.

        Raises:
            ValueError: if it is not.
        """
        if self.epoch_ns and not self.epoch_ns[0] <= epoch_ns <= self.epoch_ns[-1]:
            first, last = calendar(self.epoch_ns[0]), calendar(self.epoch_ns[-1])
            raise ValueError(
                f"Earth orientation parameters of {self.source}: expected an epoch from {first} to {last}, got "
                f"{calendar(epoch_ns, 'tai')} TAI; give a file of the IERS that covers it"
            )

    def sample(self, epoch_ns: I64) -> tuple[F64, F64]:
        """Values (n, 5) and their derivatives per day (n, 5) at epochs (n,); no check of the ends."""
        if not self.epoch_ns:
            values = np.repeat(self.values, len(epoch_ns), axis=0)
            return values, np.zeros_like(values)
        first = self.epoch_ns[0]
        spline = SPLINE((np.array(self.epoch_ns) - first) / DAY, self.values)
        days = (epoch_ns - first) / DAY
        return spline(days), spline(days, 1)


def assumed_parameters(epoch_ns: int, ut1_minus_utc: float) -> EarthParameters:
    """Constants for use without a file: a UT1 - UTC, and a pole that does not move.

    The true UT1 - UTC is within 0.9 s by definition (420 m at the equator), the pole within 0.6 arc seconds of its
    place (18 m), and its offsets below 1 mas (3 cm).

    Args:
        epoch_ns: when; UT1 - TAI is kept from there on.
        ut1_minus_utc: UT1 - UTC [s], 0 if unknown.

    Raises:
        ValueError: if it is not within 0.9 s, or UTC is not known at the epoch.
    """
    if not abs(ut1_minus_utc) <= 0.9:
        raise ValueError(f"assumed_parameters: ut1_minus_utc: expected at most 0.9 s either way, got {ut1_minus_utc}")
    values = np.array([[ut1_minus_utc - tai_minus_utc(epoch_ns), 0.0, 0.0, 0.0, 0.0]])
    return EarthParameters(f"an assumed UT1 - UTC of {ut1_minus_utc:g} s, pole fixed", (), values)


def read_parameters(path: Path | str) -> EarthParameters:
    """Parameters of a file of the IERS: ``finals2000A.all`` (or .daily, .data), or EOP C04 of series 14 or 20.

    The data end where UT1 does. Celestial pole offsets that are missing count as 0 (below 1 mas, 3 cm).

    Raises:
        ValueError: if the file is neither, a line cannot be read, or a day is missing.
    """
    path = Path(path)
    lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    c04 = any("C04" in line for line in lines[:20])
    rows: list[tuple[int, list[float]]] = []
    for number, line in enumerate(lines, 1):
        try:
            row = _c04_row(line) if c04 else _finals_row(line)
        except (ValueError, IndexError):
            kind = "EOP C04" if c04 else "finals2000A"
            raise ValueError(f"{path.name}, line {number}: expected a day of {kind}, got {line[:60]!r}") from None
        if row is not None and row[0] >= 41317:  # 1972: UTC as it is now
            rows.append(row)
    if len(rows) < 4:
        raise ValueError(f"{path.name}: expected a finals2000A or EOP C04 file of the IERS with 4 days or more")
    days = np.array([day for day, _ in rows])
    if np.any(np.diff(days) != 1):
        gap = int(days[int(np.argmax(np.diff(days) != 1))])
        raise ValueError(f"{path.name}: expected successive days, got a gap or step back after MJD {gap}")
    when = tuple(epoch(date.fromordinal(_MJD_ZERO + int(day)).isoformat()) for day in days)
    values = np.array([row for _, row in rows])
    values[:, 0] -= [tai_minus_utc(t) for t in when]
    values[:, 1:] *= ARCSEC
    return EarthParameters(path.name, when, values)


def _finals_row(line: str) -> tuple[int, list[float]] | None:
    """MJD, and UT1 - UTC [s], x, y, dX, dY ["]; None if the day has no UT1 (the end of the predictions)."""
    if not line.strip():
        return None
    day = round(float(line[7:15]))
    if not line[58:68].strip():
        return None
    offsets = [float(text) / 1000.0 if text.strip() else 0.0 for text in (line[97:106], line[116:125])]
    return day, [float(line[58:68]), float(line[18:27]), float(line[37:46]), *offsets]


def _c04_row(line: str) -> tuple[int, list[float]] | None:
    """Likewise; None for lines of the header."""
    words = line.split()
    if len(words) < 9 or not words[0].isdigit() or len(words[0]) != 4:
        if line.strip() and line.strip()[0].isdigit():
            raise ValueError
        return None
    if len(words[3]) == 5:  # series 14: MJD x y UT1 LOD dX dY; series 20 has the hour before the MJD
        x, y, ut1, _, dx, dy = (float(w) for w in words[4:10])
        return int(words[3]), [ut1, x, y, dx, dy]
    x, y, ut1, dx, dy = (float(w) for w in words[5:10])
    return round(float(words[4])), [ut1, x, y, dx, dy]


def gcrf_to_itrf(epoch_ns: int, parameters: EarthParameters) -> F64:
    """dcm_EN (3, 3) at one epoch by ERFA, for set-up: N is GCRF, E is ITRF.

    Raises:
        ValueError: if the epoch is outside the parameters.
    """
    ut1_tai, xp, yp, dx, dy = parameters.at(epoch_ns)
    tt, ut1 = julian_dates(epoch_ns, "tt"), ut1_julian_date(epoch_ns, float(ut1_tai))
    x, y, s = ERFA.xys06a(*tt)
    celestial = ERFA.c2ixys(x + dx, y + dy, s)
    return ERFA.c2tcio(celestial, ERFA.era00(*ut1), ERFA.pom00(xp, yp, ERFA.sp00(*tt)))


def orientation_table(epoch_ns: int, duration_ns: int, parameters: EarthParameters) -> tuple[int, int, F64]:
    """Samples that the compiled `orientation` interpolates.

    Args:
        epoch_ns: first epoch that is wanted, TAI ns since 2000-01-01T12:00:00 TAI.
        duration_ns: how long after it.
        parameters: of a file, or assumed.

    Returns:
        Epoch of the first row [ns], number of rows, and rows (ROWS, COLUMNS); unused ones are 0.

    Raises:
        ValueError: if the parameters do not cover the time, or it is longer than 398 days.
    """
    last = epoch_ns + duration_ns
    parameters.require(epoch_ns)
    parameters.require(last)
    # rows at 0 h and 12 h UTC, where the pieces of the parameters' splines meet: the Hermite pieces are then the same
    days = parameters.epoch_ns or (epoch_ns,)
    midnight = days[bisect_right(days, epoch_ns) - 1]
    start = midnight + (epoch_ns - midnight) // STEP * STEP
    rows = max(-(-(last - start) // STEP) + 1, 2)
    if duration_ns < 0 or rows > ROWS:
        longest, given = ROWS // 2 - 1, duration_ns / DAY
        raise ValueError(f"orientation_table: duration_ns: expected 0 to {longest} days, got {given:g} days")
    when = start + STEP * np.arange(-_MARGIN, rows + _MARGIN)
    tt, days_from_start = julian_dates(when, "tt"), (when - start) / DAY
    x, y, s = ERFA.xys06a(*tt)
    slow = np.column_stack([x, y, ERFA.sp00(*tt) - s])
    inside = slice(_MARGIN, _MARGIN + rows)
    rate = SPLINE(days_from_start, slow)(days_from_start[inside], 1)
    slow = slow[inside]
    eop, eop_rate = parameters.sample(when[inside])
    table = np.zeros((ROWS, COLUMNS))
    half = COLUMNS // 2
    for offset, moving, earth in ((0, slow, eop), (half, rate, eop_rate)):
        table[:rows, offset : offset + 2] = moving[:, :2] + earth[:, 3:]
        table[:rows, offset + 2] = moving[:, 2]
        table[:rows, offset + 3 : offset + 5] = earth[:, 1:3]
        table[:rows, offset + 5] = earth[:, 0]
    return start, rows, table


@compiled
def earth_rotation_angle(epoch_ns: int, ut1_minus_tai: float) -> float:
    """Earth rotation angle in [0, 2 pi), rad, at an epoch (TAI ns since 2000-01-01T12:00:00 TAI) with UT1 - TAI (s)."""
    day, rest = epoch_ns // 86_400_000_000_000, epoch_ns % 86_400_000_000_000
    part = rest / 86_400e9 + ut1_minus_tai / 86_400.0
    # whole turns of whole days are left out, so that no digits are lost (Conventions 2010, eq. 5.15)
    turns = 0.7790572732640 + 0.00273781191135448 * (day + part) + part
    return 2.0 * math.pi * (turns - math.floor(turns))


@compiled
def spin(angle: float, rate: float) -> tuple[M3, V3]:
    """dcm_EN and omega_EN_N (rad/s) of an Earth that turns about z of N at a rate (rad/s)."""
    c, s = math.cos(angle), math.sin(angle)
    return ((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, rate)


@compiled
def _hermite(table: F64, row: int, column: int, u: float, days: float) -> float:
    """Cubic of two rows' values and slopes, u in [0, 1] from one to the other, ``days`` apart."""
    w = 1.0 - u
    a, b = table[row, column], table[row + 1, column]
    p, q = days * table[row, column + 6], days * table[row + 1, column + 6]
    return a + u * u * (3.0 - 2.0 * u) * (b - a) + u * w * (w * p - u * q)


@compiled
def _hermite_slope(table: F64, row: int, column: int, u: float, days: float) -> float:
    """Its derivative per day."""
    a, b = table[row, column], table[row + 1, column]
    p, q = table[row, column + 6], table[row + 1, column + 6]
    return 6.0 * u * (1.0 - u) * (b - a) / days + (1.0 - u) * (1.0 - 3.0 * u) * p + u * (3.0 * u - 2.0) * q


@compiled
def orientation(epoch_ns: int, start_ns: int, rows: int, table: F64) -> tuple[M3, V3]:
    """GCRF to ITRF from a table.

    Args:
        epoch_ns: TAI ns since 2000-01-01T12:00:00 TAI.
        start_ns: epoch of the first row.
        rows: number of rows in use.
        table: (ROWS, COLUMNS) of `orientation_table`.

    Returns:
        dcm_EN and omega_EN_N (rad/s); polar motion's share of the rate, 2e-13 rad/s, is left out. NaN outside the
        table.
    """
    step = 43_200_000_000_000
    since = epoch_ns - start_ns
    if since < 0 or since > (rows - 1) * step:
        nan = (math.nan, math.nan, math.nan)
        return (nan, nan, nan), nan
    row = min(since // step, rows - 2)
    u, days = (since - row * step) / step, 0.5
    x, y = _hermite(table, row, 0, u, days), _hermite(table, row, 1, u, days)
    ut1_tai = _hermite(table, row, 5, u, days)
    angle = earth_rotation_angle(epoch_ns, ut1_tai) + _hermite(table, row, 2, u, days)
    c, s = math.cos(angle), math.sin(angle)
    z = math.sqrt(1.0 - x * x - y * y)
    a = 1.0 / (1.0 + z)
    to_pole = ((1.0 - a * x * x, -a * x * y, -x), (-a * x * y, 1.0 - a * y * y, -y), (x, y, z))
    turned = matmul(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)), to_pole)
    # polar motion is below 5e-6 rad: its cosines and sines by two terms are exact
    p, q = _hermite(table, row, 3, u, days), _hermite(table, row, 4, u, days)
    cp, sp = 1.0 - 0.5 * p * p, p * (1.0 - p * p / 6.0)
    cq, sq = 1.0 - 0.5 * q * q, q * (1.0 - q * q / 6.0)
    polar = ((cp, sp * sq, sp * cq), (0.0, cq, -sq), (-sp, cp * sq, cp * cq))
    rate = 2.0 * math.pi * 1.00273781191135448 / 86_400.0 * (1.0 + _hermite_slope(table, row, 5, u, days) / 86_400.0)
    # the pole moves with x', y': the frame turns by pole x pole' besides its spin
    dx, dy = _hermite_slope(table, row, 0, u, days) / 86_400.0, _hermite_slope(table, row, 1, u, days) / 86_400.0
    dz = -(x * dx + y * dy) / z
    moving = cross((x, y, z), (dx, dy, dz))
    return matmul(polar, turned), axpy(rate, (x, y, z), moving)
