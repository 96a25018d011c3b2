"""Circle or ellipse through the points of a limb, with a covariance that knows of relief and of ovals not seen.

The limb's distance from a circle is taken for a random function of the azimuth: ovals, relief whose variance falls with
the harmonic, what the points of a sector share, and noise. How much of each is not known before; the points say
(restricted likelihood), and what they cannot say stays in the covariance. A long limb decides by itself. On a
short one relief and ovals look like another radius, and the covariance is that of all that would look the same.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.ellipse import Ellipse, fit, rows_of
from modules.opnav.disks.limb import Limb

MODEL_PX = 0.06
MODEL_TURN = 0.5
"""Standard deviation that the model of the profile adds [px], and over which azimuth it changes [rad]: its errors on
rendered disks of four laws of reflection, with blurs of 0.5 to 1.2 px."""
SHARED = 0.25
"""Share of a sector's common shift: its deviation is for any shape of profile, and real ones are much alike."""
LEAST_SIGMA = 0.02
"""No point is better than this [px]."""
FAR_PX = 4.0
WALD = 22.0
"""An outline counts as no circle if the square of its ovals is this many times their variance (4.7 sigma)."""
BINS = 48
"""Points are taken together to this many."""
HARMONICS = np.arange(3.0, 120.0)
SPECTRUM = HARMONICS**-2.3 / (HARMONICS**-2.3).sum()
"""Shares of relief's variance: limbs of Saturn's moons fall with the harmonic to the power of 2 to 2.5 (Nimmo 2011)."""
_TURNS = np.linspace(0.0, 2.0 * math.pi, 2001)
RELIEF_TABLE: F64 = np.cos(_TURNS[:, None] * HARMONICS) @ SPECTRUM
"""Its correlation over azimuth."""
RELIEF = np.geomspace(3e-5, 0.02, 14)
RELIEF_PRIOR = -0.5 * (np.log(RELIEF / 7e-4) / 1.4) ** 2
"""Root mean square of relief to the radius that is tried, and its log prior: planets to small moons."""
ROUGH = np.array([1.0, 1.5, 2.2, 3.3, 5.0])
ROUGH_PRIOR = -1.5 * np.log(ROUGH)
"""Noise to what was expected: texture and craters make more of it."""
OVALS = np.array([0.0003, 0.005, 0.013, 0.035])
OVALS_PRIOR = np.log(np.array([0.6, 0.18, 0.17, 0.05]))
"""Standard deviation of each oval, and how many bodies are such: Mars 0.002, Tethys 0.006, Jupiter 0.03."""
ROUND = 0.4
"""If it is a circle with this probability, the answer is one; the others go to the covariance."""


class Outline(NamedTuple):
    """The fitted curve, its covariance (5, 5), the points that agree (n,), and their scatter to what was expected."""

    ellipse: Ellipse
    oval: bool
    P: F64
    keep: NDArray[np.bool_]
    scale: float


def outline(start: Ellipse, limb: Limb) -> Outline | None:
    """Fit an ellipse of which nothing is known but that bodies are nearly round.

    Args:
        start: near the answer.
        limb: points.

    Returns:
        The curve, or None if there is none.
    """
    sigma = np.hypot(limb.sigma, LEAST_SIGMA)
    e, keep, scale = fit(start, limb.x, limb.y, sigma, True, FAR_PX)
    if not math.isfinite(scale):
        e, keep, scale = fit(start._replace(oval_x=0.0, oval_y=0.0), limb.x, limb.y, sigma, False, FAR_PX)
    if not math.isfinite(scale):
        return None
    P = np.eye(5)
    for _ in range(3):
        made, P = estimate(e, limb.pick(keep), sigma[keep])
        if not (1.0 < made.radius < 1e6 and math.hypot(made.oval_x, made.oval_y) < 0.5 and np.isfinite(P).all()):
            return None
        moved = math.hypot(made.x - e.x, made.y - e.y) + made.radius * math.hypot(
            made.oval_x - e.oval_x, made.oval_y - e.oval_y
        )
        e = made
        if moved < 0.02 * made.radius**0.5:  # beyond, the curve is not a linear function of its parameters
            break
    ovals = np.array([e.oval_x, e.oval_y])
    wald = float(ovals @ np.linalg.solve(P[3:, 3:], ovals))
    return Outline(e, wald > WALD, P, keep, max(scale, 1.0))


class Bins(NamedTuple):
    """Groups of neighbouring points (m,): distance from the curve, derivatives (m, 5), covariance (m, m), azimuth."""

    d: F64
    rows: F64
    V: F64
    theta: F64


