"""The light near a limb as one model with few unknowns, fitted to all pixels at once.

    I = sky + brightness(azimuth) * [light by a mixture of laws of reflection, blurred](distance, azimuth)

What no model knows, albedo, the shares of the laws, the blur, the sky and the outline, is unknown and fitted together;
each small cell of the limb has its own factor and shift beside, random with variances that the pixels tell. The points
are the cells' shifts. Their common errors, those of what is unknown, are given as modes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.ellipse import Ellipse
from modules.opnav.disks.grey import F32
from modules.opnav.disks.limb import INSIDE_PX, Band, Limb, band_of
from modules.opnav.disks.photometry import (
    GRID,
    LOW,
    TURN,
    View,
    brightness,
    incidence,
    round_ovals,
    spread,
    terminator,
)
from modules.opnav.disks.profile_kernel import CURVE, SKY, clip, eliminate, gather, look_up, restore
from modules.opnav.disks.profile_points import points_of

AROUND = 96
"""Azimuths at which the light is tabled."""
NODES = 24
"""Of the brightness along the limb."""
CLIP = 5.0
SLACK = 0.2
"""Residuals beyond so many standard deviations, and this part of the light, are of no limb: stars, tracks."""
CLIPPED = 0.01
"""Share of pixels at zero above which it is taken for the detector's limit."""
SATURATED = 3.0
"""Standard deviations below the top of the image, above which pixels do not count."""
ROUNDS = 10
SETTLED = 0.05
"""Steps of the outline, in its standard deviations, at which it stays."""
FAR_PX = 4.0
FEET = 720
OVAL_STEP = 1e-6
LIGHT_PX = 0.05
"""The light is worked out anew if the outline has moved by this."""
TERMINATOR_PX, LEAST_PX = 1.5, 1.5
"""So near to the terminator pixels do not count, nor where less than this would be left of the light."""
BASE = 2
SHARES = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
SHARE_PRIOR = np.array([0.7, 0.04, 0.3, 0.5, 0.3, 0.5, 0.5])
"""What is expected of Lambert's share in a mixture with Lommel-Seeliger's (McEwen 1991), of the fourth cumulant of the
point-spread function [px^4], and, where the pixels ask for it, of more laws."""
SHARE_STEP = 0.2
OVAL_PRIOR, SKY_PRIOR, BRIGHT_PRIOR = 0.004, 0.02, 0.4
"""Standard deviations expected: of the ovals beside a sphere's, and to the height of the light that of the sky's slope
and of the brightness along the limb."""
HELD = 1e9
HELD_FROM = 4
"""From this round on the choice of pixels below saturation stays, for it would swing."""
EVIDENCE = 3.0
"""Logarithm of the odds at which more laws are taken in."""
LEAST_GAIN = 0.003
LEAST_CELLS = 12
LEAST_INWARD = 0.001
INWARD_PX = 5.0
BLUR_RANGE = 0.35, 4.0
FREE = 1e-12


class Unknown(NamedTuple):
    """Of the model."""

    sky: F64
    """(3,) even, and along column and row."""
    blur: float
    share: F64
    """(L,)"""
    bright: F64
    """(NODES,)"""
    inward: F64
    """(NODES,) how brightness changes over `INWARD_PX`, as a part of it."""
    gain: F64
    """(cells,) factor on the brightness, less one."""
    shift: F64
    """(cells,) beside the outline's [px]."""


class Normal(NamedTuple):
    """Normal equations: A (p, p), b (p,) of what is common; K (c, 3), k (c, 2), V (c, 2, p) of the cells."""

    A: F64
    b: F64
    K: F64
    k: F64
    V: F64
    shapes: F64
    bright: F64
    residual: F64
    weight: F64
    share: F64
    """(n,) variance of a pixel over that of the noise, where the detector's zero cuts it off."""


