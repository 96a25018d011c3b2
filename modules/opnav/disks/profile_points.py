"""Points of a limb from the fit of its light: each cell's shift, and as modes the errors that are common to all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.limb import Limb
from modules.opnav.disks.photometry import TURN
from modules.opnav.disks.profile_kernel import CURVE

if TYPE_CHECKING:
    from modules.opnav.disks.profile import Problem, Unknown

MODES = 8
"""Common causes that are kept; what others do goes to the points' own deviations."""


def points_of(problem: Problem, u: Unknown, P: F64) -> Limb:
    """The cells' shifts as points, and what they have in common as modes; P is the covariance of that."""
    n = problem.normal(u)
    band, e = problem.band, problem.e
    K = n.K
    a = K[:, 0] + problem.gain_sd**-2.0
    information = np.maximum(K[:, 2] - K[:, 1] ** 2 / a, 1e-12)
    push = n.k[:, 1] - K[:, 1] / a * (n.k[:, 0] - u.gain / problem.gain_sd**2)
    shift = u.shift + push / information
    pixels = np.bincount(band.cell, n.weight > 0.0, band.cells)
    theta = (np.arange(band.cells, dtype=np.float64) + 0.5) * (TURN / band.cells)
    reach, nx, ny = e.at(theta)
    x, y = e.x + reach * np.cos(theta), e.y + reach * np.sin(theta)
    sigma = information**-0.5
    cross = (n.V[:, 1] - (K[:, 1] / a)[:, None] * n.V[:, 0])[:, CURVE:] / information[:, None]
    size = np.maximum(np.bincount(band.cell, np.abs(n.bright * n.shapes[1]), band.cells), 0.0)
    step = size / np.maximum(np.bincount(band.cell, None, band.cells), 1) * 4.0
    good = (pixels >= 5) & (sigma < 2.0) & (np.abs(shift) < 3.0 + 4.0 * sigma)
    modes = cross @ np.linalg.cholesky(P[CURVE:, CURVE:])
    own = np.hypot(sigma, problem.shift_sd)
    inflation = _correlated(shift[good] / own[good], np.flatnonzero(good))
    found = Limb(
        x + nx * shift,
        y + ny * shift,
        own * inflation,
        np.arange(band.cells) * band.sectors // band.cells,
        np.zeros(band.sectors),
        step,
        u.blur,
        modes * inflation,
    ).pick(good)
    return _fewer(found)


def _correlated(e: F64, cell: NDArray[np.int64]) -> float:
    """Factor on standard deviations for neighbours that err together, from normalised residuals (n,)."""
    n = len(e)
    if n < 30:
        return 1.0
    e = np.clip(e, -4.0, 4.0)
    square = max(float(e @ e) / max(n - CURVE, 1), 1.0)
    total = 1.0
    for lag in range(1, n // 10):
        near = (cell[lag:] - cell[:-lag]) == lag
        if near.sum() < 20:
            break
        r = float((e[lag:] * e[:-lag])[near].mean()) / float((e @ e) / n)
        if r < 2.0 / math.sqrt(float(near.sum())):
            break
        total += 2.0 * r
    return math.sqrt(square * total)


def _fewer(limb: Limb) -> Limb:
    """The strongest of the modes; what the others do goes to the points' own deviations."""
    u, s, _ = np.linalg.svd(limb.modes / limb.sigma[:, None], full_matrices=False)
    modes = u[:, :MODES] * s[:MODES] * limb.sigma[:, None]
    rest = np.maximum((limb.modes**2).sum(axis=1) - (modes**2).sum(axis=1), 0.0)
    total = (modes**2).sum(axis=1)
    count = np.maximum(np.bincount(limb.sector, None, len(limb.common)), 1)
    common = np.sqrt(np.bincount(limb.sector, total, len(limb.common)) / count)
    return limb._replace(modes=modes, sigma=np.sqrt(limb.sigma**2 + rest), common=common)
