"""The approximate orbit: two-line elements propagated with SGP4, in the Earth-fixed frame."""

from __future__ import annotations

import itertools
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import erfa as _erfa
import numpy as np
from numpy.typing import NDArray
from sgp4.api import Satrec

from fsw.math.orbit_frames import OMEGA_EARTH, dcm_earth_teme, dcm_hill, dcm_orbit

F64 = NDArray[np.float64]
erfa: Any = _erfa
_SATREC: Any = Satrec


class OrbitError(ValueError):
    """Elements that cannot be used; the text says why and what to do."""


def _checked_line(line: str, number: int, where: str) -> str:
    """One line of a set of elements, its length, number and checksum verified."""
    line = line.rstrip()
    if len(line) != 69 or not line.startswith(f"{number} "):
        raise OrbitError(f"{where}: line {number} of two-line elements starts with '{number} ' and has 69 characters")
    total = sum(int(c) if c.isdigit() else c == "-" for c in line[:68])
    if line[68] != str(total % 10):
        text = f"the checksum of line {number} is {line[68]}, but its characters give {total % 10}"
        raise OrbitError(f"{where}: {text}; the file is damaged, get the elements again")
    return line


class TleOrbit:
    """An approximate orbit from two-line elements, with an optional constant offset.

    Errors of the frames: UT1 is taken as UTC (below 15 m in 2023, at most 420 m ever) and the motion of the pole is
    left out (below 20 m). Both are far below the error of the elements, about 1 km along track and growing each day.

    Attributes:
        epoch: UTC of simulation time zero. elements_epoch: UTC of the elements. satellite: catalogue number.
        offset_H: (3,) m, added to positions: radial, along track, normal. For sensitivity studies.
    """

    def __init__(
        self, line1: str, line2: str, epoch: datetime, offset_H: F64 | None = None, where: str = "TLE"
    ) -> None:
        """Check and take the elements.

        Raises:
            OrbitError: if a line is damaged, the two are of different satellites, or SGP4 refuses them.
        """
        lines = _checked_line(line1, 1, where), _checked_line(line2, 2, where)
        if lines[0][2:7] != lines[1][2:7]:
            raise OrbitError(f"{where}: line 1 is of satellite {lines[0][2:7]}, line 2 of {lines[1][2:7]}")
        satrec = _SATREC.twoline2rv(*lines)
        self._satrec: Any = satrec
        self._lines, self.where = lines, where
        self.satellite = int(lines[0][2:7])
        if satrec.error:
            raise OrbitError(f"{where}: SGP4 refuses the elements (code {satrec.error}); get them again")
        days = float(satrec.jdsatepoch) - 2440587.5 + float(satrec.jdsatepochF)
        self.elements_epoch = datetime.fromtimestamp(days * 86400.0, UTC)
        self.epoch = epoch.astimezone(UTC)
        self.offset_H: F64 = np.zeros(3) if offset_H is None else np.asarray(offset_H, float)
        since = self.epoch - datetime(2000, 1, 1, 12, tzinfo=UTC)
        self._jd = 2451545.0 + since.days, (since.seconds + since.microseconds * 1e-6) / 86400.0

    @classmethod
    def open(cls, path: Path | str, epoch: datetime) -> TleOrbit:
        """Read the first set of elements in a text file (a name line above it is skipped).

        Raises:
            OrbitError: if the file is unreadable or holds no usable elements.
        """
        try:
            lines = [x for x in Path(path).read_text("ascii").splitlines() if x.strip()]
        except (OSError, UnicodeDecodeError) as error:
            raise OrbitError(f"{path}: cannot be read as two-line elements ({error})") from None
        for first, second in itertools.pairwise(lines):
            if first.startswith("1 ") and second.startswith("2 "):
                return cls(first, second, epoch, where=str(path))
        raise OrbitError(f"{path}: holds no two-line elements (a line that starts with '1 ' and then one with '2 ')")

    def shifted(self, offset_H: F64) -> TleOrbit:
        """The same orbit, displaced by a constant in the Hill frame."""
        return TleOrbit(*self._lines, self.epoch, offset_H, self.where)

    def age_days(self, t_s: float) -> float:
        """Days from the elements' epoch to simulation time ``t_s``; negative before it."""
        return (self.epoch - self.elements_epoch).total_seconds() / 86400.0 + t_s / 86400.0

    def sigma_H(self, t_s: float) -> F64:
        """Standard deviation of the position (radial, along track, normal), (3,) m.

        A rule of thumb for low orbits (after Vallado and Cefola, 2012): along track 1 km and 0.7 km more for each day.
        """
        days = abs(self.age_days(t_s))
        return np.array([200.0 + 100.0 * days, 1000.0 + 700.0 * days, 300.0 + 100.0 * days])

    def at(self, t_s: F64 | float) -> tuple[F64, F64]:
        """Position and velocity.

        Args:
            t_s: (n,) or scalar, simulation time, s.

        Returns:
            r_BE_E (n, 3) m, Earth-fixed, and the INERTIAL velocity in Earth-fixed components (n, 3) m/s.

        Raises:
            OrbitError: if SGP4 fails at one of the times (a decayed satellite).
        """
        t = np.atleast_1d(np.asarray(t_s, float))
        fractions = self._jd[1] + t / 86400.0
        days = np.full_like(t, self._jd[0])
        codes, r_km, v_km = self._satrec.sgp4_array(days, fractions)
        if np.any(codes):
            raise OrbitError(f"{self.where}: SGP4 fails at that time (code {int(np.max(codes))}); get newer elements")
        gmst = np.asarray(erfa.gmst82(days, fractions))
        r_E, v_E, dcm = np.empty((len(t), 3)), np.empty((len(t), 3)), np.empty((3, 3))
        for k in range(len(t)):
            r_N, v_N = 1e3 * r_km[k], 1e3 * v_km[k]
            dcm_hill(r_N, v_N, dcm)
            r_N = r_N + dcm.T @ self.offset_H
            dcm_earth_teme(float(gmst[k]), 0.0, 0.0, dcm)
            r_E[k], v_E[k] = dcm @ r_N, dcm @ v_N
        return r_E, v_E

    def frames(self, t_s: float) -> tuple[F64, F64, F64]:
        """Position r_BE_E (3,) m, dcm_OE and dcm_HE (3, 3) at one time."""
        r, v = self.at(t_s)
        dcm_OE, dcm_HE = np.empty((3, 3)), np.empty((3, 3))
        dcm_orbit(r[0], v[0], dcm_OE)
        dcm_hill(r[0], v[0], dcm_HE)
        return r[0], dcm_OE, dcm_HE

    def velocity_earth(self, t_s: float) -> F64:
        """Velocity relative to the rotating Earth, (3,) m/s, Earth-fixed."""
        r, v = self.at(t_s)
        spin = OMEGA_EARTH * np.array([-r[0, 1], r[0, 0], 0.0])
        return v[0] - spin


def require_fresh(orbit: TleOrbit, t_s: float, limit_days: float) -> None:
    """Refuse elements whose epoch is too far from the time they are used at.

    Raises:
        OrbitError: if the distance is above ``limit_days``.
    """
    age = orbit.age_days(t_s)
    if not math.fabs(age) <= limit_days:
        word = "older" if age > 0 else "newer"
        text = f"the elements are {abs(age):.1f} days {word} than the photos, at most {limit_days:g} are accepted"
        raise OrbitError(f"{orbit.where}: {text}; get elements of that time")
