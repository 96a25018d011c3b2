"""Maximum likelihood fit of the limb of an ellipsoid: each point's distance from it in the image, over its sigma.

In coordinates in which the body is a unit sphere (Christian and Robinson 2016, JGCD 39(12)) a limb point with
direction h, |h| = 1, fulfils h . n = 1, with n = -q / sqrt(|q|^2 - 1) and q the camera's position. The fit is in n.
Noise lies across the limb, so what is minimised is the distance e from the point to its foot on the limb; slopes are
taken at the foot. Slopes at the noisy point would be correlated with the noise, which biases short arcs.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.camera import distort_slopes, undistort_point
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, axpy, cross, dot, inverse, matmul, norm, scale, unit
from fsw.module import Row
from messages.base import F64, I64
from modules.opnav.relative import (
    BAD_NUMBERS,
    NO_SOLUTION,
    OUTLIERS,
    OUTSIDE_LENS,
    VALID,
    invert_spd,
    sandwich,
    solve_spd,
)

RAY = 7
"""Numbers of a point: tangents x, y; dx/du, dx/dv, dy/du, dy/dv [1/px]; sigma [px]."""
MIN_POINTS = 4
"""Three points fix a position, but not whether it is right."""
LEVERAGE = 0.9
"""Leverage above which a point decides the fit alone; the ends of five even points of an arc have 0.89."""
MOST_NOISE = 10.0
"""Noise more than so many times what is stated is no noise."""
FAR = 1e6
"""Distance [px] of a point for which the limb has no slope."""


@compiled
def rays_of(lens: F64, limb_px: F64, sigma_px: F64, count: int, factor: float, rays: F64) -> int:
    """Undistort points.

    Args:
        lens: lens vector (11,).
        limb_px: points (n, 2), n >= count [px].
        sigma_px: standard deviation across the limb (n,) [px].
        count: how many of them.
        factor: on the standard deviations.
        rays: out, (n, RAY).

    Returns:
        A status of `modules.opnav.relative`.
    """
    for i in range(count):
        u, v, s = limb_px[i, 0], limb_px[i, 1], factor * sigma_px[i]
        if not (math.isfinite(u) and math.isfinite(v) and math.isfinite(s) and s > 0.0):
            return BAD_NUMBERS
        x, y = undistort_point(lens, u, v)
        if math.isnan(x):
            return OUTSIDE_LENS
        xx, xy, yx, yy = distort_slopes(lens, x, y)
        ux, uy = lens[0] * xx + lens[4] * yx, lens[0] * xy + lens[4] * yy
        vx, vy = lens[1] * yx, lens[1] * yy
        det = ux * vy - uy * vx
        rays[i, 0], rays[i, 1] = x, y
        rays[i, 2], rays[i, 3], rays[i, 4], rays[i, 5] = vy / det, -uy / det, -vx / det, ux / det
        rays[i, 6] = s
    return VALID


@compiled
def local_frame(B: M3, rays: F64, count: int) -> M3:
    """B turned so that the mean direction of the points is the third axis: keeps narrow fields well conditioned."""
    x, y = 0.0, 0.0
    for i in range(count):
        x, y = x + rays[i, 0], y + rays[i, 1]
    e3 = unit(direction(B, x / count, y / count))
    e1 = unit(cross((0.0, 1.0, 0.0) if math.fabs(e3[1]) < 0.9 else (1.0, 0.0, 0.0), e3))
    return matmul((e1, cross(e3, e1), e3), B)


@compiled
def direction(B: M3, x: float, y: float) -> V3:
    """B (x, y, 1)."""
    return (
        B[0][0] * x + B[0][1] * y + B[0][2],
        B[1][0] * x + B[1][1] * y + B[1][2],
        B[2][0] * x + B[2][1] * y + B[2][2],
    )


@compiled
def edge(B: M3, n: V3, x: float, y: float, ray: F64) -> tuple[float, float, float, V3]:
    """The limb seen from a point near it.

    Args:
        B: maps tangents (x, y, 1) to coordinates in which the body is a unit sphere.
        n: the unknowns.
        x: tangent x.
        y: tangent y.
        ray: numbers of the point (RAY,), for the slopes of the lens.

    Returns:
        f = h . n - 1, its slopes by column and row [1/px], and h.
    """
    s = direction(B, x, y)
    k = 1.0 / norm(s)
    h = scale(k, s)
    c = dot(h, n)
    t = axpy(-c, h, n)
    fx = k * (t[0] * B[0][0] + t[1] * B[1][0] + t[2] * B[2][0])
    fy = k * (t[0] * B[0][1] + t[1] * B[1][1] + t[2] * B[2][1])
    return c - 1.0, fx * ray[2] + fy * ray[4], fx * ray[3] + fy * ray[5], h


@compiled
def distance(B: M3, n: V3, ray: F64) -> float:
    """Signed distance [px] of a point from the limb, to first order; positive towards the body's centre."""
    f, fu, fv, _ = edge(B, n, ray[0], ray[1], ray)
    slope = math.sqrt(fu * fu + fv * fv)
    return f / slope if slope * FAR > math.fabs(f) else math.copysign(FAR, f)


