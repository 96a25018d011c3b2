"""When photos were taken, from stamps that are cut off to whole seconds and a shutter that is even."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_SHORTEST_S = 3.0
"""An even cadence with a period below this would fit almost any stamps, so none is looked for."""

_FEWEST = 4
"""With fewer photos than this any stamps look even."""


class Cadence(msgspec.Struct, frozen=True):
    """An even shutter: period and its standard deviation, s."""

    period_s: float
    sigma_s: float


class Times(msgspec.Struct, frozen=True):
    """Estimated times of photos.

    Attributes:
        t_s: (n,) best estimate, s. sigma_s: (n,) standard deviation, s. earliest_s, latest_s: (n,) bounds, s.
        cadence: the even cadence found, or None; then every time is the middle of its bounds.
        counts: (n,) shutter counts relative to the first photo, in units of the cadence; zeros without one.
    """

    t_s: F64
    sigma_s: F64
    earliest_s: F64
    latest_s: F64
    cadence: Cadence | None
    counts: NDArray[np.int64]


def _start_range(earliest: F64, latest: F64, counts: F64, period: F64) -> tuple[F64, F64]:
    """For each period (m,), the smallest and largest start (m,) that agree with every stamp (n,)."""
    steps = counts[None, :] * period[:, None]
    return np.max(earliest - steps, axis=1), np.min(latest - steps, axis=1)


def line_within(earliest: F64, latest: F64, x: F64, slopes: F64, weights: F64) -> tuple[F64, F64] | None:
    """Mean and covariance of the lines a + b x that pass through all intervals, each as likely as another.

    Args:
        earliest, latest: (n,) intervals. x: (n,) where they stand.
        slopes: (m,) even grid of b. weights: (m,) prior weight of each.

    Returns:
        Mean (2,) and covariance (2, 2) of (a, b), or None if no line on the grid fits.
    """
    low, high = _start_range(earliest, latest, x, slopes)
    width = np.maximum(high - low, 0.0)
    weight = width * weights
    total = weight.sum()
    if not total > 0.0:
        return None
    weight = weight / total
    middle = 0.5 * (low + high)
    mean = np.array([weight @ middle, weight @ slopes])
    da, db = middle - mean[0], slopes - mean[1]
    cov_ab = weight @ (da * db)
    var_a = weight @ (da * da + width * width / 12.0)
    return mean, np.array([[var_a, cov_ab], [cov_ab, max(weight @ (db * db), 1e-12)]])


def _counts(earliest: F64, latest: F64, periods: F64) -> tuple[NDArray[np.int64], float] | None:
    """Shutter counts for the longest feasible period on a grid, and that period."""
    centre = 0.5 * (earliest + latest)
    since = centre - centre[0]
    for period in periods:
        counts = np.rint(since / period)
        low, high = _start_range(earliest, latest, counts, np.array([period]))
        if np.all(np.diff(counts) >= 1) and low[0] < high[0]:
            return counts.astype(np.int64), float(period)
    return None


def _periods(shortest_gap: float, hint: Cadence | None) -> F64:
    """Periods to try, longest first."""
    if hint is not None:
        reach = max(4.0 * hint.sigma_s, 1e-4)
        span = np.linspace(hint.period_s + reach, hint.period_s - reach, 161)
        return np.concatenate([span, span / 2.0, span / 3.0])
    longest = min(shortest_gap + 1.0, 120.0)
    grid = np.arange(longest, max(_SHORTEST_S, (shortest_gap - 1.0) / 4.0), -0.002)
    return grid[grid >= _SHORTEST_S]


def estimate_times(stamps_s: Sequence[float], resolution_s: Sequence[float], hint: Cadence | None = None) -> Times:
    """Times of photos from their stamps, all in s after any common origin, in any order.

    Each photo was taken in [stamp, stamp + resolution). If four photos or more agree with an even cadence, the
    estimate is the mean of all (start, period) that agree with all stamps; otherwise the middle of each interval.

    Args:
        stamps_s: (n,) stamps. resolution_s: (n,) lengths of the intervals.
        hint: a cadence known before (then fewer photos suffice).

    Raises:
        ValueError: if the lengths differ or there is no photo.
    """
    earliest = np.asarray(stamps_s, float)
    latest = earliest + np.asarray(resolution_s, float)
    if earliest.ndim != 1 or earliest.shape != latest.shape or not len(earliest):
        raise ValueError(f"expected as many stamps as resolutions, at least one, got shape {earliest.shape}")
    middle, spread = 0.5 * (earliest + latest), (latest - earliest) / np.sqrt(12.0)
    plain = Times(middle, spread, earliest, latest, None, np.zeros(len(middle), np.int64))
    order = np.argsort(earliest, kind="stable")
    gaps = np.diff(earliest[order])
    if len(middle) < (2 if hint else _FEWEST) or np.any(gaps <= 0.0):
        return plain
    found = _counts(earliest[order], latest[order], _periods(float(gaps.min()), hint))
    if found is None:
        return plain
    counts, period = np.zeros(len(middle)), found[1]
    counts[order] = found[0]
    reach = 2.0 * float(np.max(latest - earliest)) / float(counts.max())
    grid = np.linspace(period - reach, period + reach, 8001)
    weights = np.ones_like(grid)
    if hint is not None:
        expected = hint.period_s / max(1, round(hint.period_s / period))
        scale = hint.sigma_s * expected / hint.period_s
        weights = np.exp(-0.5 * ((grid - expected) / max(scale, 1e-4)) ** 2)
    line = line_within(earliest, latest, counts, grid, weights)
    if line is None:
        return plain
    mean, cov = line
    t = mean[0] + mean[1] * counts
    sigma = np.sqrt(cov[0, 0] + 2.0 * counts * cov[0, 1] + counts * counts * cov[1, 1])
    cadence = Cadence(float(mean[1]), float(np.sqrt(cov[1, 1])))
    return Times(t, sigma, earliest, latest, cadence, counts.astype(np.int64))
