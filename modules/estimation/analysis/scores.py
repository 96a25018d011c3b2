"""Figures of a comparison with a bound: efficiency, divergences, time to converge.

Source of the interval of a small probability: Clopper and Pearson (1934), Biometrika 26:404.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import beta as _beta
from scipy.stats import chi2 as _chi2

from messages.base import F64

beta: Any = _beta
chi2: Any = _chi2


@dataclass(frozen=True)
class Efficiency:
    """Root mean square error over the bound.

    Attributes:
        eta: the ratio; 1 is the best that can be.
        low, high: its interval at ``level``.
        rmse, bound: the two, in units of the state.
        level: probability of the interval.
        freedom: degrees of freedom of each run's mean square error, found from the scatter between runs.
        runs: independent runs.
    """

    eta: float
    low: float
    high: float
    rmse: float
    bound: float
    level: float
    freedom: float
    runs: int

    def __str__(self) -> str:
        """One sentence with the figures and what they mean."""
        text = (
            f"RMSE {self.rmse:.4g}, bound {self.bound:.4g}, ratio {self.eta:.3f} ({self.level:.0%} interval "
            f"{self.low:.3f} to {self.high:.3f}, {self.runs} runs)"
        )
        if self.high < 1.0 or self.eta < 0.9:
            return f"{text}: below the bound, so bound and simulation do not fit each other; this is no success"
        return f"{text}: {'at' if self.low <= 1.0 else 'above'} the bound"


def efficiency(errors: F64, bound: F64, level: float = 0.95, since: float = 0.5) -> Efficiency:
    """RMSE over the posterior Cramer-Rao bound, eta, in the second half of the arc.

    The interval counts runs, not epochs: a run's mean square error is taken as a chi-square variable whose degrees of
    freedom follow from the scatter between runs. With 3 of them, one sigma of eta is 1 / sqrt(6 M).

    Args:
        errors: (M, K, n), errors of M runs in the components of interest (position, say).
        bound: covariance of the bound of these components, (K, n, n) or (M, K, n, n).
        level: probability of the interval.
        since: part of the epochs left out at the beginning.

    Raises:
        ValueError: for shapes that do not fit, fewer than two runs, NaN, or a bound that is not positive.
    """
    e = np.asarray(errors, np.float64)
    if e.ndim != 3 or e.shape[0] < 2:
        raise ValueError(f"efficiency: expected errors (runs, epochs, n) of two runs or more, got {e.shape}")
    M, K, n = e.shape
    if np.shape(bound) not in ((K, n, n), (M, K, n, n)):
        raise ValueError(f"efficiency: expected a bound {(K, n, n)} or {(M, K, n, n)}, got {np.shape(bound)}")
    if not 0.0 <= since < 1.0:
        raise ValueError(f"efficiency: since is the part left out, from 0 to below 1, got {since}")
    trace = np.broadcast_to(np.trace(np.asarray(bound, np.float64), axis1=-2, axis2=-1), (M, K))
    first = int(since * K)
    e, trace = e[:, first:], trace[:, first:]
    if not (np.all(np.isfinite(e)) and np.all(trace > 0.0) and np.all(np.isfinite(trace))):
        raise ValueError("efficiency: errors or bound hold NaN, infinity or a bound <= 0; count lost runs apart")
    square: F64 = np.mean(np.sum(e * e, axis=-1), axis=1)
    limit: F64 = np.mean(trace, axis=1)
    ratio = square / limit
    mean, spread = float(np.mean(ratio)), float(np.var(ratio, ddof=1))
    freedom = 2.0 * mean * mean / spread if spread > 0.0 else np.inf
    tail = 0.5 * (1.0 - level)
    low = high = 1.0
    if np.isfinite(freedom):
        low, high = M * freedom / chi2.ppf([1.0 - tail, tail], M * freedom)
    eta = float(np.sqrt(mean))
    return Efficiency(
        eta,
        eta * float(np.sqrt(low)),
        eta * float(np.sqrt(high)),
        float(np.sqrt(np.mean(square))),
        float(np.sqrt(np.mean(limit))),
        level,
        float(freedom),
        M,
    )


def failure_bound(failed: int, runs: int, level: float = 0.95) -> float:
    """Upper bound of a probability of failure, one-sided, of which ``failed`` were seen in ``runs``.

    Raises:
        ValueError: for counts that cannot be.
    """
    if not 0 <= failed <= runs or runs < 1 or not 0.0 < level < 1.0:
        raise ValueError(f"failure_bound: expected 0 <= failed <= runs, runs >= 1, 0 < level < 1, got {failed}, {runs}")
    return 1.0 if failed == runs else float(beta.ppf(level, failed + 1, runs - failed))


@dataclass(frozen=True)
class Divergences:
    """Runs that were lost.

    Attributes:
        count: of them.
        runs: of all.
        upper: bound of the probability at ``level``, one-sided (Clopper and Pearson).
        level: its probability.
        which: numbers of the lost runs.
    """

    count: int
    runs: int
    upper: float
    level: float
    which: tuple[int, ...]

    def __str__(self) -> str:
        """Counts and the bound."""
        return f"{self.count}/{self.runs} diverged (probability below {self.upper:.2%} at {self.level:.0%})"


def divergences(errors: F64, sigma: F64, limit: float, factor: float = 5.0, level: float = 0.95) -> Divergences:
    """Runs whose final error is above 5 times the bound or above a limit; a final error of NaN counts as lost.

    Args:
        errors: (M,) size of the final error of each run, or (M, n) the final error itself.
        sigma: bound of its root mean square, a number or (M,).
        limit: largest error whatever the bound, such as 10 km or 1 degree, in the same units.
        factor: of the bound.
        level: probability of the bound of the rate.
    """
    size = np.asarray(errors, np.float64)
    if size.ndim == 2:
        size = np.linalg.norm(size, axis=1)
    if size.ndim != 1 or not np.all(np.asarray(sigma) > 0.0):
        raise ValueError(f"divergences: expected errors (M,) or (M, n) and a sigma above 0, got {np.shape(errors)}")
    lost = ~(np.abs(size) <= np.minimum(factor * np.asarray(sigma), limit))
    which = tuple(int(i) for i in np.flatnonzero(lost))
    return Divergences(len(which), len(size), failure_bound(len(which), len(size), level), level, which)


def time_to_converge(times: F64, errors: F64, sigma: F64, factor: float = 2.0) -> float:
    """Time from which the RMSE over the runs stays below twice the bound; NaN if the last epoch is above it.

    Args:
        times: (K,), any unit.
        errors: (M, K, n).
        sigma: (K,) bound of the root mean square of the error's size.
        factor: of the bound.
    """
    e, t, s = np.asarray(errors, np.float64), np.asarray(times, np.float64), np.asarray(sigma, np.float64)
    if e.ndim != 3 or t.shape != e.shape[1:2] or s.shape != t.shape:
        raise ValueError(
            f"time_to_converge: expected times (K,), errors (M, K, n), sigma (K,), got {t.shape}, {e.shape}, {s.shape}"
        )
    above = ~(np.sqrt(np.mean(np.sum(e * e, axis=-1), axis=0)) <= factor * s)
    late = np.flatnonzero(above)
    first = int(late[-1]) + 1 if len(late) else 0
    return float(t[first]) if first < len(t) else float("nan")