@compiled
def at_foot(B: M3, n: V3, ray: F64) -> tuple[float, V3]:
    """Signed distance [px] of a point from its foot on the limb, and its derivative by n."""
    f, fu, fv, h = edge(B, n, ray[0], ray[1], ray)
    g2 = fu * fu + fv * fv
    if not g2 * FAR * FAR > f * f:
        return math.copysign(FAR, f), (0.0, 0.0, 0.0)
    du, dv = -f * fu / g2, -f * fv / g2
    e = f / math.sqrt(g2)
    f, fu, fv, h = edge(B, n, ray[0] + ray[2] * du + ray[3] * dv, ray[1] + ray[4] * du + ray[5] * dv, ray)
    k = 1.0 / math.sqrt(fu * fu + fv * fv)
    return e + k * f, scale(k, h)


@compiled
def start(B: M3, rays: F64, used: I64, A: F64, b: F64, x: F64) -> tuple[bool, V3]:
    """Least squares of h . n = 1, in which far points of a short arc count too much: a place to start from."""
    _clear(A, b)
    for i in range(used.shape[0]):
        if used[i] != 0:
            h = unit(direction(B, rays[i, 0], rays[i, 1]))
            w = 1.0 / (rays[i, 6] * rays[i, 6])
            _gather(A, b, h, h[2] - 1.0, w)
    _mirror(A)
    if not solve_spd(A, b, x):
        return False, (math.nan, math.nan, math.nan)
    return True, (-x[0], -x[1], 1.0 - x[2])


@compiled
def _clear(A: F64, b: F64) -> None:
    for i in range(3):
        b[i] = 0.0
        for j in range(3):
            A[i, j] = 0.0


@compiled
def _gather(A: F64, b: F64, row: V3, e: float, w: float) -> None:
    """Add one equation, row . dn = -e of weight w, to the lower triangle of the normal equations."""
    for i in range(3):
        k = w * row[i]
        b[i] += k * e
        for j in range(i + 1):
            A[i, j] += k * row[j]


@compiled
def _mirror(A: F64) -> None:
    """Fill the upper triangle."""
    A[0, 1], A[0, 2], A[1, 2] = A[1, 0], A[2, 0], A[2, 1]


@compiled
def refine(B: M3, n: V3, rays: F64, used: I64, limit: float, A: F64, b: F64, x: F64) -> tuple[int, V3, float, float]:
    """Gauss-Newton on the points with ``used`` not 0.

    Args:
        B: maps tangents to coordinates in which the body is a unit sphere.
        n: where to start.
        rays: points (m, RAY).
        used: (m,).
        limit: give up if a distance is more than so many sigma.
        A: out, (3, 3), information matrix of n.
        b: work (3,).
        x: work (3,).

    Returns:
        Status, n, the sum of squares of the distances over their sigma, and the largest of them.
    """
    chi2, worst = math.nan, math.nan
    for _ in range(30):
        _clear(A, b)
        chi2, worst = 0.0, 0.0
        for i in range(used.shape[0]):
            if used[i] != 0:
                e, row = at_foot(B, n, rays[i])
                k = 1.0 / rays[i, 6]
                worst = max(worst, k * math.fabs(e))
                chi2 += k * k * e * e
                _gather(A, b, row, e, k * k)
        _mirror(A)
        if worst > limit or not solve_spd(A, b, x):
            return NO_SOLUTION, n, chi2, worst
        n = (n[0] - x[0], n[1] - x[1], n[2] - x[2])
        if not dot(n, n) > 1.0:
            return NO_SOLUTION, n, chi2, worst
        if b[0] * x[0] + b[1] * x[1] + b[2] * x[2] < 1e-6:  # a thousandth of sigma; what remains is far smaller
            return VALID, n, chi2, worst
    return NO_SOLUTION, n, chi2, worst


