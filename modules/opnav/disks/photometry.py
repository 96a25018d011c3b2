"""How bright a sphere is near its limb, by laws of reflection, as a camera sees it.

At depth t behind the limb the cosines of emission and incidence are

    mu = sqrt(1 - (sin(rho - t) / sin(rho))^2),   mu0 = a sqrt(1 - mu^2) + b mu

with rho the angular radius, a = s . p and b = -s . h; h is the ray along the limb, p the surface's normal there, and s
points to the Sun. The point-spread function is a Gaussian and the pixel's square, and the limb is curved.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from fsw.math.camera import UNLIMITED, undistort
from messages.base import F64
from modules.opnav.disks.ellipse import Ellipse, azimuths

TURN = 2.0 * math.pi
PIXEL = 1.0 / 12.0
"""Variance of a pixel's square along any line [px^2]."""
FLAT = -0.75 / 120.0
"""Its fourth cumulant, mean over the directions [px^4]."""
FAR_FOCAL = 1e5
"""Focal length of a camera so far away that the disk is seen in parallel rays [px]."""
NODES, _WEIGHTS = np.polynomial.legendre.leggauss(128)
NODES, _WEIGHTS = 0.5 * NODES + 0.5, 0.5 * _WEIGHTS
LOW, HIGH, GRID = -10.0, 8.0, 0.1
"""Distances from the limb that are tabled, outside positive [px]."""
DEPTHS = np.arange(LOW, HIGH + 0.5 * GRID, GRID)
LAWS = 7
"""Lommel-Seeliger, Lambert, the first times mu, what does not depend on the Sun: even and as mu; Minnaert 0.7;
Lambert times mu."""


class View(NamedTuple):
    """A camera and the Sun."""

    lens: F64
    """(11,) as `fsw.math.camera` takes it."""
    sun: F64
    """(3,) unit vector to the Sun, camera's components."""


def far_view(e: Ellipse, azimuth: float, phase: float) -> View:
    """A view from far away, the Sun at an azimuth in the image and at a phase angle [rad]."""
    lens = np.array([FAR_FOCAL, FAR_FOCAL, e.x, e.y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, UNLIMITED])
    side = math.sin(phase)
    return View(lens, np.array([side * math.cos(azimuth), side * math.sin(azimuth), -math.cos(phase)]))


class Incidence(NamedTuple):
    """Along the limb, at even azimuths over the turn (m,): a, b as above, radians in a pixel across, and rho [rad]."""

    a: F64
    b: F64
    scale: F64
    rho: float


def incidence(view: View, e: Ellipse, count: int) -> Incidence:
    """Where the light comes from along an ellipse that is a sphere's limb."""
    theta = azimuths(count)
    reach, nx, ny = e.at(theta)
    x, y = e.x + reach * np.cos(theta), e.y + reach * np.sin(theta)
    pixels = np.concatenate([np.column_stack([x, y]), np.column_stack([x - nx, y - ny])])
    tangents = np.empty_like(pixels)
    undistort(view.lens, pixels, tangents)
    rays = np.column_stack([tangents, np.ones(2 * count)])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    limb, inner = rays[:count], rays[count:]
    axis = _axis(limb)
    out = limb - (limb @ axis)[:, None] * axis
    sine: F64 = np.linalg.norm(out, axis=1)
    rho = float(np.mean(np.arcsin(np.minimum(sine, 1.0))))
    out /= sine[:, None]
    normal = math.cos(rho) * out - math.sin(rho) * axis
    inner_sine = np.linalg.norm(inner - (inner @ axis)[:, None] * axis, axis=1)
    scale = np.arcsin(np.minimum(sine, 1.0)) - np.arcsin(np.minimum(inner_sine, 1.0))
    return Incidence(normal @ view.sun, -(limb @ view.sun), np.maximum(scale, 1e-12), rho)


def _axis(limb: F64) -> F64:
    """Axis k of the cone through rays h (n, 3): h . k is the same for all."""
    middle = limb.mean(axis=0)
    _, _, v = np.linalg.svd(limb - middle, full_matrices=False)
    return np.asarray(v[2] * math.copysign(1.0, float(v[2] @ middle)), float)


