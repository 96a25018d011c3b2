"""Ray casting of an ellipsoid, compiled: one body at a time over the pixels that it may touch.

A body is an array of `BODY_SIZE` numbers, made by `sim.camera.disk_camera.scene.body_numbers`:

- 0 to 8: matrix from tangents (x, y, 1) to directions in units of the axes, rows first;
- 9 to 11: the camera in units of the axes; 12 to 14: reciprocal axes; 15 to 17: direction to the Sun times these;
- 18 to 20: axes; 21: law of reflection; 22: its exponent; 23: brightness;
- 24: how much `1 - p^2` changes in a pixel at most, p being the closest approach of a ray to the centre.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from messages.base import F64
from sim.camera.disk_camera.edges import spread

BODY_SIZE = 25
LAMBERT, LOMMEL_SEELIGER, MINNAERT = 0, 1, 2
LINES = 8
"""Lines across a pixel that the limb crosses."""
_NODES = np.polynomial.legendre.leggauss(6)[0] / 2.0 + 0.5
_WEIGHTS = np.polynomial.legendre.leggauss(6)[1] / 2.0
"""Of the rays on each line, on the way from 0 to 1 (Gauss)."""


def _lattice(rays: int, step: int) -> F64:
    """Places in a pixel and weights (n, 3) of a lattice of rank 1: for a terminator, wherever it goes."""
    k = np.arange(rays)
    return np.column_stack([(k + 0.5) / rays - 0.5, ((k * step) % rays + 0.5) / rays - 0.5, np.full(rays, 1.0 / rays)])


def _gauss(n: int) -> F64:
    """The same (n^2, 3) of Gauss's rule in both directions: for light that is smooth, even if it changes fast."""
    node, weight = np.polynomial.legendre.leggauss(n)
    u, v = (0.5 * x.ravel() for x in np.meshgrid(node, node))
    return np.column_stack([u, v, 0.25 * np.outer(weight, weight).ravel()])


_AT_TERMINATOR, _NEAR_LIMB, _WITHIN = _lattice(16, 5), _gauss(4), _gauss(2)


@compiled
def meet(body: F64, x: float, y: float) -> tuple[float, float, float, float]:
    """Where a ray meets a body.

    It has no branch: a function of an array that has one is not merged into its caller, and such calls are slow.

    Args:
        body: its numbers (25,).
        x: tangent of the ray to the right.
        y: tangent downwards.

    Returns:
        Room: 1 - p^2, negative if the ray misses, very negative behind the camera. If it is positive: depth along the
        boresight, and the cosines of incidence and emission of the light; the former is negative at night.
    """
    tx = body[0] * x + body[1] * y + body[2]
    ty = body[3] * x + body[4] * y + body[5]
    tz = body[6] * x + body[7] * y + body[8]
    inverse = 1.0 / (tx * tx + ty * ty + tz * tz)
    k = -(body[9] * tx + body[10] * ty + body[11] * tz) * inverse
    px, py, pz = body[9] + k * tx, body[10] + k * ty, body[11] + k * tz
    room = 1.0 - (px * px + py * py + pz * pz)
    room = room if k > 0.0 else -1e300
    back = math.sqrt(max(room, 0.0) * inverse)
    px, py, pz = px - back * tx, py - back * ty, pz - back * tz
    nx, ny, nz = px * body[12], py * body[13], pz * body[14]
    square = nx * nx + ny * ny + nz * nz
    mu0 = (px * body[15] + py * body[16] + pz * body[17]) / math.sqrt(square)
    mu = back / (inverse * math.sqrt(square * (x * x + y * y + 1.0)))
    return room, k - back, mu0, mu


@compiled
def reflected(law: float, exponent: float, mu0: float, mu: float) -> float:
    """Part of the light that a surface sends to the camera, from the cosines of incidence and emission; 0 at night."""
    if not mu0 > 0.0:
        return 0.0
    if law == LAMBERT:
        return mu0
    if law == LOMMEL_SEELIGER:
        return 2.0 * mu0 / (mu0 + mu)
    mu = max(mu, 1e-3)
    return math.pow(mu0 * mu, exponent) / mu


@compiled
def meet_row(body: F64, tangents: F64, out: F64) -> None:
    """`meet` for rays (n, 2), into ``out`` (n, 4)."""
    for j in range(tangents.shape[0]):
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = meet(body, tangents[j, 0], tangents[j, 1])


@compiled
def texture_at(body: F64, faces: NDArray[np.float32], x: float, y: float, depth: float) -> float:
    """The texture at a place that `meet` has found, linear between the middles of its cells."""
    px = body[9] + depth * (body[0] * x + body[1] * y + body[2])
    py = body[10] + depth * (body[3] * x + body[4] * y + body[5])
    pz = body[11] + depth * (body[6] * x + body[7] * y + body[8])
    face, i, j, v, u = cell(faces.shape[1] - 2, px * body[18], py * body[19], pz * body[20])
    top = (1.0 - u) * faces[face, i, j] + u * faces[face, i, j + 1]
    return (1.0 - v) * top + v * ((1.0 - u) * faces[face, i + 1, j] + u * faces[face, i + 1, j + 1])


