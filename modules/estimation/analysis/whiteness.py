"""Do innovations forget? A filter that has used all there is in its measurements leaves white noise behind.

Sources: Bar-Shalom, Li and Kirubarajan (2001), sec. 5.4.2 (time-average autocorrelation); Ljung and Box (1978),
Biometrika 65:297; Hosking (1980), JASA 75:602 (several components).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2 as _chi2
from scipy.stats import norm as _norm

from messages.base import F64, I64
from modules.estimation.analysis.consistency import Missing, whitened

chi2: Any = _chi2
norm: Any = _norm
LINALG: Any = np.linalg


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of innovations and the test of all lags together.

    Attributes:
        correlation: (lags,) normalised autocorrelation at 1, 2, ... epochs, over all runs and components.
        bound: (lags,) half width of its band about zero.
        statistic: of Ljung and Box, all lags.
        degrees: of its chi-square distribution.
        p_value: probability of such a statistic or a larger one, if the innovations are white.
        level: probability of the bands.
        pairs: (lags,) pairs of epochs that went into each lag.
        missing: epochs left out.
    """

    correlation: F64
    bound: F64
    statistic: float
    degrees: int
    p_value: float
    level: float
    pairs: I64
    missing: int

    @property
    def inside(self) -> float:
        """Fraction of the lags inside their band; `level` is expected."""
        return float(np.mean(np.abs(self.correlation) <= self.bound))

    @property
    def white(self) -> bool:
        """Whether the test of all lags passes at `level`."""
        return self.p_value >= 1.0 - self.level

    def __str__(self) -> str:
        """One sentence with the figures and what they mean."""
        worst = int(np.argmax(np.abs(self.correlation) / self.bound))
        word = "white" if self.white else "not white: measurements hold more than the filter takes from them"
        lost = f", {self.missing} epochs left out" if self.missing else ""
        return (
            f"Innovations: Ljung-Box {self.statistic:.4g} with {self.degrees} degrees of freedom, p = "
            f"{self.p_value:.3g}; {self.inside:.0%} of {len(self.correlation)} lags inside their band, the farthest "
            f"{self.correlation[worst]:+.3f} at lag {worst + 1} (band {self.bound[worst]:.3f}){lost}: {word}"
        )


def whiteness(innovations: F64, S: F64, lags: int = 10, level: float = 0.95, missing: Missing = "refuse") -> Whiteness:
    """Autocorrelation in time of the innovations of independent runs at equal intervals.

    The mean is not taken out first: the innovations of a right filter have none, and a bias ought to show.

    Args:
        innovations: (M, K, m), M runs, K epochs.
        S: their stated covariance, (M, K, m, m), (K, m, m) or (m, m). The correlation is that of the innovations
            normalised by it; the statistic of Ljung and Box uses the covariance that they show.
        lags: number of lags, below K.
        level: probability of the bands and of the verdict.
        missing: "refuse" raises for a NaN, "omit" leaves out the pairs that it is in.

    Raises:
        ValueError: as `nees`, and if there are too few epochs for the lags.
    """
    white = whitened(innovations, S, "innovations", missing)
    _, K, m = white.shape
    if not 1 <= lags < K:
        raise ValueError(f"whiteness: {lags} lags need more than {lags} epochs and at least one lag, got {K} epochs")
    known = np.all(np.isfinite(white), axis=-1)
    filled = np.where(known[..., None], white, 0.0)
    count = int(np.count_nonzero(known))
    shown = np.einsum("rki,rkj->ij", filled, filled) / count
    if np.linalg.matrix_rank(shown) < m:
        raise ValueError("whiteness: the innovations do not vary in all their components; give measured ones")
    own: F64 = LINALG.solve(LINALG.cholesky(shown), filled[..., None])[..., 0]
    correlation, pairs, statistic = np.empty(lags), np.empty(lags, np.int64), 0.0
    for lag in range(1, lags + 1):
        early, late = filled[:, :-lag], filled[:, lag:]
        both = known[:, :-lag] & known[:, lag:]
        pairs[lag - 1] = np.count_nonzero(both)
        if pairs[lag - 1] == 0:
            raise ValueError(f"whiteness: no two epochs {lag} apart are both known; give fewer lags")
        power = np.sum(early[both] ** 2) * np.sum(late[both] ** 2)
        correlation[lag - 1] = np.sum(early[both] * late[both]) / np.sqrt(power)
        matrix = np.einsum("ri,rj->ij", own[:, :-lag][both], own[:, lag:][both]) / count
        statistic += float(np.sum(matrix**2)) / pairs[lag - 1]
    statistic *= count * (count + 2.0)
    degrees = m * m * lags
    bound = norm.ppf(0.5 + 0.5 * level) / np.sqrt(m * pairs)
    p_value = float(chi2.sf(statistic, degrees))
    return Whiteness(correlation, bound, statistic, degrees, p_value, level, pairs, int(known.size - count))