@compiled
def consensus(B: M3, rays: F64, tries: int, gate: float) -> tuple[bool, V3]:
    """The limb through three points with which most of the others agree (MSAC, Torr and Zisserman 2000).

    Always the same draws, so same input, same output. At most 100 points are looked at in each try.
    """
    count = rays.shape[0]
    stride = 1 + (count - 1) // 100
    best, found, answer = math.inf, False, (math.nan, math.nan, math.nan)
    word = 12345
    for _ in range(tries):
        word = (word * 1103515245 + 12345) % 2147483648
        i = (word >> 8) % count
        word = (word * 1103515245 + 12345) % 2147483648
        j = (word >> 8) % count
        word = (word * 1103515245 + 12345) % 2147483648
        k = (word >> 8) % count
        p = unit(direction(B, rays[i, 0], rays[i, 1]))
        q = unit(direction(B, rays[j, 0], rays[j, 1]))
        r = unit(direction(B, rays[k, 0], rays[k, 1]))
        # plane through three points of the unit sphere
        a = cross((q[0] - p[0], q[1] - p[1], q[2] - p[2]), (r[0] - p[0], r[1] - p[1], r[2] - p[2]))
        d = dot(a, p)
        if not math.fabs(d) > 0.0:
            continue
        n = scale(1.0 / d, a)
        if not (dot(n, n) > 1.0 and math.isfinite(dot(n, n))):
            continue
        cost = 0.0
        for m in range(0, count, stride):
            e = distance(B, n, rays[m]) / rays[m, 6]
            cost += min(e * e, gate * gate)
            if cost >= best:
                break
        if cost < best:
            best, found, answer = cost, True, n
    return found, answer


@compiled
def shared(B: M3, n: V3, rays: F64, gate: float, common: float, modes: F64, out: F64) -> None:
    """What shifts that points share do to the right side of the normal equations.

    Args:
        B: maps tangents to coordinates in which the body is a unit sphere.
        n: the limb.
        rays: points (m, RAY).
        gate: standard deviations beyond which a point was not used.
        common: a shift outward of all points [px].
        modes: (m or more, k) shifts outward that go together [px].
        out: (3, k + 1): for each mode, and last for ``common``.
    """
    last = modes.shape[1]
    for j in range(last + 1):
        out[0, j], out[1, j], out[2, j] = 0.0, 0.0, 0.0
    for i in range(rays.shape[0]):
        e, row = at_foot(B, n, rays[i])
        if math.fabs(e) < gate * rays[i, 6]:
            w = 1.0 / (rays[i, 6] * rays[i, 6])
            for j in range(last + 1):
                much = w * (modes[i, j] if j < last else common)
                out[0, j] += much * row[0]
                out[1, j] += much * row[1]
                out[2, j] += much * row[2]


@compiled
def median(values: Row) -> float:
    """Middle one of some numbers (the higher of two), by selection; changes their order."""
    low, high, k = 0, values.shape[0] - 1, values.shape[0] // 2
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return values[k]


@compiled
def select(B: M3, n: V3, rays: F64, gate: float, used: I64, work: F64) -> tuple[float, bool]:
    """Mark the points within ``gate`` robust standard deviations.

    Args:
        B: maps tangents to coordinates in which the body is a unit sphere.
        n: the limb.
        rays: points (m, RAY).
        gate: standard deviations.
        used: in and out, (m,).
        work: (2, m).

    Returns:
        Robust standard deviation of the points over the stated one, from 1 to `MOST_NOISE`, and whether the choice
        changed.
    """
    count = rays.shape[0]
    for i in range(count):
        work[0, i] = math.fabs(distance(B, n, rays[i])) / rays[i, 6]
        work[1, i] = work[0, i]
    spread = min(max(1.0, median(work[1]) / 0.6745), MOST_NOISE)  # of a normal distribution
    changed = False
    for i in range(count):
        keep = 1 if work[0, i] <= gate * spread else 0
        changed = changed or keep != used[i]
        used[i] = keep
    return spread, changed