def round_ovals(view: View, e: Ellipse) -> tuple[float, float]:
    """Ovals of a sphere's image where an ellipse is, by a lens without distortion.

    The cone of half-angle rho about a ray at the angle g from the boresight is an ellipse whose axes have the ratio
    cos(rho) / sqrt(cos(rho)^2 - sin(g)^2), the long one along the way from the principal point.
    """
    fx, fy, cx, cy = (float(v) for v in view.lens[:4])
    x, y = (e.x - cx) / fx, (e.y - cy) / fy
    off, radius, oval = math.hypot(x, y), e.radius / math.sqrt(fx * fy), 0.0
    for _ in range(4):
        a = radius * math.exp(oval)
        near, far = math.atan(off - a), math.atan(off + a)
        rho, g = 0.5 * (far - near), 0.5 * (far + near)
        room = math.cos(rho) ** 2 - math.sin(g) ** 2
        if not room > 0.05:  # nearly a parabola: no disk that could be seen whole
            break
        oval = 0.5 * math.log(math.cos(rho) / math.sqrt(room))
    turn = 2.0 * math.atan2(y, x)
    return oval * math.cos(turn), oval * math.sin(turn)


def brightness(seen: Incidence, depth: float) -> F64:
    """Light by the laws, at the nodes' depths, (LAWS, m, nodes); the last node is at ``depth`` [px]."""
    t = seen.scale[:, None] * (depth * np.append(NODES, 1.0) ** 2)
    t = np.minimum(t, 0.98 * seen.rho)
    part = np.sin(seen.rho - t) / math.sin(seen.rho)
    # Near the limb 1 - part^2 is a small difference of large numbers
    less = 2.0 * np.cos(seen.rho - 0.5 * t) * np.sin(0.5 * t) / math.sin(seen.rho)
    mu = np.sqrt(np.maximum(less * (1.0 + part), 1e-12))
    a, b = seen.a[:, None] - t * seen.b[:, None], seen.b[:, None] + t * seen.a[:, None]
    mu0 = np.maximum(a * part + b * mu, 0.0)
    lit = mu0 > 0.0
    seeliger = mu0 / (mu0 + mu)
    minnaert = np.where(lit, np.maximum(mu0, 1e-9), 0.0) ** 0.7 * np.maximum(mu, 1e-3) ** -0.3
    return np.array([seeliger, mu0, seeliger * mu, lit * 1.0, lit * mu, minnaert, mu0 * mu], np.float64)


def terminator(seen: Incidence) -> F64:
    """How deep light reaches (m,) [px]: to where mu0 = 0, as far as that is on this side of the body."""
    part = 1.0 / np.sqrt(1.0 + (seen.a / np.minimum(seen.b, -1e-9)) ** 2)
    t = seen.rho - np.arcsin(part * math.sin(seen.rho))
    return np.where(seen.a <= 0.0, 0.0, np.where(seen.b >= 0.0, math.inf, t / seen.scale))


def spread(blur: float, depth: float, radius: float) -> F64:
    """What light at the nodes does at the tabled distances, (5, nodes + 1, D): value, derivatives 1, 2, 4 and 5.

    Args:
        blur: standard deviation of the point-spread function across the limb, the pixel included [px].
        depth: of the last node [px]; beyond it light stays as it is there.
        radius: of the limb [px]; the blur of a disk is that of a straight edge, drawn inwards by blur^2 / (2 radius).
    """
    return _spread(round(blur, 5), round(depth, 3), round(radius, 2))


@functools.lru_cache(32)
def _spread(blur: float, depth: float, radius: float) -> F64:
    at = depth * NODES**2
    width = 2.0 * depth * NODES * _WEIGHTS
    z = (DEPTHS + blur * blur / (2.0 * radius) + at[:, None]) / blur
    g = np.exp(-0.5 * z * z) / (math.sqrt(TURN) * blur)
    k = FLAT / 24.0 / blur**4
    # Hermite polynomials: the Gaussian's derivatives, of which the pixel's square takes the fourth and following
    he = [np.ones_like(z), z]
    for n in range(1, 9):
        he.append(z * he[n] - n * he[n - 1])
    derivatives = [g * (-1.0) ** n * (he[n] + k * he[n + 4]) / blur**n for n in range(3)]
    derivatives += [g * he[4] / blur**4, -g * he[5] / blur**5]
    inner = np.stack(derivatives) * width[:, None]
    end = (DEPTHS + blur * blur / (2.0 * radius) + depth) / blur
    e = np.exp(-0.5 * end * end) / (math.sqrt(TURN) * blur)
    rest = np.stack([_beyond(end), -e, end * e / blur, np.zeros_like(e), np.zeros_like(e)])
    return np.concatenate([inner, rest[:, None]], axis=1)


def _beyond(z: F64) -> F64:
    """Part of a normal distribution above z (n,)."""
    return np.array([0.5 * math.erfc(v / math.sqrt(2.0)) for v in z.tolist()])
