"""When photos were taken, from stamps that are cut off to whole seconds and a shutter that is even."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_SHORTEST_S = 3.0
"""An even cadence with a period below this would fit almost any stamps, so none is looked for."""

_LONGEST_GAP_S = 300.0
"""Over a longer gap it is not known how often the shutter went."""

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
        cadence: the even cadence found (of the most photos, if several were), or None.
        even: (n,) whether the time comes from an even cadence; otherwise it is the middle of its bounds.
    """

    t_s: F64
    sigma_s: F64
    earliest_s: F64
    latest_s: F64
    cadence: Cadence | None
    even: NDArray[np.bool_]


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


def _evenly(earliest: F64, latest: F64, hint: Cadence | None) -> tuple[F64, F64, Cadence, NDArray[np.int64]] | None:
    """Times, sigmas, cadence and counts of distinct stamps in order, if they agree with an even cadence."""
    gaps = np.diff(earliest)
    if len(earliest) < (2 if hint else _FEWEST):
        return None
    found = _counts(earliest, latest, _periods(float(gaps.min()), hint))
    if found is None:
        return None
    counts, period = found
    reach = 2.0 * float(np.max(latest - earliest)) / float(counts.max())
    grid = np.linspace(period - reach, period + reach, 8001)
    weights = np.ones_like(grid)
    if hint is not None:
        parts = max(1, round(hint.period_s / period))
        weights = np.exp(-0.5 * ((grid * parts - hint.period_s) / max(hint.sigma_s, 1e-4)) ** 2)
    line = line_within(earliest, latest, counts.astype(float), grid, weights)
    if line is None:
        return None
    mean, cov = line
    sigma = np.sqrt(cov[0, 0] + 2.0 * counts * cov[0, 1] + counts * counts * cov[1, 1])
    return mean[0] + mean[1] * counts, sigma, Cadence(float(mean[1]), float(np.sqrt(cov[1, 1]))), counts


def estimate_times(
    stamps_s: Sequence[float] | F64, resolution_s: Sequence[float] | F64, hint: Cadence | None = None
) -> Times:
    """Times of photos from their stamps, all in s after any common origin, in any order.

    Each photo was taken in [stamp, stamp + resolution). If four photos or more, without a gap of five minutes, agree
    with an even cadence, the estimate is the mean of all (start, period) that agree with all of their stamps; otherwise
    it is the middle of each interval. Photos with the same stamp get the same time.

    Args:
        stamps_s: (n,) stamps. resolution_s: (n,) lengths of the intervals.
        hint: a cadence known before (then two photos suffice).

    Raises:
        ValueError: if the lengths differ or there is no photo.
    """
    earliest = np.asarray(stamps_s, float)
    latest = earliest + np.asarray(resolution_s, float)
    if earliest.ndim != 1 or earliest.shape != latest.shape or not len(earliest):
        raise ValueError(f"expected as many stamps as resolutions, at least one, got shape {earliest.shape}")
    middle, spread = 0.5 * (earliest + latest), (latest - earliest) / np.sqrt(12.0)
    times = Times(middle, spread, earliest, latest, None, np.zeros(len(middle), bool))
    distinct, first, back = np.unique(earliest, return_index=True, return_inverse=True)
    group = np.concatenate([[0], np.cumsum(np.diff(distinct) > _LONGEST_GAP_S)])
    most = 0
    for g in range(int(group[-1]) + 1):
        members = np.flatnonzero(group == g)
        line = _evenly(distinct[members], latest[first[members]], hint)
        if line is None:
            continue
        for place, i in enumerate(members):
            photos = np.flatnonzero(back == i)
            times.t_s[photos], times.sigma_s[photos], times.even[photos] = line[0][place], line[1][place], True
        if len(members) > most:
            most, times = len(members), msgspec.structs.replace(times, cadence=line[2])
    return times
