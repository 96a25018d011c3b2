"""Loops over the pixels near a limb, compiled: the model's values, and the normal equations of what is unknown."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from messages.base import F64

I64 = NDArray[np.int64]
CURVE, SKY = 5, 3
"""Unknowns of the curve and of the sky; then come the blur, the shares of the laws, and at
the nodes the brightness and how it changes inward."""


@compiled
def look_up(tables: F64, low: float, step: float, place: F64, d: F64, out: F64) -> None:
    """Cubic between tabled distances, linear between azimuths.

    Args:
        tables: (M + 1, D, Q), Q = 3 + 2 K: a function, its first two derivatives, then K times function and derivative.
        low: the first distance. step: between them.
        place: (n,) azimuth in steps of the table, from 0 to M.
        d: (n,) distance.
        out: (3 + K, n): function, first, second derivative, and the K functions.
    """
    more = (tables.shape[2] - 3) // 2
    most = tables.shape[1] - 2
    for i in range(d.shape[0]):
        x = (d[i] - low) / step
        j = min(max(int(x), 0), most)
        t = min(max(x - j, 0.0), 1.0)
        m = min(int(place[i]), tables.shape[0] - 2)
        w = place[i] - m
        a1 = t * t * (3.0 - 2.0 * t)
        a0 = 1.0 - a1
        b0 = step * t * (1.0 - t) * (1.0 - t)
        b1 = step * t * t * (t - 1.0)
        for q in range(3 + more):
            out[q, i] = 0.0
        for side in range(2):
            u = 1.0 - w if side == 0 else w
            left, right = tables[m + side, j], tables[m + side, j + 1]
            out[0, i] += u * (a0 * left[0] + a1 * right[0] + b0 * left[1] + b1 * right[1])
            out[1, i] += u * (a0 * left[1] + a1 * right[1] + b0 * left[2] + b1 * right[2])
            out[2, i] += u * ((1.0 - t) * left[2] + t * right[2])
            for k in range(more):
                q = 3 + 2 * k
                out[3 + k, i] += u * (a0 * left[q] + a1 * right[q] + b0 * left[q + 1] + b1 * right[q + 1])


@compiled
def gather(
    shapes: F64,
    rows: F64,
    way: F64,
    node: I64,
    part: F64,
    bright: F64,
    inward: F64,
    blur: float,
    cell: I64,
    residual: F64,
    weight: F64,
    A: F64,
    b: F64,
    K: F64,
    k: F64,
    V: F64,
) -> None:
    """Add up the normal equations.

    Args:
        shapes: (3 + L, n) from `look_up`.
        rows: (n, 5) shift of the curve by its unknowns.
        way: (n, 2) cosine and sine of the azimuth.
        node: (n,) first of the two nodes of brightness next to a pixel. part: (n,) how far on towards the second.
        bright: (n,) brightness at the pixel, that of its cell. inward: (n,) light times depth.
        blur: of the model.
        cell: (n,). residual: (n,). weight: (n,).
        A: (p, p) and b: (p,), zero before: of what is common.
        K: (c, 3), k: (c, 2), V: (c, 2, p): of each cell's factor on the brightness and shift, and with what is common.
    """
    n = residual.shape[0]
    laws = shapes.shape[0] - 3
    first = CURVE + SKY + 1 + laws
    nodes = (A.shape[0] - first) // 2
    at = np.empty(4, np.int64)
    much = np.empty(4)
    value = np.empty(first)
    for i in range(n):
        w, r = weight[i], residual[i]
        if w == 0.0:
            continue
        slope, gain = -bright[i] * shapes[1, i], bright[i] * shapes[0, i]
        for j in range(CURVE):
            value[j] = slope * rows[i, j]
        value[CURVE], value[CURVE + 1], value[CURVE + 2] = 1.0, way[i, 0], way[i, 1]
        value[CURVE + SKY] = bright[i] * blur * shapes[2, i]
        for q in range(laws):
            value[CURVE + SKY + 1 + q] = bright[i] * shapes[3 + q, i]
        at[0] = first + node[i]
        at[1] = first + (node[i] + 1) % nodes
        at[2], at[3] = at[0] + nodes, at[1] + nodes
        much[0], much[1] = (1.0 - part[i]) * shapes[0, i], part[i] * shapes[0, i]
        much[2], much[3] = (1.0 - part[i]) * inward[i], part[i] * inward[i]
        c = cell[i]
        K[c, 0] += w * gain * gain
        K[c, 1] += w * gain * slope
        K[c, 2] += w * slope * slope
        k[c, 0] += w * gain * r
        k[c, 1] += w * slope * r
        wg, ws = w * gain, w * slope
        for j in range(first):
            v = w * value[j]
            b[j] += v * r
            V[c, 0, j] += wg * value[j]
            V[c, 1, j] += ws * value[j]
            for m in range(4):
                A[at[m], j] += v * much[m]
            for q in range(j + 1):
                A[j, q] += v * value[q]
        for m in range(4):
            b[at[m]] += w * much[m] * r
            V[c, 0, at[m]] += wg * much[m]
            V[c, 1, at[m]] += ws * much[m]
            for q in range(m + 1):
                A[max(at[m], at[q]), min(at[m], at[q])] += w * much[m] * much[q]
    for j in range(A.shape[0]):
        for q in range(j):
            A[q, j] = A[j, q]


@compiled
def eliminate(K: F64, k: F64, V: F64, gain: float, shift: float, A: F64, b: F64) -> None:
    """Take the cells' own unknowns out of the normal equations of what is common.

    Args:
        K: (c, 3), k: (c, 2), V: (c, 2, p) as from `gather`, the pull of what is expected in k already.
        gain: information on each cell's factor before any pixel is seen. shift: the same of its shift.
        A: (p, p) and b: (p,), in and out.
    """
    p = A.shape[0]
    for c in range(K.shape[0]):
        e00, e11, e01 = K[c, 0] + gain, K[c, 2] + shift, K[c, 1]
        det = e00 * e11 - e01 * e01
        i00, i11, i01 = e11 / det, e00 / det, -e01 / det
        if K[c, 0] == 0.0:
            continue
        for j in range(p):
            v0, v1 = V[c, 0, j], V[c, 1, j]
            if v0 == 0.0 and v1 == 0.0:
                continue
            u0, u1 = i00 * v0 + i01 * v1, i01 * v0 + i11 * v1
            b[j] -= u0 * k[c, 0] + u1 * k[c, 1]
            for q in range(j + 1):
                A[j, q] -= u0 * V[c, 0, q] + u1 * V[c, 1, q]
    for j in range(p):
        for q in range(j):
            A[q, j] = A[j, q]


@compiled
def restore(K: F64, k: F64, V: F64, gain: float, shift: float, step: F64, out: F64) -> None:
    """Steps (c, 2) of the cells' own unknowns from that of what is common (p,); see `eliminate`."""
    for c in range(K.shape[0]):
        r0, r1 = k[c, 0], k[c, 1]
        for j in range(step.shape[0]):
            r0 -= V[c, 0, j] * step[j]
            r1 -= V[c, 1, j] * step[j]
        e00, e11, e01 = K[c, 0] + gain, K[c, 2] + shift, K[c, 1]
        det = e00 * e11 - e01 * e01
        out[c, 0] = (e11 * r0 - e01 * r1) / det
        out[c, 1] = (e00 * r1 - e01 * r0) / det


@compiled
def clip(mean: F64, variance: F64, value: F64, residual: F64, share: F64) -> None:
    """A detector gives no less than zero: what Gaussian noise then does to the mean and to its variance.

    Args:
        mean: (n,) expected without that limit. variance: (n,) of the noise.
        value: (n,) as measured.
        residual: out, (n,): difference to what is expected, over the part of a change of the mean that is seen.
        share: out, (n,): variance of that over ``variance``.
    """
    for i in range(mean.shape[0]):
        s = math.sqrt(variance[i])
        x = mean[i] / s
        above = 0.5 * math.erfc(-x / math.sqrt(2.0))
        density = math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
        first = x * above + density
        second = (1.0 + x * x) * above + x * density
        above = max(above, 0.1)
        residual[i] = (value[i] - s * first) / above
        share[i] = max(second - first * first, 0.01) / (above * above)