def bins_of(e: Ellipse, limb: Limb, sigma: F64) -> Bins:
    """Weighted means of the points' distances, with the covariance of noise and sectors."""
    n = len(limb.x)
    theta = np.arctan2(limb.y - e.y, limb.x - e.x)
    order = np.argsort(theta, kind="stable")
    d, weight = e.distance(limb.x, limb.y)[0], sigma**-2.0
    # The noise is what neighbours differ by
    near = np.diff(d[order]) / np.hypot(sigma[order][1:], sigma[order][:-1])
    noise = max(1.4826 * float(np.median(np.abs(near))), 0.5)
    group = np.empty(n, np.int64)
    group[order] = np.arange(n) * min(BINS, n) // n
    total = np.bincount(group, weight)

    def mean(values: F64) -> F64:
        return np.bincount(group, weight * values) / total

    rows = rows_of(e, limb.x, limb.y, True)
    V = np.diag(noise**2 / total)
    sectors = np.flatnonzero(np.bincount(limb.sector))
    share = np.array([mean((limb.sector == s) * 1.0) for s in sectors])
    V += (share.T * (SHARED * limb.common[sectors]) ** 2) @ share
    middle = np.arctan2(mean(np.sin(theta)), mean(np.cos(theta)))
    # What is wrong with the model is some levels, so more pixels where the fall is low: near the horns
    model = MODEL_PX * np.clip(np.quantile(limb.step, 0.75) / np.maximum(mean(limb.step), 1e-9), 1.0, 20.0)
    V += np.outer(model, model) * np.exp((np.cos(middle[:, None] - middle) - 1.0) / MODEL_TURN**2)
    return Bins(mean(d), np.column_stack([mean(r) for r in rows.T]), V, middle)


def estimate(e: Ellipse, limb: Limb, sigma: F64) -> tuple[Ellipse, F64]:
    """Mean and covariance (5, 5) of column, row, radius and ovals, linear about an ellipse.

    Args:
        e: about where the answer is.
        limb: points that agree.
        sigma: their standard deviations [px].
    """
    b = bins_of(e, limb, sigma)
    turn = np.abs(b.theta[:, None] - b.theta)
    relief: F64 = np.asarray(np.interp(turn, _TURNS, RELIEF_TABLE), float) * e.radius**2
    # In the axes of relief whitened by noise, all mixtures q^2 V + s^2 relief are diagonal
    root = np.linalg.inv(np.linalg.cholesky(b.V))
    size, axes = np.linalg.eigh(root @ relief @ root.T)
    white = axes.T @ root
    d, rows = white @ b.d, white @ b.rows
    unit = np.array([1.0, 1.0, 1.0, e.radius, e.radius])  # all five in px
    rows = rows / unit
    variance = ROUGH[:, None, None] ** 2 + RELIEF[:, None] ** 2 * np.maximum(size, 0.0)
    w = 1.0 / variance.reshape(-1, len(d))
    left = (w @ (rows[:, :, None] * rows[:, None, :]).reshape(-1, 25)).reshape(-1, 5, 5)
    right = w @ (rows * d[:, None])
    # Priors of the ovals: of what is added to those of the ellipse
    prior = (OVALS * e.radius) ** -2.0
    now = np.array([e.oval_x, e.oval_y]) * e.radius
    left = np.repeat(left[:, None], len(OVALS), axis=1)
    right = np.repeat(right[:, None], len(OVALS), axis=1)
    left[..., [3, 4], [3, 4]] += prior[:, None]
    right[..., 3:] -= prior[:, None] * now
    left[..., range(3), range(3)] += 1e-12
    P = np.linalg.inv(left)
    p = (P @ right[..., None])[..., 0]
    square = (w @ (d * d))[:, None] + prior * (now @ now) - (p * right).sum(axis=-1)
    likelihood = 0.5 * (np.log(w).sum(axis=1)[:, None] + 2.0 * np.log(prior) - np.linalg.slogdet(left)[1] - square)
    likelihood = likelihood.reshape(len(ROUGH), len(RELIEF), len(OVALS)) + OVALS_PRIOR
    likelihood += ROUGH_PRIOR[:, None, None] + RELIEF_PRIOR[:, None]
    chance = np.exp(likelihood - likelihood.max())
    chance = (chance / chance.sum()).reshape(-1, len(OVALS))
    mean = (chance[..., None] * p).sum(axis=(0, 1))
    if chance[:, 0].sum() > ROUND:
        mean = (chance[:, 0, None] * p[:, 0]).sum(axis=0) / chance[:, 0].sum()
    off = p - mean
    spread = (chance[..., None, None] * (P + off[..., :, None] * off[..., None, :])).sum(axis=(0, 1))
    spread[2, 2] += MODEL_PX**2
    return Ellipse(*(np.array(e) + mean / unit)), spread / np.outer(unit, unit)
