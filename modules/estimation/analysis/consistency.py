"""Is the stated covariance honest? Normalised squares of errors (NEES) and of innovations (NIS) with their bands.

Source: Bar-Shalom, Li and Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation", sec. 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.stats import chi2 as _chi2
from scipy.stats import t as _student

from messages.base import F64, I64

chi2: Any = _chi2
student: Any = _student
Missing = Literal["refuse", "omit"]


def definite_factors(P: F64, name: str) -> tuple[F64, F64]:
    """Scales d (..., n) and lower factors L (..., n, n) of the correlations, P = d L L' d, of covariances (..., n, n).

    Only finite covariances may be given.

    Raises:
        ValueError: if one is not symmetric to 1e-9 of its diagonal or not positive definite; the text says which.
    """
    variance = np.diagonal(P, axis1=-2, axis2=-1)
    if np.any(variance <= 0.0):
        at = tuple(int(i) for i in np.argwhere(np.any(variance <= 0.0, axis=-1))[0])
        raise ValueError(
            f"{name}: covariance {at} has the diagonal {variance[at].tolist()}; expected variances above zero: it is "
            "not positive definite"
        )
    d = np.sqrt(variance)
    part = P / (d[..., :, None] * d[..., None, :])
    skew = np.max(np.abs(part - np.swapaxes(part, -1, -2)), axis=(-2, -1))
    if np.any(skew > 1e-9):
        at = tuple(int(i) for i in np.argwhere(skew > 1e-9)[0])
        raise ValueError(
            f"{name}: covariance {at} is not symmetric, by {skew[at]:.2g} of its diagonal; give (P + P') / 2 if that "
            "is rounding, and look for a wrong triangle if it is not"
        )
    try:
        return d, np.asarray(np.linalg.cholesky(part), np.float64)
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(part)[..., 0]
        at = tuple(int(i) for i in np.unravel_index(np.argmin(least), least.shape))
        raise ValueError(
            f"{name}: covariance {at} is not positive definite: the least eigenvalue of its correlations is "
            f"{least[at]:.3g}; a normalised square of it would mean nothing"
        ) from None


def whitened(vectors: F64, covariance: F64, name: str, missing: Missing = "refuse") -> F64:
    """L^-1 v with P = L L': components of unit variance and no correlation if the covariance is right.

    Args:
        vectors: (M, K, n), M independent runs of K epochs.
        covariance: (n, n), (K, n, n) or (M, K, n, n), in the same units.
        name: for messages.
        missing: "refuse" raises if an epoch holds a NaN; "omit" gives NaN there.

    Returns:
        (M, K, n), NaN where vector or covariance is not finite.

    Raises:
        ValueError: for shapes that do not fit, for NaN (unless omitted), and for covariances that are not positive.
    """
    v = np.asarray(vectors, np.float64)
    if v.ndim != 3:
        raise ValueError(f"{name}: expected an array (runs, epochs, n), got {v.shape}; for one run give v[None]")
    M, K, n = v.shape
    try:
        P = np.broadcast_to(np.asarray(covariance, np.float64), (M, K, n, n))
    except ValueError:
        raise ValueError(
            f"{name}: covariances {np.shape(covariance)} do not fit vectors {v.shape}; expected (n, n), (K, n, n) or "
            f"(M, K, n, n) with M, K, n = {M}, {K}, {n}"
        ) from None
    good = np.all(np.isfinite(v), axis=-1) & np.all(np.isfinite(P), axis=(-2, -1))
    lost = int(good.size - np.count_nonzero(good))
    if lost and (missing == "refuse" or lost == good.size):
        at = tuple(int(i) for i in np.argwhere(~good)[0])
        raise ValueError(
            f"{name}: {lost} of {good.size} epochs are not finite, the first is run {at[0]}, epoch {at[1]}; find out "
            'why, or say missing="omit" to leave them out and have them counted'
        )
    out = np.full(v.shape, np.nan)
    index = np.argwhere(good)
    try:
        d, L = definite_factors(P[good], name)
    except ValueError as error:  # the number among the finite ones says nothing to the caller
        for i, j in index:
            try:
                definite_factors(P[i, j][None], name)
            except ValueError as one:
                raise ValueError(str(one).replace("covariance (0,)", f"covariance of run {i}, epoch {j}")) from None
        raise AssertionError from error
    out[good] = np.linalg.solve(L, (v[good] / d)[..., None])[..., 0]
    return out


@dataclass(frozen=True)
class Consistency:
    """Normalised squares of M runs and K epochs, and the bands of their means.

    Attributes:
        name: NEES or NIS.
        values: (M, K), NaN where left out.
        degrees: expected value of each, the number of components.
        level: probability of the bands, both tails together outside of it.
        mean: (K,) over the runs, NaN where no run is left.
        low, high: (K,) band of this mean.
        counted: (K,) runs of each epoch.
        total_mean: over all epochs and runs.
        total_low, total_high: band of it. Errors of a filter are correlated in time, so a NEES counts as one sample
            for each run, however many epochs there are: the band is that of a single epoch. A NIS counts all.
        missing: epochs left out.
    """

    name: str
    values: F64
    degrees: int
    level: float
    mean: F64
    low: F64
    high: F64
    counted: I64
    total_mean: float
    total_low: float
    total_high: float
    missing: int

    @property
    def inside(self) -> float:
        """Fraction of the epochs whose mean over the runs is inside its band; `level` is expected."""
        known = self.counted > 0
        return float(np.mean((self.mean >= self.low)[known] & (self.mean <= self.high)[known]))

    @property
    def consistent(self) -> bool:
        """Whether the mean over runs and epochs is inside its band."""
        return self.total_low <= self.total_mean <= self.total_high

    def interval(self) -> tuple[float, float]:
        """Interval of the total mean at `level` from the scatter between runs, of which two are needed.

        Student's t of the time means of the runs. Unlike the band it asks for no distribution, so it says how well
        the mean of a wrong filter is known.
        """
        means: F64 = np.nanmean(self.values[np.any(np.isfinite(self.values), axis=1)], axis=1)
        if len(means) < 2:
            raise ValueError(f"{self.name}: one run has no scatter between runs; simulate more of them")
        half = float(student.ppf(0.5 + 0.5 * self.level, len(means) - 1) * np.std(means, ddof=1) / np.sqrt(len(means)))
        return float(np.mean(means)) - half, float(np.mean(means)) + half

    def __str__(self) -> str:
        """One sentence with the figures and what they mean."""
        ratio = self.total_mean / self.degrees
        if self.consistent:
            word = "consistent"
        elif ratio > 1.0:
            word = f"overconfident: the covariance is too small by a factor of {ratio:.3g} or there is a bias"
        else:
            word = f"cautious: the covariance is too large by a factor of {1.0 / ratio:.3g}"
        runs, epochs = self.values.shape
        lost = f", {self.missing} left out" if self.missing else ""
        return (
            f"{self.name} {self.total_mean:.4g} (expected {self.degrees}, {self.level:.0%} band {self.total_low:.4g} "
            f"to {self.total_high:.4g}; {self.inside:.0%} of the epochs inside theirs; {runs} runs of {epochs} epochs"
            f"{lost}): {word}"
        )


def band(degrees: int, samples: int, level: float = 0.95) -> tuple[float, float]:
    """Band of the mean of independent normalised squares, both tails outside: chi-square of all degrees over samples.

    Args:
        degrees: components of each vector.
        samples: independent ones; for a NEES the runs, not the epochs.
        level: probability inside.
    """
    if degrees < 1 or samples < 1 or not 0.0 < level < 1.0:
        raise ValueError(
            f"band: expected degrees >= 1, samples >= 1 and a level between 0 and 1, got {degrees}, {samples}, {level}"
        )
    tail = 0.5 * (1.0 - level)
    low, high = chi2.ppf([tail, 1.0 - tail], degrees * samples) / samples
    return float(low), float(high)


def nees(errors: F64, P: F64, level: float = 0.95, missing: Missing = "refuse") -> Consistency:
    """Normalised estimation error squared e' P^-1 e of independent runs.

    Args:
        errors: (M, K, n) estimate minus truth (attitudes as small rotation vectors), M runs, K epochs.
        P: stated covariance, (M, K, n, n), (K, n, n) or (n, n).
        level: probability of the bands.
        missing: "refuse" raises for a NaN, "omit" leaves such epochs out and counts them.

    Raises:
        ValueError: for shapes that do not fit, NaN, and a covariance that is not symmetric and positive definite.
    """
    return _consistency("NEES", errors, P, level, missing, False)


def nis(innovations: F64, S: F64, level: float = 0.95, missing: Missing = "refuse") -> Consistency:
    """Normalised innovation squared v' S^-1 v of independent runs; arguments and errors as `nees`.

    The innovations of a right filter are white, so the band of the total mean counts epochs times runs. It needs no
    truth, so it works on flight data too, with one run.
    """
    return _consistency("NIS", innovations, S, level, missing, True)


def _consistency(name: str, vectors: F64, P: F64, level: float, missing: Missing, white: bool) -> Consistency:
    values: F64 = np.sum(whitened(vectors, P, name, missing) ** 2, axis=-1)
    n, known = np.shape(vectors)[-1], np.isfinite(values)
    counted = np.count_nonzero(known, axis=0)
    mean, low, high = np.full((3, len(counted)), np.nan)
    for k in np.flatnonzero(counted):
        mean[k] = np.mean(values[known[:, k], k])
        low[k], high[k] = band(n, int(counted[k]), level)
    independent = np.count_nonzero(known) if white else np.count_nonzero(np.any(known, axis=1))
    total_low, total_high = band(n, int(independent), level)
    used: F64 = values[known]
    total, lost = float(np.mean(used)), known.size - used.size
    return Consistency(
        name, values, n, level, mean, low, high, counted.astype(np.int64), total, total_low, total_high, lost
    )
