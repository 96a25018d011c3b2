"""Where disks may be: a randomised Hough transform of edges and their directions (Xu, Oja, Kultanen 1990)."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.grey import F32

CV: Any = cv2
SIDE = 1100
"""Larger images are reduced to this for the search."""
LEVELS = (0.3, 0.06)
"""Edges are those above these shares of the steepest one, and above the noise: bright disks first, then dim ones."""
NOISE_FACTOR = 5.0
"""Edges are steeper than this times the noise of a gradient: chance makes no chain of them."""
MIN_CHAIN = 9
MAX_CHAINS = 32
PAIRS = 100
KEPT = 2
MOST = 24
SAMPLE = 1500
PARALLEL = 0.15
"""Sine of the angle between the chord of a pair and the difference of its normals, at most."""
AGREE = 0.92
"""Least cosine between an edge's direction and the centre's."""


class Proposal(NamedTuple):
    """A circle that edges agree on."""

    x: float
    y: float
    radius: float
    votes: int
    """Edge pixels that agree."""


class Edges(NamedTuple):
    """Edge pixels: places (n, 2) [px], unit vectors (n, 2) to the brighter side, number of the chain (n,)."""

    place: F64
    inward: F64
    chain: NDArray[np.int64]


def propose(values: F32, noise: float, min_radius: float, max_radius: float) -> list[Proposal]:
    """Circles that many edges agree on, those with most votes first.

    Args:
        values: (rows, columns) grey.
        noise: its standard deviation.
        min_radius, max_radius: limits [px].
    """
    scale = max(1.0, max(values.shape) / SIDE)
    if scale > 1.0:
        size = (round(values.shape[1] / scale), round(values.shape[0] / scale))
        values = CV.resize(values, size, interpolation=cv2.INTER_AREA)
        noise /= scale
    # Single bright pixels and thin tracks are no edges; then smoothing, so that directions are good to some degrees
    smooth = CV.GaussianBlur(CV.medianBlur(values, 3), (0, 0), 1.2)
    dx, dy = CV.Sobel(smooth, -1, 1, 0, scale=0.125), CV.Sobel(smooth, -1, 0, 1, scale=0.125)
    steep = CV.magnitude(dx, dy)
    top = float(CV.minMaxLoc(steep)[1])
    least = NOISE_FACTOR * 0.15 * noise
    levels = sorted({max(share * top, least) for share in LEVELS}, reverse=True)
    found: list[Proposal] = []
    if levels[-1] <= top:
        thin = _thin(dx, dy, levels[-1])
        for high in levels:
            edges = None if high > top else _edges(dx, dy, steep, thin, high)
            if edges is not None:
                found += _circles(edges, min_radius / scale, max_radius / scale)
    kept = _distinct(sorted(found, key=rank), MOST)
    shift = 0.5 * (scale - 1.0)
    return [Proposal(p.x * scale + shift, p.y * scale + shift, p.radius * scale, p.votes) for p in kept]


def _thin(dx: F32, dy: F32, high: float) -> NDArray[np.int32]:
    """Columns and rows (n, 2) of Canny's edges, with half of the threshold for those that follow on."""
    gain = 16000.0 / max(CV.norm(dx, cv2.NORM_INF), CV.norm(dy, cv2.NORM_INF))
    whole = [CV.multiply(d, gain, dtype=cv2.CV_16S) for d in (dx, dy)]
    thin = CV.Canny(whole[0], whole[1], 0.5 * high * gain, high * gain, L2gradient=True)
    thin[:2] = thin[-2:] = 0  # what is cut off by the frame is no limb
    thin[:, :2] = thin[:, -2:] = 0
    found = CV.findNonZero(thin)
    return np.empty((0, 2), np.int32) if found is None else found.reshape(-1, 2)


def _edges(dx: F32, dy: F32, steep: F32, thin: NDArray[np.int32], high: float) -> Edges | None:
    """The longest chains of thin edges that are steeper than half of a threshold, and somewhere than all of it."""
    slope = steep[thin[:, 1], thin[:, 0]]
    column, row = thin[slope >= 0.5 * high].T
    if not len(column):
        return None
    mask = np.zeros(steep.shape, np.uint8)
    mask[row, column] = 1
    count, labels = CV.connectedComponents(mask, connectivity=8, ltype=cv2.CV_32S)
    label = labels[row, column]
    strong = np.bincount(label, slope[slope >= 0.5 * high] >= high, minlength=count) > 0
    column, row, label = column[strong[label]], row[strong[label]], label[strong[label]]
    sizes = np.bincount(label, minlength=count)
    longest = np.argsort(-sizes, kind="stable")[:MAX_CHAINS]
    longest = longest[sizes[longest] >= MIN_CHAIN]
    if not len(longest):
        return None
    renumber = np.full(count, -1, np.int64)
    renumber[longest] = np.arange(len(longest))
    chain = renumber[label]
    row, column, chain = row[chain >= 0], column[chain >= 0], chain[chain >= 0]
    normal = np.column_stack([dx[row, column], dy[row, column]]).astype(float)
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    order = np.argsort(chain, kind="stable")
    return Edges(np.column_stack([column, row]).astype(float)[order], normal[order], chain[order])


