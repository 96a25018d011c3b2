"""Nearly round ellipses: distance of points to them, and their fit by weighted least squares."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from messages.base import F64

MAX_OVAL = 0.25
"""Largest logarithm of an axis to the mean radius: 1.65 is the ratio of the axes."""

PRIOR_OVAL = 0.015
"""Standard deviation of the ovals that is assumed before any point is seen."""


class Ellipse(NamedTuple):
    """An ellipse with mean radius R = sqrt(a b); a = R exp(e), b = R exp(-e), e = |(oval_x, oval_y)|.

    The long axis has the angle atan2(oval_y, oval_x) / 2 from column towards row. With zero ovals it is a circle.
    """

    x: float
    y: float
    radius: float
    oval_x: float = 0.0
    oval_y: float = 0.0

    @property
    def semi_axes(self) -> tuple[float, float]:
        """Long and short semi-axis [px]."""
        e = math.hypot(self.oval_x, self.oval_y)
        return self.radius * math.exp(e), self.radius * math.exp(-e)

    @property
    def angle(self) -> float:
        """Direction of the long axis from column towards row, in (-pi/2, pi/2] [rad]."""
        return 0.5 * math.atan2(self.oval_y, self.oval_x)

    def distance(self, x: F64, y: F64) -> tuple[F64, F64, F64]:
        """Signed distance of points (n,) from the curve, positive outside, and the outward unit normal there.

        First order in the distance (Sampson 1982): exact on the curve, good to 1e-3 px for 10 px at 6 % of ovalness.
        """
        e = math.hypot(self.oval_x, self.oval_y)
        stretch = math.sinh(e) / e if e > 1e-12 else 1.0
        xx = (math.cosh(e) - stretch * self.oval_x) / self.radius
        yy = (math.cosh(e) + stretch * self.oval_x) / self.radius
        xy = -stretch * self.oval_y / self.radius
        dx, dy = x - self.x, y - self.y
        u, v = xx * dx + xy * dy, xy * dx + yy * dy
        rho = np.maximum(np.hypot(u, v), 1e-9)
        gx, gy = (xx * u + xy * v) / rho, (xy * u + yy * v) / rho
        steep = np.maximum(np.hypot(gx, gy), 1e-12)
        return (rho - 1.0) / steep, gx / steep, gy / steep

    def at(self, theta: F64) -> tuple[F64, F64, F64]:
        """Distance from the centre to the curve at azimuths (n,), and the outward unit normal there."""
        c, s = np.cos(theta), np.sin(theta)
        e = math.hypot(self.oval_x, self.oval_y)
        stretch = math.sinh(e) / e if e > 1e-12 else 1.0
        xx, yy = math.cosh(e) - stretch * self.oval_x, math.cosh(e) + stretch * self.oval_x
        xy = -stretch * self.oval_y
        reach = self.radius / np.hypot(xx * c + xy * s, xy * c + yy * s)
        _, nx, ny = self.distance(self.x + reach * c, self.y + reach * s)
        return reach, nx, ny


def azimuths(count: int) -> F64:
    """(count,) azimuths evenly over a full turn, from zero [rad]."""
    return np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)


def rows_of(ellipse: Ellipse, x: F64, y: F64, oval: bool) -> F64:
    """Derivatives (n, 3 or 5) of the distance's negative after the parameters."""
    _, nx, ny = ellipse.distance(x, y)
    theta = np.arctan2(y - ellipse.y, x - ellipse.x)
    rows = [nx, ny, np.ones_like(x)]
    if oval:
        rows += [ellipse.radius * np.cos(2 * theta), ellipse.radius * np.sin(2 * theta)]
    return np.column_stack(rows)


def solve(rows: F64, weight: F64, target: F64) -> F64:
    """Weighted least squares by normal equations in units of the rows' sizes."""
    size = np.sqrt((rows * rows).mean(axis=0)) + 1e-30
    scaled = rows / size
    left = (scaled * weight[:, None]).T @ scaled
    left[np.diag_indices(len(size))] += 1e-12 * np.trace(left)
    return np.asarray(np.linalg.solve(left, scaled.T @ (weight * target)) / size, float)


def fit(
    start: Ellipse, x: F64, y: F64, sigma: F64, oval: bool, most: float, rounds: int = 12
) -> tuple[Ellipse, NDArray[np.bool_], float]:
    """Robust fit by iterated re-weighting (Tukey's biweight on the residual over sigma times its scale).

    Args:
        start: near the answer.
        x, y, sigma: points (n,), and their standard deviation across the curve [px].
        oval: fit an ellipse, else keep the ovals of the start.
        most: residuals beyond this [px] never count.
        rounds: iterations.

    Returns:
        The ellipse, which points agree (n,), and the scale: robust spread of residual over sigma.
    """
    e, scale = start, 1.0
    keep = np.ones(len(x), np.bool_)
    for _ in range(rounds):
        d, _, _ = e.distance(x, y)
        near = np.abs(d) < most
        if near.sum() < 8:
            return e, near, math.inf
        scale = max(1.4826 * float(np.median(np.abs(d[near] / sigma[near]))), 0.3)
        u = d / (sigma * scale * 4.0)
        keep = near & (np.abs(u) < 1.0)
        if keep.sum() < 8:
            return e, keep, math.inf
        w = (1.0 - u[keep] ** 2) / sigma[keep]
        rows = rows_of(e, x[keep], y[keep], oval)
        if oval:  # most limbs are rounder than 4 %; short arcs alone do not tell, so the prior keeps them sane
            prior = np.array([0.0, 0.0, 0.0, 1.0, 1.0]) * (scale / PRIOR_OVAL) ** 2
            rows = np.vstack([rows, np.diag(np.sqrt(prior))[3:]])
            pull = -np.sqrt(prior[3:]) * np.array([e.oval_x, e.oval_y])
            step = solve(rows, np.append(w * w, [1.0, 1.0]), np.append(d[keep], pull))
        else:
            step = solve(rows, w * w, d[keep])
        if not oval:
            step = np.append(step, [0.0, 0.0])
        e = Ellipse(*(np.array(e) + step))
        if not (e.radius > 1.0 and math.hypot(e.oval_x, e.oval_y) < MAX_OVAL and np.isfinite(e.x + e.y)):
            return start, np.zeros(len(x), np.bool_), math.inf
        if np.abs(step[:3]).max() < 1e-4:
            break
    return e, keep, scale