class Problem:
    """The pixels, and what of the model does not change."""

    def __init__(self, band: Band, e: Ellipse, view: View, noise: float, top: float, height: float) -> None:
        """Take a band about an ellipse; pixels of ``top`` or more do not count."""
        self.band, self.noise, self.height, self.view = band, noise, height, view
        self.dark = float((band.value <= 0.0).mean()) > CLIPPED
        self.top = top if float(band.value.max()) >= top else math.inf
        self.gain_sd, self.shift_sd, self.inward_sd = 0.01, 0.0, 0.02
        self.noises = (noise**2, 0.0)
        self.held, self.below = False, np.ones(len(band.d), np.bool_)
        self.move(e)
        self.light(e)

    def move(self, e: Ellipse) -> None:
        """Take distances and azimuths from an ellipse."""
        band = self.band
        self.e, self.unit = e, np.array([1.0, 1.0, 1.0, 1.0 / e.radius, 1.0 / e.radius])
        self.d, nx, ny = e.distance(band.x, band.y)
        dx, dy = band.x - e.x, band.y - e.y
        r = np.hypot(dx, dy)
        c, s = dx / r, dy / r
        self.way = np.column_stack([c, s])
        turn = np.arctan2(dy, dx) / TURN % 1.0
        # How the curve moves outward at its own points; short arcs need that exactly
        at = np.linspace(0.0, TURN, FEET + 1)
        reach, ox, oy = e.at(at)
        x, y = reach * np.cos(at), reach * np.sin(at)
        size = (x * ox + y * oy) / e.radius
        ovals = [
            -e._replace(**{name: getattr(e, name) + OVAL_STEP}).distance(e.x + x, e.y + y)[0] / (OVAL_STEP * e.radius)
            for name in ("oval_x", "oval_y")
        ]
        self.rows = np.column_stack([nx, ny, *(np.interp(turn * FEET, np.arange(FEET + 1), v) for v in (size, *ovals))])
        self.place, nodes = turn * AROUND, turn * NODES
        self.node = np.minimum(nodes.astype(np.int64), NODES - 1)
        self.part = nodes - self.node

    def light(self, e: Ellipse) -> None:
        """Work out the light of a sphere with that limb."""
        self.lit_for = e
        self.depth = min(INSIDE_PX + 6.0, 0.98 * e.radius)
        seen = incidence(self.view, e, AROUND)
        laws = brightness(seen, self.depth)
        ends = terminator(seen) - TERMINATOR_PX
        ends[ends < LEAST_PX] = -math.inf
        self.good = -self.d < np.minimum(ends, np.roll(ends, -1))[np.minimum(self.place.astype(np.int64), AROUND - 1)]
        self.laws = np.concatenate([laws, laws[:, :1]], axis=1)  # the turn closes
        self.change = self.laws[1:].copy()
        self.change[0] -= self.laws[0]
        used = np.unique(self.place.astype(np.int64))
        middle = self.laws[0] + SHARES[0] * self.change[0]
        like = (self.change[1:, used] * middle[used]).sum(axis=(1, 2)) / (middle[used] ** 2).sum()
        self.change[1:] -= like[:, None, None] * middle

    def start(self, blur: float) -> Unknown:
        """Values to begin with."""
        band = self.band
        beyond = band.value[band.d > 2.5]
        sky = float(np.median(beyond)) if len(beyond) else float(band.value.min())
        none = np.zeros(band.cells)
        blur = float(np.clip(blur, *BLUR_RANGE))
        bright = np.full(NODES, self.height)
        return Unknown(np.array([sky, 0.0, 0.0]), blur, SHARES[:BASE], bright, np.zeros(NODES), none, none)

    def tables(self, u: Unknown) -> F64:
        """For `look_up`: the shares change the light without making all of it brighter."""
        s = spread(u.blur, self.depth, self.e.radius)
        laws, change = np.delete(u.share, 1), self.change[: len(u.share) - 1]
        total = np.tensordot(laws, change, 1) + self.laws[0]
        tail = total @ s[3] / 24.0, total @ s[4] / 24.0
        parts = [total @ s[0] + u.share[1] * tail[0], total @ s[1] + u.share[1] * tail[1], total @ s[2]]
        parts += [change[0] @ s[0], change[0] @ s[1], *tail]
        for c in change[1:]:
            parts += [c @ s[0], c @ s[1]]
        return np.ascontiguousarray(np.stack(parts, axis=-1))

    def normal(self, u: Unknown) -> Normal:
        """Normal equations about some values."""
        cell = self.band.cell
        d = self.d - u.shift[cell]
        next_node = (self.node + 1) % NODES
        shapes = np.empty((3 + len(u.share), len(d)))
        look_up(self.tables(u), LOW, GRID, self.place, d, shapes)
        bright = (1.0 - self.part) * u.bright[self.node] + self.part * u.bright[next_node]
        bright = bright * (1.0 + u.gain[cell])
        slope = (1.0 - self.part) * u.inward[self.node] + self.part * u.inward[next_node]
        depth = np.maximum(-d, 0.0) / INWARD_PX
        inward = shapes[0] * depth * bright
        shapes[1] -= np.where(d < 0.0, shapes[0] * slope / INWARD_PX / (1.0 + slope * depth), 0.0)
        shapes *= 1.0 + slope * depth
        mean = u.sky[0] + self.way @ u.sky[1:] + bright * shapes[0]
        variance = self.noises[0] + self.noises[1] * np.maximum(bright * shapes[0], 0.0)
        residual, share = self.band.value - mean, np.ones_like(mean)
        if self.dark:
            clip(mean, variance, self.band.value, residual, share)
        weight = self.weights(shapes, bright, mean, residual, variance * share)
        p, cells = CURVE + SKY + 1 + len(u.share) + 2 * NODES, self.band.cells
        A, b = np.zeros((p, p)), np.zeros(p)
        K, k, V = np.zeros((cells, 3)), np.zeros((cells, 2)), np.zeros((cells, 2, p))
        where = self.rows, self.way, self.node, self.part
        gather(shapes, *where, bright, inward, u.blur, cell, residual, weight, A, b, K, k, V)
        return Normal(A, b, K, k, V, shapes, bright, residual, weight, share)

    def weights(self, shapes: F64, bright: F64, mean: F64, residual: F64, variance: F64) -> F64:
        """One over the variance; zero for what does not fit: stars, tracks."""
        slack = SLACK * np.abs(bright) * (np.abs(shapes[0]) + np.abs(shapes[1]))
        fits = self.good & (np.abs(residual) < CLIP * np.sqrt(variance) + slack)
        if self.top < math.inf:
            # Chosen by what is expected: to leave out bright noise would darken the rest
            if not self.held:
                self.below = mean < self.top - SATURATED * np.sqrt(variance)
            fits &= self.below
        return np.where(fits, 1.0 / variance, 0.0)

    def learn(self, u: Unknown, n: Normal, cells: bool) -> None:
        """Estimate the variances: of the pixels, and of the cells' factors and shifts by their moments less noise's."""
        K = n.K
        det = K[:, 0] * K[:, 2] - K[:, 1] ** 2
        some = (det > 1e-6 * K[:, 0] * K[:, 2]) & (K[:, 0] > 0.0)
        det = np.where(some, det, 1.0)
        gain = np.where(some, (K[:, 2] * n.k[:, 0] - K[:, 1] * n.k[:, 1]) / det, 0.0)
        shift = np.where(some, (K[:, 0] * n.k[:, 1] - K[:, 1] * n.k[:, 0]) / det, 0.0)
        if cells and some.sum() >= LEAST_CELLS:
            self.gain_sd = max(_beyond_noise((u.gain + gain)[some], (K[:, 2] / det)[some]), LEAST_GAIN)
            self.shift_sd = _beyond_noise((u.shift + shift)[some], (K[:, 0] / det)[some])
        # Noise is what is left beside the cells' own factors and shifts
        used, cell = n.weight > 0.0, self.band.cell
        left = n.residual - n.bright * (gain[cell] * n.shapes[0] - shift[cell] * n.shapes[1])
        freedom = max(1.0 - 2.0 * float(some.sum()) / max(int(used.sum()), 1), 0.2)
        light, square = np.maximum(n.bright * n.shapes[0], 0.0)[used], (left**2 / n.share)[used] / freedom
        w = n.weight[used] ** 2
        rows = np.stack([np.ones_like(light), light])
        left_side, right_side = (rows * w) @ rows.T + FREE * np.eye(2) * w.sum(), (rows * w) @ square
        even, per = np.asarray(np.linalg.solve(left_side, right_side), np.float64).tolist()
        if even <= 0.0:
            even, per = 0.0, float((w * light * square).sum() / (w * light * light).sum())
        elif per <= 0.0:
            even, per = float(np.average(square, weights=w)), 0.0
        self.noises = (max(even, 0.02 * float(square.mean()), 1e-12), per)

    def learn_inward(self, u: Unknown, P: F64) -> None:
        """Variance of the brightness' change inward, from its values and their covariance with it as it was."""
        part = 1.0 - np.diag(P)[-NODES:] * self.inward_sd**-2.0
        some = part > 0.02
        if some.sum() < 4:
            return
        values, variance = (u.inward / np.maximum(part, 0.02))[some], self.inward_sd**2 * (1.0 / part[some] - 1.0)
        found = _beyond_noise(values, variance)
        self.inward_sd = max(math.sqrt(0.5 * (found**2 + self.inward_sd**2)), LEAST_INWARD)

    def reduced(self, u: Unknown, n: Normal) -> tuple[F64, F64, F64]:
        """Normal equations without the cells' own unknowns, and the cells' right sides with what is expected."""
        k = n.k - np.stack([u.gain * self.gain_info, u.shift * self.shift_info], axis=1)
        A, b = n.A.copy(), n.b.copy()
        eliminate(n.K, k, n.V, self.gain_info, self.shift_info, A, b)
        return A, b, k

    @property
    def gain_info(self) -> float:
        """What is known of a cell's factor before any pixel is seen."""
        return self.gain_sd**-2.0

    @property
    def shift_info(self) -> float:
        """The same of its shift [1/px^2]."""
        return max(self.shift_sd, 1e-6) ** -2.0

    def solve(self, u: Unknown, n: Normal, held: bool) -> tuple[Unknown, F64, F64]:
        """One step; ``held``: blur and shares stay. Gives the new values, the step, and the covariance."""
        prior, pull = self.prior(u, held)
        A, b, k = self.reduced(u, n)
        A = A + prior
        P = np.asarray(np.linalg.inv(A), np.float64)
        step = P @ (b + pull)
        cells = np.empty_like(k)
        restore(n.K, k, n.V, self.gain_info, self.shift_info, step, cells)
        L = len(u.share)
        at = CURVE + SKY + 1
        most = min(1.0, 1.0 / max(float(np.abs(self.rows @ step[:CURVE]).max()), 1e-9))
        self.move(Ellipse(*(np.array(self.e) + most * step[:CURVE] * self.unit)))
        most_share = 0.5 if L == BASE else SHARE_STEP
        bright = u.bright + step[at + L : at + L + NODES]
        made = Unknown(
            u.sky + step[CURVE : CURVE + SKY],
            float(np.clip(u.blur * math.exp(np.clip(step[CURVE + SKY], -0.3, 0.3)), *BLUR_RANGE)),
            u.share + np.clip(step[at : at + L], -most_share, most_share),
            np.maximum(bright, 0.05 * float(np.median(bright))),
            np.clip(u.inward + step[at + L + NODES :], -0.6, 2.0),
            np.clip(u.gain + cells[:, 0], -0.9, 4.0),
            np.clip(u.shift + np.clip(cells[:, 1], -0.7, 0.7), -3.0, 3.0),
        )
        return made, step, P

    def prior(self, u: Unknown, held: bool) -> tuple[F64, F64]:
        """Information (p, p) before any pixel is seen, and its pull (p,) from the present values."""
        laws = len(u.share)
        share = CURVE + SKY + 1
        info = np.zeros((share + laws + 2 * NODES,) * 2)
        oval = np.array([self.e.oval_x, self.e.oval_y]) - round_ovals(self.view, self.e)
        at = np.concatenate(
            [np.zeros(3), oval * self.e.radius, u.sky, [0.0], u.share - SHARES[:laws], u.bright, u.inward]
        )
        d = np.arange(len(info))
        info[d, d] = FREE / self.noises[0]
        info[[3, 4], [3, 4]] = (OVAL_PRIOR * self.e.radius) ** -2.0
        info[[CURVE + 1, CURVE + 2], [CURVE + 1, CURVE + 2]] = (SKY_PRIOR * self.height) ** -2.0
        info[share - 1, share - 1] = 1.0
        info[d[share : share + laws], d[share : share + laws]] = SHARE_PRIOR[:laws] ** -2.0
        # Brightness differs from its mean, which is not known
        bright = slice(share + laws, share + laws + NODES)
        info[bright, bright] += (np.eye(NODES) - 1.0 / NODES) * (BRIGHT_PRIOR * self.height) ** -2.0
        info[d[-NODES:], d[-NODES:]] = self.inward_sd**-2.0
        pull = -info @ at
        if held:
            held_at = d[share - 1 : share + laws]
            info[held_at, held_at] += HELD
        return info, pull

    def misfit(self, u: Unknown, n: Normal) -> float:
        """Twice the negative logarithm of how likely pixels and values are; each pixel at most as bad as an outlier."""
        square = np.minimum(n.residual**2 / (self.variance(n) * n.share), CLIP**2)[self.good]
        share = (u.share - SHARES[: len(u.share)]) / SHARE_PRIOR[: len(u.share)]
        own = (u.gain**2).sum() * self.gain_info + (u.shift**2).sum() * self.shift_info
        return float(square.sum() + (share * share).sum() + own)

    def variance(self, n: Normal) -> F64:
        """Of the noise of the pixels (n,), as it was when the equations were made."""
        return self.noises[0] + self.noises[1] * np.maximum(n.bright * n.shapes[0], 0.0)

    def gains(self, u: Unknown, n: Normal) -> float:
        """Logarithm of the evidence for the laws that were added to the end of the shares, which are still zero."""
        p = len(n.b)
        prior, pull = self.prior(u, False)
        A, b, _ = self.reduced(u, n)
        b += pull
        at = CURVE + SKY + 1
        new = np.zeros(p, np.bool_)
        new[at + BASE : at + len(u.share)] = True
        A[np.ix_(~new, ~new)] += prior[np.ix_(~new, ~new)]
        rest = np.linalg.solve(A[~new][:, ~new], np.column_stack([A[~new][:, new], b[~new]]))
        S = A[new][:, new] - A[new][:, ~new] @ rest[:, :-1]
        score = b[new] - A[new][:, ~new] @ rest[:, -1]
        more = prior[np.ix_(new, new)]
        gain = float(score @ np.linalg.solve(S + more, score))
        return 0.5 * (gain - float(np.linalg.slogdet(np.eye(len(S)) + np.linalg.solve(more, S))[1]))


