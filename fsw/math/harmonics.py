"""Spherical harmonics of gravity to degree 50: acceleration and potential without a singularity, and ICGEM files.

Coefficients are fully normalised, C[n, m] and S[n, m] (51, 51); the frame is fixed to the body (E).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.vectors import V3
from messages.base import F64

MAX_DEGREE = 50
"""Highest degree and order of a field."""
SIZE = MAX_DEGREE + 1
WIDTH = 56
"""Length of the rows of work space: a multiple of what vector instructions hold, or the compiler uses none."""


def _recursion() -> tuple[F64, F64]:
    """Factors (SIZE, 2, SIZE), a and b of ``A[n, m] = a u A[n-1, m] - b A[n-2, m]``, and A[m, m] (SIZE,)."""
    factors, sectoral = np.zeros((SIZE, 2, SIZE)), np.ones(SIZE)
    a, b = factors[:, 0], factors[:, 1]
    for m in range(SIZE):
        if m > 0:
            sectoral[m] = sectoral[m - 1] * math.sqrt((2 * m + 1) / (2 * m) * (2 if m == 1 else 1))
        for n in range(m + 1, SIZE):
            a[n, m] = math.sqrt((2 * n - 1) * (2 * n + 1) / ((n - m) * (n + m)))
            if n > m + 1:
                top = (2 * n + 1) * (n + m - 1) * (n - m - 1)
                b[n, m] = math.sqrt(top / ((n - m) * (n + m) * (2 * n - 3)))
    return factors, sectoral


_FACTORS, _SECTORAL = _recursion()


@compiled
def harmonic_acceleration(r: V3, mu: float, radius: float, degree: int, c: F64, s: F64) -> V3:
    """Acceleration, m/s^2, at ``r`` (m), E components, of a field of ``degree`` (order alike), point mass included.

    Pines (1973), "Uniform Representation of the Gravitational Potential and its Derivatives", AIAA J. 11(11), with
    the derivative of each Legendre function from the derivative of its recursion; regular at the poles. All orders of
    a degree are stepped together, so that vector instructions do several at once.

    Args:
        r: position, E components [m].
        mu: gravitational parameter [m^3/s^2].
        radius: reference radius of the coefficients [m].
        degree: highest degree used, 0 to 50.
        c: normalised cosine coefficients (51, 51), ``c[0, 0]`` counts as 1.
        s: normalised sine coefficients (51, 51).
    """
    r1 = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    x, y, u, q = r[0] / r1, r[1] / r1, r[2] / r1, radius / r1
    # for each order: A of the last degree and of the one before, their slopes dA/du, and sums over the degrees, for
    # cosines and sines: of A, of (n + 1) A, of dA/du
    w = np.zeros((10, WIDTH))
    power = 1.0
    for n in range(degree + 1):
        k = n + 1.0
        for m in range(n):
            a, b = q * _FACTORS[n, 0, m], q * q * _FACTORS[n, 1, m]
            last, last_slope = w[0, m], w[2, m]
            value, slope = a * u * last - b * w[1, m], a * (u * last_slope + last) - b * w[3, m]
            w[0, m], w[1, m], w[2, m], w[3, m] = value, last, slope, last_slope
            cosine, sine = c[n, m], s[n, m]
            w[4, m] += value * cosine
            w[5, m] += value * sine
            w[6, m] += k * value * cosine
            w[7, m] += k * value * sine
            w[8, m] += slope * cosine
            w[9, m] += slope * sine
        w[0, n] = _SECTORAL[n] * power
        if n > 0:
            w[4, n], w[5, n] = w[0, n] * c[n, n], w[0, n] * s[n, n]
            w[6, n], w[7, n] = k * w[4, n], k * w[5, n]
        power *= q
    a1, a2, a3, a4 = 0.0, 0.0, 0.0, 1.0
    re, im, re_before, im_before = 1.0, 0.0, 0.0, 0.0  # (x + i y)^m and ^(m - 1)
    for m in range(degree + 1):
        a1 += m * (w[4, m] * re_before + w[5, m] * im_before)
        a2 += m * (w[5, m] * re_before - w[4, m] * im_before)
        a3 += w[8, m] * re + w[9, m] * im
        a4 += w[6, m] * re + w[7, m] * im
        re_before, im_before = re, im
        re, im = x * re - y * im, x * im + y * re
    k = mu / (r1 * r1)
    radial = a4 + x * a1 + y * a2 + u * a3
    return (k * (a1 - radial * x), k * (a2 - radial * y), k * (a3 - radial * u))


@compiled
def harmonic_potential(r: V3, mu: float, radius: float, degree: int, c: F64, s: F64) -> float:
    """Potential energy of a unit mass, J/kg; its negative gradient is `harmonic_acceleration`. Same arguments."""
    r1 = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    x, y, u, q = r[0] / r1, r[1] / r1, r[2] / r1, radius / r1
    w = np.zeros((4, WIDTH))
    power = 1.0
    for n in range(degree + 1):
        for m in range(n):
            last = w[0, m]
            value = q * u * _FACTORS[n, 0, m] * last - q * q * _FACTORS[n, 1, m] * w[1, m]
            w[0, m], w[1, m] = value, last
            w[2, m] += value * c[n, m]
            w[3, m] += value * s[n, m]
        w[0, n] = _SECTORAL[n] * power
        if n > 0:
            w[2, n], w[3, n] = w[0, n] * c[n, n], w[0, n] * s[n, n]
        power *= q
    total, re, im = 1.0, 1.0, 0.0
    for m in range(degree + 1):
        total += w[2, m] * re + w[3, m] * im
        re, im = x * re - y * im, x * im + y * re
    return -mu / r1 * total


@dataclass(frozen=True)
class GravityField:
    """A field as read from a file.

    Attributes:
        name: of the model. mu: gravitational parameter, m^3/s^2. radius: reference radius, m.
        degree: highest degree read. C: normalised cosine coefficients (51, 51). S: sine coefficients.
        tide_system: as the file says, "tide_free" for example.
    """

    name: str
    mu: float
    radius: float
    degree: int
    C: F64
    S: F64
    tide_system: str


def _number(text: str) -> float:
    return float(text.lower().replace("d", "e"))


def _years(day: str, epoch_ns: int) -> float:
    """Years of 365.25 days from a date of a file, yyyymmdd or yyyymmdd.hhmm, to an epoch."""
    clock = f"{day[9:]:0<4}"
    whole = date(int(day[:4]), int(day[4:6]), int(day[6:8])).toordinal() - date(2000, 1, 1).toordinal()
    start = whole - 0.5 + (60 * int(clock[:2]) + int(clock[2:4])) / 1440.0
    return (epoch_ns / 86_400e9 - start) / 365.25


def _factor(words: list[str], dated: bool, starts: dict[str, str], epoch_ns: int) -> float | None:
    """What the coefficients of a line count at an epoch if they vary with time; None if the line is of another time.

    In version 2 of the format (``dated``) each line ends in the dates it is for, in version 1 only those of ``gfct``
    in their date 0, which ``starts`` keeps.
    """
    kind, which, rest = words[0], "/".join(words[1:3]), words[5:]
    period = _number(rest.pop()) if kind in ("asin", "acos") else math.inf
    if dated:
        if not _years(rest[-2], epoch_ns) >= 0.0 > _years(rest[-1], epoch_ns):
            return None
        starts[which] = rest[-2]
    elif kind == "gfct":
        starts[which] = rest[-1]
    years = _years(starts[which], epoch_ns)
    angle = 2.0 * math.pi * years / period
    return {"gfct": 1.0, "trnd": years, "asin": math.sin(angle), "acos": math.cos(angle)}[kind]


def read_icgem(path: Path | str, degree: int = MAX_DEGREE, epoch_ns: int | None = None) -> GravityField:
    """Read a gravity field in the format of ICGEM (``.gfc``; Barthelmes and Foerste, 2011; versions 1 and 2).

    Args:
        path: the file. degree: highest degree wanted, 2 to 50; fewer if the file has fewer.
        epoch_ns: for a field that varies with time, when: TAI ns since 2000-01-01T12:00:00 TAI.

    Raises:
        ValueError: if the file is not of the format, not fully normalised, varies with time and there is no epoch, or
            lacks a coefficient (at the epoch).
    """
    if not 2 <= degree <= MAX_DEGREE:
        raise ValueError(f"degree: expected 2 to {MAX_DEGREE}, got {degree}")
    path = Path(path)
    head, _, body = path.read_text(encoding="latin-1").partition("end_of_head")
    if not body:
        raise ValueError(f"{path.name}: not a gravity field in ICGEM format: there is no line end_of_head")
    head = head.rpartition("begin_of_head")[2]  # comments before it may hold the same words
    known = {w[0]: w[1] for line in head.splitlines() if len(w := line.split()) >= 2}
    try:
        if known.get("norm", "fully_normalized") != "fully_normalized":
            raise ValueError(f"expected norm fully_normalized, got {known['norm']}")
        constant = "gravity_constant" if "gravity_constant" in known else "earth_gravity_constant"
        mu, radius = _number(known[constant]), _number(known["radius"])
        n_max = min(degree, int(known["max_degree"]))
        c, s = np.full((SIZE, SIZE), np.nan), np.full((SIZE, SIZE), np.nan)
        dated, starts = known.get("format", "").lower() == "icgem2.0", dict[str, str]()
        for words in (line.split() for line in body.splitlines()[1:] if line.strip()):
            if words[0] not in ("gfc", "gfct", "trnd", "asin", "acos"):
                raise ValueError(f"expected lines gfc, gfct, trnd, asin or acos, got {words[0]}")
            n, m, factor = int(words[1]), int(words[2]), 1.0
            if n > n_max or m > n:
                continue
            if words[0] != "gfc":
                if epoch_ns is None:
                    raise ValueError("the field varies with time: give the epoch_ns, or choose a static one")
                found = _factor(words, dated, starts, epoch_ns)
                if found is None:
                    continue
                factor = found
            old = (0.0, 0.0) if words[0] in ("gfc", "gfct") else (c[n, m], s[n, m])
            c[n, m], s[n, m] = old[0] + factor * _number(words[3]), old[1] + factor * _number(words[4])
    except (KeyError, IndexError, ValueError) as error:
        raise ValueError(f"{path.name}: not a gravity field in ICGEM format: {error}") from error
    c[0, 0], s[0, 0] = 1.0, 0.0
    c[1], s[1] = np.nan_to_num(c[1]), np.nan_to_num(s[1])  # degree 1 is left out when the origin is the centre of mass
    wanted = np.tril(np.ones((SIZE, SIZE), bool)) & (np.arange(SIZE)[:, None] <= n_max)
    if np.any(missing := wanted & ~np.isfinite(c + s)):
        n, m = np.argwhere(missing)[0].tolist()
        raise ValueError(f"{path.name}: expected all coefficients to degree {n_max}, there is none of n={n}, m={m}")
    c[~wanted], s[~wanted] = 0.0, 0.0
    name, tide = known.get("modelname", path.stem), known.get("tide_system", "unknown")
    return GravityField(name, mu, radius, n_max, c, s, tide)
