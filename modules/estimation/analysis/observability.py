"""What a sequence of measurements can tell apart, in words.

The information of all measurements is gathered at the last epoch, in states divided by their scales, as a triangle U
(J = U' U). A singular value s of U belongs to a combination of states that the measurements give to 1 / s scales.

Source: the constructibility Gramian, as in Maybeck (1979), "Stochastic Models, Estimation, and Control", vol. 1,
sec. 2.5, with weights R^-1; with process noise, the information that it leaves (Bierman 1977, ch. VI).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from messages.base import F64
from modules.estimation.analysis.bound import Bound, Step

SHOWN = 0.05
"""Least part of a combination that is written."""


@dataclass(frozen=True)
class Direction:
    """A combination of states and how well it is known.

    Attributes:
        weights: (n,) of length 1, of the states divided by their scales.
        singular_value: of the information's root; 0 for a combination that is not seen at all.
        sigma: standard deviation along it in scales, infinite if it is not seen.
        text: the combination in words.
    """

    weights: F64
    singular_value: float
    sigma: float
    text: str


@dataclass(frozen=True)
class Observability:
    """Report of what is observable; `str` writes it.

    Attributes:
        names, units, scale: of the states.
        information: (n, n) in scaled units, prior excluded.
        singular_values: (n,) of its root, falling.
        rank: number of combinations that are seen at all.
        hidden: combinations that are not.
        weak: combinations that are seen, but worse than to one scale (so worse than a prior with these sigmas).
        strong: the others, the best first.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: F64
    information: F64
    singular_values: F64
    rank: int
    hidden: tuple[Direction, ...]
    weak: tuple[Direction, ...]
    strong: tuple[Direction, ...]

    def __str__(self) -> str:
        """The report."""
        n = len(self.names)
        lines = [f"{self.rank} of {n} combinations of states are observable."]
        for one in self.hidden:
            lines.append(f"Not observable: {one.text}.")
            if len(pair := np.flatnonzero(np.abs(one.weights) >= SHOWN)) == 2:
                a, b = pair
                other = np.zeros(n)
                other[a], other[b] = (
                    abs(one.weights[b]),
                    -np.sign(one.weights[a] * one.weights[b]) * abs(one.weights[a]),
                )
                lines.append(f"    Of the two only this is seen: {combination(other, self.names)}.")
        lines += [
            f"Weakly observable, to {one.sigma:.3g} scales, worse than the scale itself: {one.text}."
            for one in self.weak
        ]
        lines.append("Singular values, and what the measurements give without a prior:")
        lines += [f"    {one.singular_value:10.3g}  to {one.sigma:9.3g} scales: {one.text}" for one in self.strong]
        lines += [f"    {one.singular_value:10.3g}  to {one.sigma:9.3g} scales: {one.text}" for one in self.weak]
        lines += [f"    {0.0:10.3g}  never: {one.text}" for one in self.hidden]
        scales = ", ".join(f"{a} {s:.3g} {u}" for a, s, u in zip(self.names, self.scale, self.units, strict=True))
        lines.append(f"One scale is: {scales}.")
        return "\n".join(lines)


def combination(weights: F64, names: Sequence[str]) -> str:
    """A weighted sum of states, the first one positive; parts below `SHOWN` are left out."""
    shown = [i for i in np.argsort(-np.abs(weights), kind="stable") if abs(weights[i]) >= SHOWN]
    shown.sort(key=lambda i: (-round(abs(float(weights[i])), 6), i))
    sign = np.sign(weights[shown[0]]) if shown else 1.0
    text = ""
    for count, i in enumerate(shown):
        w = float(sign * weights[i])
        joint = "" if count == 0 else (" + " if w > 0.0 else " - ")
        text += f"{joint}{abs(w):.2f} {names[i]}"
    return text


def sparse_basis(basis: F64) -> F64:
    """Basis (k, n), rows of length 1, of the space of the rows of ``basis`` with few states in each.

    Singular vectors of equal singular values are an arbitrary mixture; Gauss-Jordan elimination with full pivoting
    separates them.
    """
    rows = basis.copy()
    free, left = list(range(rows.shape[1])), list(range(len(rows)))
    while left:
        part = np.abs(rows[np.ix_(left, free)])
        # of nearly equal pivots the last state, so that a nuisance state is explained by the main ones
        at = np.argwhere(part >= part.max() * (1.0 - 1e-6))[-1]
        i, j = left[int(at[0])], free[int(at[1])]
        rows[i] /= rows[i, j]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, j] * rows[i]
        left.remove(i)
        free.remove(j)
    rows[np.abs(rows) < 1e-7] = 0.0
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def observability(
    steps: Iterable[Step],
    names: Sequence[str],
    units: Sequence[str],
    scale: F64,
    P0: F64 | None = None,
) -> Observability:
    """What the measurements of a sequence tell about the states at its end.

    Args:
        steps: transition Phi (n, n), process noise Q (n, n) of the interval before, and measurements (H, R) or
            (H, R, p_d) at its end, for each epoch. With Q = 0 everywhere this is the classical Gramian.
        names: of the states.
        units: of the states.
        scale: (n,) a size of each state that matters, in its unit: the prior sigma is a good choice. Whether a
            combination is weak, and what its weights are, refers to it; whether it is hidden does not.
        P0: prior covariance (n, n), for a report of what is known after all with it; without, of measurements alone.

    Raises:
        ValueError: for shapes that do not fit or matrices that cannot be.
    """
    n = len(names)
    d = np.asarray(scale, np.float64)
    if len(units) != n or d.shape != (n,):
        raise ValueError(f"observability: {n} names, {len(units)} units, scales {d.shape}; expected as many of each")
    bound = Bound(P0, d)
    for Phi, Q, measurements in steps:
        bound.predict(Phi, Q)
        for one in measurements:
            bound.measure(one[0], one[1], one[2] if len(one) == 3 else 1.0)
    U = bound.triangle()
    _, values, rows = np.linalg.svd(U)
    # rounding of a triangle made of many rows, far below what any sensor's dynamic range spans
    floor = 1e-12 * max(values[0], 1e-300)
    rank = int(np.count_nonzero(values > floor))
    unseen = sorted(sparse_basis(rows[rank:]), key=lambda w: int(np.argmax(np.abs(w) >= SHOWN)))
    hidden = tuple(Direction(w, 0.0, np.inf, combination(w, names)) for w in unseen)
    seen = [
        Direction(w, float(s), float(1.0 / s), combination(w, names))
        for w, s in zip(rows[:rank], values[:rank], strict=True)
    ]
    weak, strong = tuple(x for x in seen if x.sigma > 1.0), tuple(x for x in seen if x.sigma <= 1.0)
    return Observability(tuple(names), tuple(units), d, U.T @ U, values, rank, hidden, weak, strong)