def _beyond_noise(values: F64, variance: F64) -> float:
    """Standard deviation (0 or more) of what is in values (n,) beside noise of some variances; outliers count less."""
    w = variance**-2.0
    typical = float(np.median(values**2 / variance)) / 0.455
    square = np.minimum(values**2, 16.0 * variance * max(typical, 1.0))
    return math.sqrt(max(float((w * (square - variance)).sum() / w.sum()), 0.0))


def measured(
    values: F32,
    noise: float,
    top: float,
    e: Ellipse,
    azimuths: NDArray[np.bool_],
    depths: F64,
    most: int,
    view: View,
    before: Limb,
) -> Limb | None:
    """Points of the limb near an ellipse, at most so many on the full turn.

    Args:
        values: (rows, columns) grey, as it came; ``noise`` its standard deviation, ``top`` where it saturates.
        e: the limb, to a pixel or so.
        azimuths: (n,) mask of the azimuths that are lit limb, over the full turn.
        depths: (n,) how far in the profile is that of a limb [px].
        most: points.
        view: camera and Sun.
        before: what is known of the limb already.

    Returns:
        The points, or None if the pixels do not determine them.
    """
    sectors = NODES
    cells = sectors * max(1, int(min(TURN * e.radius, most) / sectors))
    band = band_of(values, e, azimuths, depths, cells, sectors)
    if len(band.d) < 100:
        return None
    problem = Problem(band, e, view, noise, top, float(np.median(before.step)))
    found = fit(problem, problem.start(before.blur))
    return None if found is None else points_of(problem, *found)