@compiled
def cell(n: int, x: float, y: float, z: float) -> tuple[int, int, int, float, float]:
    """Where a direction is in a cube of n x n cells: face, row, column of a cell, how far on towards the next ones."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, major, a, b = (0 if x >= 0.0 else 1), ax, y, z
    elif ay >= az:
        face, major, a, b = (2 if y >= 0.0 else 3), ay, x, z
    else:
        face, major, a, b = (4 if z >= 0.0 else 5), az, x, y
    half = 0.5 * n
    scale = half / major
    u, v = a * scale + half + 0.5, b * scale + half + 0.5
    i, j = int(v), int(u)
    return face, i, j, v - i, u - j


@compiled
def draw(
    body: F64,
    faces: NDArray[np.float32],
    grid: F64,
    first_row: int,
    last_row: int,
    first_column: int,
    last_column: int,
    out: NDArray[np.float32],
    fine: NDArray[np.float32],
    edge: NDArray[np.uint8],
) -> None:
    """Draw a body over what is in the image already.

    Args:
        body: its numbers (25,).
        faces: its texture.
        grid: (H + 2, W + 2, 2), tangents of the middles of the pixels and of a frame of one pixel around them.
        first_row: of the pixels to draw.
        last_row: one beyond.
        first_column: likewise.
        last_column: likewise.
        out: (H, W), radiance.
        fine: light of pixels near a limb where it falls, see `sim.camera.disk_camera.edges`; empty if not wanted.
        edge: (H, W), 1 for these pixels.
    """
    step, law, exponent, bright = body[24], body[21], body[22], body[23]
    corner = 0.75 * step  # as far as the corners of a pixel are from its middle, and a little more
    has_texture = faces.shape[1] > 3
    met, rays = np.empty((last_column - first_column, 4)), np.zeros((LINES * _NODES.shape[0], 3))
    four, wanted = np.zeros(16), edge.shape[0] > 0
    for i in range(first_row, last_row):
        meet_row(body, grid[i + 1, first_column + 1 : last_column + 1], met)
        for j in range(first_column, last_column):
            room, depth, mu0, mu = met[j - first_column]
            if not room > -corner - 0.13 * step * step:
                continue
            x, y = grid[i + 1, j + 1, 0], grid[i + 1, j + 1, 1]
            covered, swapped, count = 1.0, False, 0
            twilight = mu0 * mu0 * room <= step * step
            if room > 8.0 * step and not twilight:
                light = reflected(law, exponent, mu0, mu)
            else:
                xu, yu = (
                    0.5 * (grid[i + 1, j + 2, 0] - grid[i + 1, j, 0]),
                    0.5 * (grid[i + 1, j + 2, 1] - grid[i + 1, j, 1]),
                )
                xv, yv = (
                    0.5 * (grid[i + 2, j + 1, 0] - grid[i, j + 1, 0]),
                    0.5 * (grid[i + 2, j + 1, 1] - grid[i, j + 1, 1]),
                )
                if room > 4.0 * step:
                    table = _AT_TERMINATOR if twilight else _WITHIN
                    light, x, y, depth = _smooth(body, x, y, xu, yu, xv, yv, table, rays)
                elif room > corner:
                    table = _AT_TERMINATOR if twilight else _NEAR_LIMB
                    light, x, y, depth = _smooth(body, x, y, xu, yu, xv, yv, table, rays)
                    count = table.shape[0]
                elif abs(_limb_terms(body, x, y, xu, yu)[1]) >= abs(_limb_terms(body, x, y, xv, yv)[1]):
                    covered, light, x, y, depth, count = _cross_limb(body, x, y, xu, yu, xv, yv, rays)
                else:
                    covered, light, x, y, depth, count = _cross_limb(body, x, y, xv, yv, xu, yu, rays)
                    swapped = True
            factor = texture_at(body, faces, x, y, depth) if has_texture and light > 0.0 else 1.0
            if wanted and (count > 0 or edge[i, j] != 0):
                spread(rays, count, swapped, bright * factor, covered, i, j, out, fine, edge, four)
            out[i, j] = out[i, j] * (1.0 - covered) + bright * factor * light


@compiled
def _smooth(
    body: F64, x: float, y: float, xu: float, yu: float, xv: float, yv: float, table: F64, rays: F64
) -> tuple[float, float, float, float]:
    """Light of a pixel within the limb, and tangents and depth of the place that it comes from on average.

    ``table`` (n, 3) has places in the pixel, from -0.5 to 0.5, and weights. ``rays`` (n, 3) gets the places again, and
    their light.
    """
    total, sx, sy, sd = 0.0, 0.0, 0.0, 0.0
    for k in range(table.shape[0]):
        u, v = table[k, 0], table[k, 1]
        rx, ry = x + u * xu + v * xv, y + u * yu + v * yv
        _, depth, mu0, mu = meet(body, rx, ry)
        light = table[k, 2] * reflected(body[21], body[22], mu0, mu)
        rays[k, 0], rays[k, 1], rays[k, 2] = u, v, light
        total, sx, sy, sd = total + light, sx + light * rx, sy + light * ry, sd + light * depth
    if not total > 0.0:
        return 0.0, x, y, 0.0
    return total, sx / total, sy / total, sd / total


@compiled
def _limb_terms(body: F64, x: float, y: float, dx: float, dy: float) -> tuple[float, float, float]:
    """A, B, C of A u^2 + 2 B u + C, which is positive where the ray (x + u dx, y + u dy, 1) meets the body.

    With the direction t and the camera o in units of the axes it is t.t - (o x t).(o x t): nothing cancels.
    """
    tx = body[0] * x + body[1] * y + body[2]
    ty = body[3] * x + body[4] * y + body[5]
    tz = body[6] * x + body[7] * y + body[8]
    sx, sy, sz = body[0] * dx + body[1] * dy, body[3] * dx + body[4] * dy, body[6] * dx + body[7] * dy
    ox, oy, oz = body[9], body[10], body[11]
    ax, ay, az = oy * tz - oz * ty, oz * tx - ox * tz, ox * ty - oy * tx
    bx, by, bz = oy * sz - oz * sy, oz * sx - ox * sz, ox * sy - oy * sx
    return (
        sx * sx + sy * sy + sz * sz - (bx * bx + by * by + bz * bz),
        tx * sx + ty * sy + tz * sz - (ax * bx + ay * by + az * bz),
        tx * tx + ty * ty + tz * tz - (ax * ax + ay * ay + az * az),
    )


@compiled
def _cross_limb(
    body: F64, x: float, y: float, dx: float, dy: float, ex: float, ey: float, rays: F64
) -> tuple[float, float, float, float, float, int]:
    """Part of a pixel that a body covers, light of that part times its size, where it comes from as in `_smooth`, rays.

    Along each of a few lines (d, across the limb; e leads from line to line) the limb is found exactly, and the rays
    lie closer together towards it, where the radiance grows as the square root of the distance.
    """
    covered, total, sx, sy, sd, count = 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for n in range(LINES):
        v = (n + 0.5) / LINES - 0.5
        px, py = x + v * ex, y + v * ey
        a, b, c = _limb_terms(body, px, py, dx, dy)
        square = b * b - a * c
        low, high, edge, far = -0.5, 0.5, -0.5, 0.5
        if square <= 0.0:
            if c <= 0.0:
                continue
        else:
            root = math.sqrt(square)
            q = -(b + math.copysign(root, b))
            first, second = (q / a if a != 0.0 else math.inf), (c / q if q != 0.0 else 0.0)
            first, second = min(first, second), max(first, second)
            if a < 0.0:  # the body is between the roots
                low, high = max(first, -0.5), min(second, 0.5)
            elif first > -0.5:
                high = min(first, 0.5)
            else:
                low = max(second, -0.5)
            if high <= low:
                continue
            edge, far = (high, low) if high < 0.5 else (low, high)
        covered += (high - low) / LINES
        for k in range(_NODES.shape[0]):
            u = edge + (far - edge) * _NODES[k] * _NODES[k]
            rx, ry = px + u * dx, py + u * dy
            _, depth, mu0, mu = meet(body, rx, ry)
            light = 2.0 * _NODES[k] * _WEIGHTS[k] * (high - low) / LINES * reflected(body[21], body[22], mu0, mu)
            rays[count, 0], rays[count, 1], rays[count, 2] = u, v, light
            count += 1
            total, sx, sy, sd = total + light, sx + light * rx, sy + light * ry, sd + light * depth
    if not total > 0.0:
        return covered, 0.0, x, y, 0.0, count
    return covered, total, sx / total, sy / total, sd / total, count


@compiled
def add_point(
    body: F64, faces: NDArray[np.float32], places: F64, tangents: F64, area: F64, out: NDArray[np.float32]
) -> None:
    """Add a body smaller than a pixel: rays (n, 2) at places (n, 2), each for ``area`` (n,) square pixels."""
    for n in range(places.shape[0]):
        j, i = math.floor(places[n, 0] + 0.5), math.floor(places[n, 1] + 0.5)
        if 0 <= i < out.shape[0] and 0 <= j < out.shape[1]:
            x, y = tangents[n, 0], tangents[n, 1]
            room, depth, mu0, mu = meet(body, x, y)
            if room > 0.0:
                light = area[n] * body[23] * reflected(body[21], body[22], mu0, mu)
                out[i, j] += light * (texture_at(body, faces, x, y, depth) if faces.shape[1] > 3 else 1.0)


@compiled
def add_star(u: float, v: float, light: float, out: NDArray[np.float32]) -> None:
    """Add a star, spread linearly over the four pixels around its place, so that its centroid is exact."""
    i, j = math.floor(v), math.floor(u)
    fu, fv = u - j, v - i
    for a in range(2):
        for b in range(2):
            if 0 <= i + a < out.shape[0] and 0 <= j + b < out.shape[1]:
                out[i + a, j + b] += light * (fv if a else 1.0 - fv) * (fu if b else 1.0 - fu)