@compiled
def doubtful(B: M3, n: V3, rays: F64, inv: F64, limit: float, used: I64) -> int:
    """Stop using points that the others do not confirm.

    These are points with a residual that is too large for the part of it that a fit leaves, and points that the
    others cannot check: they decide the fit alone (leverage above `LEVERAGE`), and if they are wrong nothing shows it.

    Args:
        B: maps tangents to coordinates in which the body is a unit sphere.
        n: the limb.
        rays: points (m, RAY).
        inv: covariance of n (3, 3).
        limit: largest studentised residual.
        used: in and out, (m,).

    Returns:
        How many are used no longer.
    """
    dropped = 0
    for i in range(used.shape[0]):
        if used[i] == 0:
            continue
        f, fu, fv, h = edge(B, n, rays[i, 0], rays[i, 1], rays[i])
        k = 1.0 / (rays[i, 6] * math.sqrt(fu * fu + fv * fv))
        e, own = k * f, 0.0
        for p in range(3):
            for q in range(3):
                own += k * k * h[p] * inv[p, q] * h[q]
        if not (own <= LEVERAGE and e * e <= limit * limit * (1.0 - own)):
            used[i] = 0
            dropped += 1
    return dropped


@compiled
def fit(B: M3, rays: F64, robust: bool, gate: float, min_share: float, inv: F64) -> tuple[int, V3, float, int]:
    """Fit n to points.

    Args:
        B: maps tangents to coordinates in which the body is a unit sphere, `local_frame`.
        rays: points (m, RAY).
        robust: leave out points that disagree with most, or that no others confirm.
        gate: standard deviations beyond which a point disagrees.
        min_share: least part of the points that must agree.
        inv: out, (3, 3), covariance of n.

    Returns:
        Status, n, sum of squares over sigma, points used.
    """
    count = rays.shape[0]
    A, b, x = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    used, work = np.ones(count, np.int64), np.zeros((2, count))
    good, n = start(B, rays, used, A, b, x)
    status, chi2 = NO_SOLUTION, math.nan
    if good:
        status, n, chi2, _ = refine(B, n, rays, used, 3.0 * gate if robust else math.inf, A, b, x)
    if status == VALID and not invert_spd(A, inv):
        status = NO_SOLUTION
    if not robust or (status == VALID and doubtful(B, n, rays, inv, gate, used) == 0):
        return status, n, chi2, count
    # a single far point can bend the limb of a short arc to itself, so nothing of this fit is used
    good, n = consensus(B, rays, 60, gate)
    if not good:
        return NO_SOLUTION, n, chi2, 0
    spread, changed = 1.0, True
    for k in range(10):
        # three points are noisy: first only those that agree best
        spread, changed = select(B, n, rays, 2.0 if k == 0 else gate, used, work)
        status, n, chi2, _ = refine(B, n, rays, used, math.inf, A, b, x)
        if status != VALID or (k > 0 and not changed):
            break
    while status == VALID and invert_spd(A, inv) and doubtful(B, n, rays, inv, gate * spread, used) > 0:
        status, n, chi2, _ = refine(B, n, rays, used, math.inf, A, b, x)
    kept = 0
    for i in range(count):
        kept += used[i]
    if status == VALID and (kept < MIN_POINTS or kept < min_share * count):
        status = OUTLIERS
    return status, n, chi2, kept


@compiled
def position(B: M3, n: V3, P_n: M3) -> tuple[V3, M3]:
    """Camera relative to the body's centre, in units of B's inverse, and its covariance, both in the frame of s.

    Christian and Robinson (2016): q = -n / sqrt(n . n - 1).
    """
    d = dot(n, n) - 1.0
    k = -1.0 / math.sqrt(d)
    inv = inverse(B)
    r = scale(k, (dot(inv[0], n), dot(inv[1], n), dot(inv[2], n)))
    slope = (
        axpy(-n[0] / d, n, (1.0, 0.0, 0.0)),
        axpy(-n[1] / d, n, (0.0, 1.0, 0.0)),
        axpy(-n[2] / d, n, (0.0, 0.0, 1.0)),
    )
    F = matmul(inv, slope)
    P = sandwich(F, P_n)
    return r, (scale(k * k, P[0]), scale(k * k, P[1]), scale(k * k, P[2]))
