"""Outlines through points whose errors are known: relief, ovals, short arcs, horns."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from modules.opnav.disks.coarse import mostly
from modules.opnav.disks.ellipse import Ellipse
from modules.opnav.disks.limb import Limb
from modules.opnav.disks.normal import normal
from modules.opnav.disks.outline import Outline, outline

F64 = NDArray[np.float64]


def limb_of(e: Ellipse, arc: float, relief: float, noise: float, rng: np.random.Generator) -> Limb:
    """Points of an ellipse with relief (root mean square to the radius) of 40 harmonics, one a pixel."""
    theta = np.arange(0.0, arc, 1.0 / e.radius) - 0.5 * arc + rng.uniform(0.0, 2.0 * math.pi)
    k = np.arange(3, 43)
    size = k**-1.1 * rng.normal(size=40)
    wave = (size[:, None] * np.cos(k[:, None] * theta + rng.uniform(0, 2 * math.pi, (40, 1)))).sum(axis=0)
    reach, _, _ = e.at(theta)
    reach = reach * (1.0 + relief * wave / math.sqrt(0.5 * (k**-2.2).sum())) + rng.normal(0.0, noise, len(theta))
    sector = (theta % (2 * math.pi) / (2 * math.pi) * 24).astype(np.int64)
    n = len(theta)
    x, y = e.x + reach * np.cos(theta), e.y + reach * np.sin(theta)
    return Limb(x, y, np.full(n, noise), sector, np.zeros(24), np.full(n, 100.0), 0.8)


def fitted(e: Ellipse, arc: float, relief: float, rng: np.random.Generator) -> tuple[F64, Outline]:
    made = outline(Ellipse(e.x + 0.5, e.y - 0.4, e.radius), limb_of(e, arc, relief, 0.1, rng))
    assert made is not None
    return np.array(made.ellipse[:3]) - np.array(e[:3]), made


@pytest.mark.parametrize("arc", [1.2, 2.6, 6.28])
def test_covariance_on_relief(arc: float) -> None:
    """Circles: the normalised square error is at most that of three degrees of freedom, on 70 degrees with a tail."""
    rng = np.random.default_rng(1)
    nees = []
    for n in range(40):
        e = Ellipse(200.3, 180.7, 60.0 + 5.0 * n)
        error, made = fitted(e, arc, (0.0, 1e-3, 3e-3)[n % 3], rng)
        nees.append(error @ np.linalg.solve(made.P[:3, :3], error))
    assert np.median(nees) < 2.37  # the median of chi square
    assert np.percentile(nees, 85) < 7.81  # and its 95th percentile


def test_ovals_on_half_a_turn() -> None:
    """Flattened by 1 to 5 %: they are followed, or sigma says that they are not seen."""
    rng = np.random.default_rng(2)
    nees, found = [], 0
    for n in range(40):
        oval, turn = 0.005 + 0.0005 * n, rng.uniform(0, 2 * math.pi)
        e = Ellipse(0.0, 0.0, 150.0, oval * math.cos(turn), oval * math.sin(turn))
        error, made = fitted(e, 2.8, 5e-4, rng)
        nees.append(error @ np.linalg.solve(made.P[:3, :3], error))
        found += made.oval
    assert np.median(nees) < 4.0
    assert np.percentile(nees, 90) < 14.2
    assert found > 10


def test_smooth_circle_is_one() -> None:
    """Without relief the answer is as good as the noise allows: 0.1 px on 942 points."""
    error, made = fitted(Ellipse(0.0, 0.0, 150.0), 6.28, 0.0, np.random.default_rng(3))
    assert np.abs(error).max() < 0.02
    assert not made.oval
    assert np.sqrt(np.diag(made.P)[:3]).max() < 0.1


def test_what_is_mostly_so() -> None:
    """Single members are left out, also across the start of the turn."""
    which = np.zeros(200, np.bool_)
    which[[*range(180, 200), *range(30), 90, 120]] = True
    assert np.flatnonzero(mostly(which, np.ones(200, np.bool_))).tolist() == [
        *range(28),
        *range(182, 200),
    ]


def test_normal_equations() -> None:
    """Against numpy's products, group by group."""
    rng = np.random.default_rng(4)
    group, columns = rng.integers(0, 5, 300), rng.normal(size=(4, 300))
    target, weight = rng.normal(size=300), rng.uniform(size=300)
    a, b = normal(group, 5, columns, target, weight)
    for g in range(5):
        rows = columns[:, group == g]
        assert np.allclose(a[g], (rows * weight[group == g]) @ rows.T, rtol=1e-12)
        assert np.allclose(b[g], rows @ (weight * target)[group == g], rtol=1e-12)
