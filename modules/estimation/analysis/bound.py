"""The posterior Cramer-Rao bound of a scenario: no filter's error can be smaller on average.

The recursion is that of Tichavsky, Muravchik and Nehorai (1998), "Posterior Cramer-Rao bounds for discrete-time
nonlinear filtering", IEEE Trans. Signal Processing 46(5), for small process noise that of Taylor (1979):

    J- = (Phi J^-1 Phi' + Q)^-1,    J+ = J- + sum p_d H' R^-1 H,    bound = J+^-1

with all matrices at the true trajectory. It is carried as a triangle U, J = U' U, in states divided by their scales
(Bierman 1977, "Factorization Methods for Discrete Sequential Estimation", ch. VI). So J may be singular (nothing known
at first), Q may be singular or zero, and two states that are seen apart by one part in 10^7 only stay apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from messages.base import F64
from modules.estimation.analysis.consistency import definite_factors

LINALG: Any = np.linalg
"""Its types say floating, not float64."""
Seen: TypeAlias = "tuple[F64, F64] | tuple[F64, F64, float]"
"""A measurement: H (m, n), R (m, m), and the probability that it is made (1 if left out)."""
Step: TypeAlias = "tuple[F64, F64, Sequence[Seen]]"
"""Phi (n, n), Q (n, n) of the interval, and the measurements at its end."""


def _matrix(value: F64, shape: tuple[int, int], what: str) -> F64:
    a = np.asarray(value, np.float64)
    if a.shape != shape or not np.all(np.isfinite(a)):
        state = "with NaN or infinity" if a.shape == shape else f"of shape {a.shape}"
        raise ValueError(f"Bound: {what}: expected finite numbers {shape}, got an array {state}")
    return a


def _triangle(rows: F64) -> F64:
    """Upper U (n, n) with U' U = A' A, for A (m, n) with any m."""
    n = rows.shape[1]
    R: F64 = LINALG.qr(rows, mode="r")
    return R if len(R) == n else np.vstack([R, np.zeros((n - len(R), n))])


def semidefinite_rows(Q: F64, what: str) -> F64:
    """B (r, n) with B' B = Q, r the rank of a covariance (n, n) that may be singular.

    Raises:
        ValueError: if Q is not symmetric or has a negative eigenvalue, beyond rounding.
    """
    d = np.sqrt(np.abs(np.diag(Q)))
    used = np.where(d > 0.0, d, 1.0)
    part = Q / np.outer(used, used)
    if np.max(np.abs(part - part.T), initial=0.0) > 1e-9:
        raise ValueError(f"Bound: {what} is not symmetric; give (Q + Q') / 2 if that is rounding")
    values, vectors = np.linalg.eigh(0.5 * (part + part.T))
    if values[0] < -1e-9 * max(1.0, values[-1]):
        raise ValueError(
            f"Bound: {what} has a negative eigenvalue ({values[0]:.2g} of its diagonal); it is no covariance"
        )
    kept = values > 1e-14 * max(values[-1], 1e-300)
    return (np.sqrt(values[kept]) * vectors[:, kept]).T * used


@dataclass
class Bound:
    """The bound of the error of n states and of nuisance states, step by step.

    Nuisance states (misalignment, focal length, map bias) are appended, with priors and constant unless `predict` says
    otherwise. What is read is the marginal: the bound of the n states for a filter that does not know the nuisance.

    Attributes:
        P0: prior covariance (n, n), or None for no prior, which then needs ``scale``.
        scale: (n,) a typical size of each state, for the arithmetic only; the prior sigma if left out.
        nuisance: prior covariance (b, b) of the nuisance states.
    """

    P0: F64 | None
    scale: F64 | None = None
    nuisance: F64 | None = None
    _U: F64 = field(init=False, repr=False)
    _d: F64 = field(init=False, repr=False)
    _n: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the priors and factor them."""
        if self.P0 is None and self.scale is None:
            raise ValueError("Bound: without a prior P0 give scale, a typical size of each state")
        size = np.diag(self.P0) if self.scale is None and self.P0 is not None else np.asarray(self.scale) ** 2
        blocks = [(self.P0, size)]
        if self.nuisance is not None:
            blocks.append((self.nuisance, np.diag(self.nuisance)))
        squares = np.concatenate([d for _, d in blocks]).astype(np.float64)
        if not (np.all(squares > 0.0) and np.all(np.isfinite(squares))):
            raise ValueError(f"Bound: expected scales and prior variances above zero, got squares {squares.tolist()}")
        self._n, self._d = len(size), np.sqrt(squares)
        self._U = np.zeros((len(self._d), len(self._d)))
        at = 0
        for P, squares in blocks:
            n, d = len(squares), np.sqrt(squares)
            if P is not None:
                sigma, L = definite_factors(_matrix(P, (n, n), "prior")[None], "Bound: prior")
                inverse: F64 = LINALG.solve(L[0], np.diag(d / sigma[0]))
                self._U[at : at + n, at : at + n] = _triangle(inverse)
            at += n

    def predict(self, Phi: F64, Q: F64, nuisance: tuple[F64, F64] | None = None) -> None:
        """Over an interval.

        Args:
            Phi: transition (n, n), invertible as that of every motion in time.
            Q: covariance (n, n) of the process noise of the whole interval; singular or zero is well.
            nuisance: transition and noise (b, b) of the nuisance states; identity and zero if left out.

        Raises:
            ValueError: for wrong shapes, a Phi that cannot be inverted (use `predict_blocks`), or a Q that is no
                covariance.
        """
        n, b = self._n, len(self._d) - self._n
        F, W = np.eye(n + b), np.zeros((n + b, n + b))
        F[:n, :n], W[:n, :n] = _matrix(Phi, (n, n), "Phi"), _matrix(Q, (n, n), "Q")
        if nuisance is not None:
            F[n:, n:], W[n:, n:] = (
                _matrix(nuisance[0], (b, b), "Phi of the nuisance"),
                _matrix(nuisance[1], (b, b), "Q of the nuisance"),
            )
        F = F * self._d / self._d[:, None]
        if np.linalg.cond(F) > 1e14:
            raise ValueError("Bound: Phi cannot be inverted; use predict_blocks, which does not invert it")
        noise = semidefinite_rows(W, "Q") / self._d
        back = np.linalg.solve(F.T, self._U.T).T  # U Phi^-1
        r = len(noise)
        rows = np.zeros((r + len(back), r + n + b))
        rows[:r, :r] = np.eye(r)
        rows[r:, :r] = -back @ noise.T
        rows[r:, r:] = back
        self._U = _triangle(rows)[r:, r:]

    def predict_blocks(self, D11: F64, D12: F64, D22: F64) -> None:
        """Over an interval, by the general recursion J <- D22 - D12' (J + D11)^-1 D12.

        For process noise so large that the blocks are averages over true trajectories. With additive noise they are
        D11 = E[Phi' Q^-1 Phi], D12 = -E[Phi'] Q^-1, D22 = Q^-1. Nuisance states are included: all are (n + b, n + b).

        Raises:
            ValueError: for wrong shapes, or blocks that are no information matrix together.
        """
        n = len(self._d)
        d = np.outer(self._d, self._d)
        D = [_matrix(m, (n, n), name) * d for m, name in ((D11, "D11"), (D12, "D12"), (D22, "D22"))]
        joint = semidefinite_rows(np.block([[D[0], D[1]], [D[1].T, D[2]]]), "the matrix of D11, D12, D22")
        self._U = _triangle(np.vstack([np.hstack([self._U, np.zeros((n, n))]), joint]))[n:, n:]

    def measure(self, H: F64, R: F64, detection: float = 1.0, nuisance: F64 | None = None) -> None:
        """By a measurement.

        Args:
            H: derivative (m, n) with respect to the states.
            R: covariance (m, m) of its noise.
            detection: probability that it is there and no outlier, which multiplies the information.
            nuisance: derivative (m, b) with respect to the nuisance states; zero if left out.

        Raises:
            ValueError: for wrong shapes, a probability outside 0 to 1, or an R that is not positive definite.
        """
        m, n, b = np.shape(R)[0], self._n, len(self._d) - self._n
        if not 0.0 <= detection <= 1.0:
            raise ValueError(f"Bound: the probability of detection is {detection}; expected 0 to 1")
        full = np.zeros((m, n + b))
        full[:, :n] = _matrix(H, (m, n), "H")
        if nuisance is not None:
            full[:, n:] = _matrix(nuisance, (m, b), "H of the nuisance")
        d, L = definite_factors(_matrix(R, (m, m), "R")[None], "Bound: R")
        rows: F64 = LINALG.solve(L[0], full * self._d / d[0][:, None]) * np.sqrt(detection)
        self._U = _triangle(np.vstack([self._U, rows]))

    def information(self) -> F64:
        """J (n + b, n + b), nuisance states included."""
        return (self._U / self._d).T @ (self._U / self._d)

    def triangle(self) -> F64:
        """U (n + b, n + b), J = U' U, of the states divided by their scales."""
        return self._U.copy()

    def covariance(self, everything: bool = False) -> F64:
        """The bound (n, n), or with nuisance states (n + b, n + b).

        Raises:
            ValueError: if some combination of states is not seen at all, so that there is no bound.
        """
        values = np.linalg.svd(self._U, compute_uv=False)
        if not values[-1] > 1e-15 * values[0]:
            raise ValueError(
                "Bound: the information is singular: a combination of states was never measured and has no prior; "
                "see observability()"
            )
        half = self._d[:, None] * np.linalg.inv(self._U)
        P = half @ half.T
        return P if everything else P[: self._n, : self._n]

    def sigma(self, which: Sequence[int]) -> float:
        """Root mean square of the size of the error of a group of states, sqrt(trace)."""
        return float(np.sqrt(np.trace(self.covariance(True)[np.ix_(which, which)])))


