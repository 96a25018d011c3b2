"""Circle or ellipse through the points of a limb, with a covariance that is as large as their scatter says."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.ellipse import PRIOR_OVAL, Ellipse, fit, rows_of
from modules.opnav.disks.limb import Limb

MODEL_PX = 0.04
"""Standard deviation that the model of the profile adds to each sector, and to all points together [px]: its errors on
rendered disks of four laws of reflection, with blurs of 0.5 to 1.2 px."""
LEAST_SIGMA = 0.02
"""No point is better than this [px]."""
FAR_PX = 4.0
WALD = 40.0
WALD_SMOOTH = 22.0
"""An ellipse is taken if the square of its ovals is this many times their variance (6 sigma, or 4.7 on a smooth limb):
relief bends a circle too. Below, the doubt goes to the covariance."""

LONG_ARC = math.radians(140.0)
SMOOTH = 3.0
"""On a shorter arc, relief looks like ovals; so there only a limb that scatters little more than its noise has them."""


class Outline(NamedTuple):
    """The fitted curve, its covariance, the points that agree (n,), and their scatter to what was expected of them."""

    ellipse: Ellipse
    oval: bool
    P: F64
    keep: NDArray[np.bool_]
    scale: float


def outline(start: Ellipse, limb: Limb) -> Outline | None:
    """Fit a circle, and an ellipse if the points ask for it.

    Args:
        start: near the answer.
        limb: points.

    Returns:
        The curve, or None if there is none.
    """
    sigma = np.hypot(limb.sigma, LEAST_SIGMA)
    circle, keep, scale = fit(start._replace(oval_x=0.0, oval_y=0.0), limb.x, limb.y, sigma, False, FAR_PX)
    oval, keep_oval, scale_oval = fit(start, limb.x, limb.y, sigma, True, FAR_PX)
    if not math.isfinite(scale):
        return None
    wald = 0.0
    if math.isfinite(scale_oval):
        P_oval = covariance(oval, limb, keep_oval, sigma, scale_oval, True)
        ovals = np.array([oval.oval_x, oval.oval_y])
        wald = float(ovals @ np.linalg.solve(P_oval[3:, 3:], ovals))
        theta = np.sort(np.arctan2(limb.y - start.y, limb.x - start.x))
        arc = 2.0 * math.pi - max(float(np.diff(theta).max()), 2.0 * math.pi - float(theta[-1] - theta[0]))
        d = oval.distance(limb.x[keep_oval], limb.y[keep_oval])[0] / sigma[keep_oval]
        smooth = max(scale_oval, 1.0) ** 2 * correlation(d) < SMOOTH
        if wald > (WALD_SMOOTH if smooth else WALD) and (smooth or arc > LONG_ARC):
            return Outline(oval, True, P_oval, keep_oval, max(scale_oval, 1.0))
    P = covariance(circle, limb, keep, sigma, scale, False)
    if wald > 6.0:  # perhaps it is none: then it is as far off as the ellipse says
        off = np.array(oval[:3]) - np.array(circle[:3])
        P = P + np.outer(off, off) * min(wald / WALD, 1.0) ** 2
    return Outline(circle, False, P, keep, max(scale, 1.0))


def covariance(e: Ellipse, limb: Limb, keep: NDArray[np.bool_], sigma: F64, scale: float, oval: bool) -> F64:
    """Covariance (3, 3 or 5, 5) of the parameters.

    From the points' scatter, times how far it hangs together along the limb (Bartlett 1946), plus what the points of a
    sector share, plus what the model of the profile is worth.
    """
    rows = rows_of(e, limb.x[keep], limb.y[keep], oval)
    weighted = rows / sigma[keep, None] ** 2
    information = weighted.T @ rows
    if oval:
        information[[3, 4], [3, 4]] += PRIOR_OVAL**-2
    left: F64 = np.asarray(np.linalg.inv(information + 1e-12 * np.trace(information) * np.eye(len(information))), float)
    P = left * max(scale, 1.0) ** 2 * correlation(e.distance(limb.x[keep], limb.y[keep])[0] / sigma[keep])
    for s in np.unique(limb.sector[keep]):
        pull = left @ weighted[limb.sector[keep] == s].sum(axis=0)
        P = P + np.outer(pull, pull) * (limb.common[s] ** 2 + MODEL_PX**2)
    P[2, 2] += MODEL_PX**2
    return P


def correlation(residual: F64) -> float:
    """By how much neighbouring residuals (n,), in order along the limb, agree: the factor on a mean's variance."""
    n = len(residual)
    r = residual - residual.mean()
    power, total = float(r @ r), 1.0
    for lag in range(1, n // 4):
        rho = float(r[:-lag] @ r[lag:]) / max(power, 1e-30)
        if rho < 2.0 / math.sqrt(n):
            break
        total += 2.0 * rho
    return total
