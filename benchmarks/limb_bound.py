"""What the pixels near a rendered limb can say of the position at best: Cramer-Rao bounds."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy.special import ndtr

from benchmarks.limb_scene import BAND_PX, DETECTOR, PSF_PX, SECTORS, Scene
from messages.base import F64
from sim.camera.disk_camera import disk_body

MORE_BLUR = 1.02
TOP = 255.0


class Information(NamedTuple):
    """Fisher information (3, 3) of the position, C components [1/m^2]."""

    law: F64
    """What a fitter does not know is unknown: see `information`."""
    free: F64
    """Sky, and a step, an arch and a slope of light behind the limb, are free in each sector."""
    known: F64
    """The light of every pixel is known."""


def information(scene: Scene) -> Information:
    """Information in the pixels near the lit limb.

    The derivative of the image by the position is taken by rendering it anew; the noise is that of the detector
    (shot, read, quantisation to eight bits), and what the detector cuts off at its zero and its top is lost.

    A fitter that has the Sun's direction and the camera knows the angles of incidence and emission, for they follow
    from the outline. It does not know the sky's level, the brightness of the surface in each of 24 sectors, the blur,
    and how the surface reflects: a mixture of Lambert's law and Lommel-Seeliger's, with Minnaert's where that is the
    body's. These are the unknowns of ``law``.
    """
    grey, d, sector = scene.expected(), *scene.near_limb()
    used = sector >= 0
    level, sector = grey[used], sector[used]
    electrons = (level / TOP - DETECTOR.black_level) * scene.well
    gain = TOP / scene.well
    variance = gain**2 * (np.maximum(electrons, 0.0) + DETECTOR.read_noise**2) + 1.0 / 12.0
    weight = np.where(level < TOP, _seen(level / np.sqrt(variance)) / variance, 0.0)
    step = 0.1 * scene.range / scene.focal
    # along the line of sight a larger step, which moves the limb as much as the others do
    sight = scene.r_PC_C / scene.range
    axes, _ = np.linalg.qr(np.column_stack([sight, np.eye(3)[:, :2]]))
    columns: list[F64] = []
    for k in range(3):
        much = step * (scene.focal / scene.case.radius_px if k == 0 else 1.0)
        move = much * axes[:, k]
        columns.append((scene.expected(scene.r_PC_C + move) - scene.expected(scene.r_PC_C - move))[used] / (2.0 * much))
    J = np.column_stack(columns)

    def without(unknown: list[F64]) -> F64:
        # in units of their sizes, with the unknowns projected out
        size = np.linalg.norm(J, axis=0)
        root = np.sqrt(weight)[:, None]
        left = J / size * root
        if unknown:
            block = np.column_stack(unknown) * root
            block = block[:, np.linalg.norm(block, axis=0) > 0.0]
            u, s, _ = np.linalg.svd(block / np.linalg.norm(block, axis=0), full_matrices=False)
            u = u[:, s > 1e-9 * s[0]]
            left = left - u @ (u.T @ left)
        F = left.T @ left * np.outer(size, size)
        return axes @ F @ axes.T

    even = np.ones(len(level))
    light = level - TOP * DETECTOR.black_level
    sectors = [sector == k for k in range(SECTORS)]
    blur = (scene.expected(psf_px=MORE_BLUR * PSF_PX) - grey)[used]
    laws: list[dict[str, Any]] = [{"law": "lambert"}, {"law": "lommel_seeliger"}]
    if scene.case.law == "minnaert":
        laws.append({"law": "minnaert", "exponent": scene.body.exponent + 0.03})
    images: list[F64] = []
    for law in laws:
        body = msgspec.structs.replace(disk_body("Mars", albedo=scene.body.albedo, **law), texture=None)
        images.append(scene.expected(body=body)[used] - TOP * DETECTOR.black_level)
    profile = _profile(d[used], scene.case.radius_px)
    return Information(
        without([even, *(light * s for s in sectors), blur, *images]),
        without([p * s for s in sectors for p in profile]),
        without([]),
    )


def _seen(x: F64) -> F64:
    """Part of the information that is left of a level of x sigma (n,) if the detector gives no less than zero."""
    above, density = ndtr(x), np.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
    first = x * above + density
    return above**2 / ((1.0 + x * x) * above + x * density - first**2)


def _profile(d: F64, radius: float) -> list[F64]:
    """Sky, step, arch (cosine of emission) and slope, blurred, at distances (n,) outside of a limb."""
    sigma = math.hypot(PSF_PX, math.sqrt(1.0 / 12.0))
    grid = np.linspace(-BAND_PX - 1.0, BAND_PX + 1.0, 1401)
    offsets = np.linspace(-5.0, 5.0, 201) * sigma
    weights = np.exp(-0.5 * (offsets / sigma) ** 2) / np.exp(-0.5 * (offsets / sigma) ** 2).sum()
    depth = np.maximum(-(grid[:, None] + offsets), 0.0)
    inside = (grid[:, None] + offsets < 0.0) * 1.0
    arch = np.sqrt(depth * np.maximum(2.0 * radius - depth, 0.0)) / radius
    parts: list[F64] = [inside @ weights, arch @ weights, depth @ weights / 8.0]
    return [np.ones_like(d), *(np.interp(d, grid, p) for p in parts)]