@dataclass(frozen=True)
class BoundHistory:
    """The bound after each step.

    Attributes:
        P: (K, n, n) covariances.
        sigma: (K,) for each group of states.
    """

    P: F64
    sigma: dict[str, F64]


def bound_steps(bound: Bound, steps: Iterable[Step]) -> Iterator[F64]:
    """The bound (n, n) after each step of a scenario; ``bound`` holds the prior and moves along.

    Args:
        bound: with the prior.
        steps: Phi, Q and measurements (H, R, p_d) of each step.
    """
    for Phi, Q, measurements in steps:
        bound.predict(Phi, Q)
        for one in measurements:
            bound.measure(one[0], one[1], one[2] if len(one) == 3 else 1.0)
        yield bound.covariance()


def bound_history(bound: Bound, steps: Iterable[Step], groups: Mapping[str, Sequence[int]]) -> BoundHistory:
    """The bound after each step with the size of the error of groups of states, as {"position": [0, 1, 2]}."""
    P = np.array(list(bound_steps(bound, steps)))
    if not len(P):
        raise ValueError("bound_history: there are no steps; give at least one")
    sums = {name: np.sqrt(np.trace(P[:, which][:, :, which], axis1=1, axis2=2)) for name, which in groups.items()}
    return BoundHistory(P, sums)
