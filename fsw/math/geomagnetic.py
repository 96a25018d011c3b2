"""Files of geomagnetic coefficients, and the tables of them that truth and filters evaluate."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fsw.math.magnetic import COUNT, DEGREE, pair_factors, pair_index
from messages.base import F64, I64

YEARS = 6
"""Instants in a table: the beginnings of consecutive years."""
_NOON = date(2000, 1, 1).toordinal()


class Model(NamedTuple):
    """A geomagnetic model: coefficients linear in decimal years between its epochs.

    Attributes:
        name: for messages. epochs: (k,) decimal years. degree: highest degree.
        g: (k, 105) cosine coefficients, nT, Schmidt semi-normalised, in the order of `pair_index`. h: sine ones.
    """

    name: str
    epochs: F64
    degree: int
    g: F64
    h: F64


def read_shc(path: Path | str) -> Model:
    """A model in the SHC format of IGRF: a header, the epochs, then a line of values for each degree and order.

    Raises:
        ValueError: if the file is not of this form; the text names it.
    """
    path = Path(path)
    lines = [x.split() for x in path.read_text().splitlines() if x.strip() and not x.startswith("#")]
    try:
        degree, epochs, order = int(lines[0][1]), np.array(lines[1], float), int(lines[0][3])
        if order != 2:
            raise ValueError(f"a spline of order {order}; only order 2, linear between the epochs, is read")
        _check_pairs([(int(x[0]), int(x[1])) for x in lines[2:]], degree)
        g, h = np.zeros((epochs.size, COUNT)), np.zeros((epochs.size, COUNT))
        for line in lines[2:]:
            n, m = int(line[0]), int(line[1])
            (h if m < 0 else g)[:, pair_index(n, abs(m))] = np.array(line[2:], float)
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path.name}: expected coefficients in SHC format up to degree {DEGREE}: {error}") from error
    return Model(path.stem, epochs, degree, g, h)


def read_cof(path: Path | str) -> Model:
    """A model in the COF format of WMM: epoch and name, then n, m, g, h and their yearly changes, for five years.

    Raises:
        ValueError: if the file is not of this form; the text names it.
    """
    path = Path(path)
    lines = [x.split() for x in path.read_text().splitlines() if x.strip() and not x.startswith("9999")]
    try:
        epoch, degree = float(lines[0][0]), int(lines[-1][0])
        pairs = [(int(x[0]), int(x[1])) for x in lines[1:]]
        _check_pairs([*pairs, *((n, -m) for n, m in pairs if m)], degree)
        g, h = np.zeros((2, COUNT)), np.zeros((2, COUNT))
        for line in lines[1:]:
            k, values = pair_index(int(line[0]), int(line[1])), [float(x) for x in line[2:6]]
            g[:, k] = values[0], values[0] + 5.0 * values[2]
            h[:, k] = values[1], values[1] + 5.0 * values[3]
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path.name}: expected coefficients in COF format up to degree {DEGREE}: {error}") from error
    return Model(lines[0][1], np.array([epoch, epoch + 5.0]), degree, g, h)


def _check_pairs(pairs: list[tuple[int, int]], degree: int) -> None:
    """Each degree and order once; negative orders are sine coefficients."""
    if not 1 <= degree <= DEGREE:
        raise ValueError(f"degree {degree}")
    expected = {(n, m) for n in range(1, degree + 1) for m in range(-n, n + 1)}
    if len(pairs) != len(expected) or set(pairs) != expected:
        text = f"degree {degree} has {len(expected)} of them, each once"
        raise ValueError(f"{text}; found {len(set(pairs) & expected)}, and {len(pairs)} in all")


def year_start(year: int) -> int:
    """TAI nanoseconds since 2000-01-01T12:00:00 TAI at the beginning of a year (in TAI; the field changes slowly)."""
    return ((date(year, 1, 1).toordinal() - _NOON) * 2 - 1) * 43_200 * 10**9


def yearly_table(model: Model, epoch_tai_ns: int) -> tuple[I64, F64, F64]:
    """The model at the beginnings of up to six years, from that of an epoch on.

    Linear interpolation between them is linear in decimal years, as IGRF and WMM define it.

    Returns:
        Times (6,), TAI ns, the last one repeated where the model ends; g and h (6, 105), T, times `pair_factors`.

    Raises:
        ValueError: if the epoch is outside the validity of the model.
    """
    first, last = int(model.epochs[0]), int(model.epochs[-1])
    year = next((y for y in range(first, last) if year_start(y) <= epoch_tai_ns < year_start(y + 1)), None)
    if year is None:
        when = 2000.0 + (epoch_tai_ns / 86400e9 + 0.5) / 365.25
        raise ValueError(f"epoch_tai_ns: {model.name} is valid from {first} to {last}, got the year {when:.2f}")
    years = np.arange(year, min(year + YEARS, last + 1))
    times, g, h = np.full(YEARS, year_start(int(years[-1]))), np.zeros((YEARS, COUNT)), np.zeros((YEARS, COUNT))
    factors = 1e-9 * pair_factors()
    for k, y in enumerate(years):
        i = min(int(np.searchsorted(model.epochs, y, "right")) - 1, model.epochs.size - 2)
        w = (y - model.epochs[i]) / (model.epochs[i + 1] - model.epochs[i])
        times[k] = year_start(int(y))
        g[k] = factors * ((1.0 - w) * model.g[i] + w * model.g[i + 1])
        h[k] = factors * ((1.0 - w) * model.h[i] + w * model.h[i + 1])
    return times, g, h


def coefficients_at(model: Model, epoch_tai_ns: int) -> tuple[F64, F64]:
    """The model at an instant, for flights of some days: the field changes by 0.3 % in a year.

    Returns:
        g and h (105,), T, times `pair_factors`.

    Raises:
        ValueError: if the epoch is outside the validity of the model.
    """
    times, g, h = yearly_table(model, epoch_tai_ns)
    w = (epoch_tai_ns - int(times[0])) / (int(times[1]) - int(times[0]))
    return g[0] + w * (g[1] - g[0]), h[0] + w * (h[1] - h[0])