def _circles(edges: Edges, least: float, most: float) -> list[Proposal]:
    """Best circles of each chain and of all together."""
    rng = np.random.default_rng(1)
    n = len(edges.chain)
    ends = np.cumsum(np.bincount(edges.chain)).tolist()
    everything = rng.permutation(n)[:SAMPLE]
    sets = [(np.arange(a, b), PAIRS) for a, b in itertools.pairwise([0, *ends])]
    if len(sets) > 1:
        sets.append((everything, 8 * PAIRS))
    best: list[Proposal] = []
    for members, pairs in sets:
        part = members if len(members) <= 96 else members[rng.integers(0, len(members), 96)]
        made = _from_pairs(edges, members[rng.integers(0, len(members), (pairs, 2))], least, most)
        votes = _agree(edges, part, made, 0.03).sum(axis=1)
        order = np.argsort(-votes, kind="stable")[:40]
        best += _distinct([_proposal(made[k], int(votes[k])) for k in order], KEPT)
    made = np.array([p[:3] for p in best]).reshape(-1, 3)
    refined, votes = _refined(edges, everything, made, least, most)
    return [_proposal(c, round(int(v) * n / len(everything))) for c, v in zip(refined, votes, strict=True)]


def _proposal(circle: F64, votes: int) -> Proposal:
    return Proposal(float(circle[0]), float(circle[1]), float(circle[2]), votes)


def _from_pairs(edges: Edges, pairs: NDArray[np.int64], least: float, most: float) -> F64:
    """Circles (k, 3) from pairs of edge pixels: c = p + R n for both, so R = |p1 - p2| / |n2 - n1|."""
    i, j = pairs.T
    chord, turn = edges.place[i] - edges.place[j], edges.inward[j] - edges.inward[i]
    length, bend = np.hypot(chord[:, 0], chord[:, 1]), np.hypot(turn[:, 0], turn[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = (chord * turn).sum(axis=1) / bend**2
        cosine = (chord * turn).sum(axis=1) / (length * bend)
    good = (bend > 0.15) & (length > 3.0) & (cosine > np.sqrt(1.0 - PARALLEL**2)) & (radius > least) & (radius < most)
    i, j, radius = i[good], j[good], radius[good]
    center = 0.5 * (edges.place[i] + edges.place[j] + radius[:, None] * (edges.inward[i] + edges.inward[j]))
    return np.column_stack([center, radius])


def _agree(edges: Edges, members: NDArray[np.int64], circles: F64, slack: float) -> NDArray[np.bool_]:
    """(k, n) whether a pixel lies on a circle and its bright side is the inside."""
    (x, y), (nx, ny) = edges.place[members].T, edges.inward[members].T
    dx, dy = circles[:, :1] - x, circles[:, 1:2] - y
    distance = np.sqrt(dx * dx + dy * dy)
    near = np.abs(distance - circles[:, 2:]) < np.maximum(1.5, slack * circles[:, 2:])
    return near & (dx * nx + dy * ny > AGREE * distance)


def _refined(
    edges: Edges, members: NDArray[np.int64], circles: F64, least: float, most: float
) -> tuple[F64, NDArray[np.int64]]:
    """Circles (k, 3) by least squares on the pixels that agree (Kasa 1976), and their votes; some are dropped."""
    middle, size = edges.place[members].mean(axis=0), 1000.0
    x, y = (edges.place[members] - middle).T / size
    z, votes = x * x + y * y, np.zeros(len(circles), np.int64)
    one = np.ones_like(x)
    terms = np.column_stack([x * x, x * y, x, y * y, y, one, x * z, y * z, z])
    for slack in (0.05, 0.03, 0.02):
        agree = _agree(edges, members, circles, slack)
        votes = agree.sum(axis=1)
        circles, agree, votes = circles[votes >= MIN_CHAIN], agree[votes >= MIN_CHAIN], votes[votes >= MIN_CHAIN]
        sums = agree.astype(float) @ terms
        left = sums[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) + 1e-9 * np.eye(3)
        u = np.linalg.solve(left, sums[:, 6:, None])[..., 0]
        square = u[:, 2] + 0.25 * (u[:, 0] ** 2 + u[:, 1] ** 2)
        radius = size * np.sqrt(np.maximum(square, 0.0))
        good = (radius >= least) & (radius <= most)
        circles = np.column_stack([0.5 * size * u[:, :2] + middle, radius])[good]
        votes = votes[good]
    return circles, votes


def rank(p: Proposal) -> float:
    """For sorting: votes times the share of the circle that they cover, so that a long flat arc does not come first."""
    return -p.votes * min(p.votes / (2.0 * math.pi * p.radius), 1.0)


def _distinct(proposals: list[Proposal], most: int) -> list[Proposal]:
    """The first ones that differ from all before them."""
    kept: list[Proposal] = []
    for p in proposals:
        if all(
            math.hypot(p.x - q.x, p.y - q.y) + abs(p.radius - q.radius) > max(3.0, 0.1 * min(p.radius, q.radius))
            for q in kept
        ):
            kept.append(p)
            if len(kept) == most:
                break
    return kept