def fit(problem: Problem, u: Unknown) -> tuple[Unknown, F64] | None:
    """Fit the model, from some values; more laws of reflection are tried if the pixels ask for them.

    Returns:
        The values, and the covariance of what is common; None if nothing is determined.
    """
    found = _iterate(problem, u, True)
    if found is None:
        return None
    u, _ = found
    grown = u._replace(share=np.append(u.share, SHARES[BASE:]))
    n = problem.normal(grown)
    if problem.gains(grown, n) < EVIDENCE:
        return found
    e, before = problem.e, problem.misfit(grown, n)
    more = _iterate(problem, grown, False)
    if more is not None and problem.misfit(more[0], problem.normal(more[0])) < before - 2.0 * EVIDENCE:
        return more
    # More laws are asked for, but do not settle: then at least what they could do is not known
    problem.move(e)
    problem.light(e)
    A, _, _ = problem.reduced(grown, problem.normal(grown))
    return grown, np.asarray(np.linalg.inv(A + problem.prior(grown, False)[0]), np.float64)


def _iterate(problem: Problem, u: Unknown, learn: bool) -> tuple[Unknown, F64] | None:
    """Gauss-Newton until the outline stays; None if it does not.

    With ``learn``, the variances are estimated on the way, and the last of the rounds will do.
    """
    begin = problem.d
    for k in range(ROUNDS):
        problem.held = k >= HELD_FROM or not learn
        n = problem.normal(u)
        if learn and k >= 2:
            problem.learn(u, n, k >= 3)
        u, step, P = problem.solve(u, n, learn and k == 0)
        if learn and k >= 2:
            problem.learn_inward(u, P)
        if not (np.isfinite(step).all() and float(np.abs(problem.d - begin).max()) < FAR_PX):
            return None
        if _apart(problem.e, problem.lit_for) > LIGHT_PX:
            problem.light(problem.e)
        sigma = np.sqrt(np.maximum(np.diag(P)[:CURVE], 0.0))
        settled = k >= 4 and bool((np.abs(step[:CURVE]) < SETTLED * sigma).all())
        if settled or (learn and k == ROUNDS - 1):
            return u, P
    return None


def _apart(a: Ellipse, b: Ellipse) -> float:
    """How far two ellipses are from each other [px]."""
    return max(math.hypot(a.x - b.x, a.y - b.y), abs(a.radius - b.radius))
