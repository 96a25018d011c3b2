"""From where a disk is lit, by its shading: a sphere is matched to the light inside a circle."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from messages.base import F64
from modules.opnav.disks.ellipse import Ellipse
from modules.opnav.disks.grey import F32

CV: Any = cv2
POINTS = 400
"""Of the disk that are looked at, evenly spread (Vogel 1979)."""
REACH = 0.96
"""How far out, to the radius: farther, an error of the circle counts for more than the light."""
SIDE_PX = 20.0
"""The disk is reduced to this radius: texture and craters average out."""
AZIMUTHS = np.arange(24) * math.radians(15.0)
PHASES: F64 = np.radians([0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0, 135.0, 150.0])
LAWS = 3


class Shading(NamedTuple):
    """How a disk is lit."""

    azimuth: float
    """Of the Sun in the image, from column towards row [rad]."""
    phase: float
    """Of the sphere that fits best, on a grid [rad]."""
    misfit: float
    """Square of what is left to that of the light, 0 to 1."""


@functools.cache
def _spheres() -> tuple[F64, F32]:
    """Places in the unit disk (2, n), and the light there (laws * azimuths * phases, n).

    Laws are Lambert's, Lommel-Seeliger's and the mean of both (McEwen 1991): real ground lies between.
    """
    k = np.arange(POINTS) + 0.5
    r, turn = REACH * np.sqrt(k / POINTS), k * math.pi * (3.0 - math.sqrt(5.0))
    x, y, z = r * np.cos(turn), r * np.sin(turn), np.sqrt(1.0 - r * r)
    azimuth, phase = (a.reshape(-1, 1) for a in np.meshgrid(AZIMUTHS, PHASES, indexing="ij"))
    incident = np.maximum((x * np.cos(azimuth) + y * np.sin(azimuth)) * np.sin(phase) + z * np.cos(phase), 0.0)
    lunar = incident / np.maximum(incident + z, 1e-6)
    return np.stack([x, y]), np.concatenate([incident, lunar, 0.5 * incident + lunar]).astype(np.float32)


def shading(smooth: F32, e: Ellipse, black: float) -> Shading | None:
    """The Sun's azimuth and the phase of the sphere whose light is most like that within a circle.

    Only what lies in the image counts. The scale of the light is free, and so is the law of reflection.

    Args:
        smooth: (rows, columns), without spikes.
        e: the circle, to some percent of its radius; ovals are ignored.
        black: level of the dark.

    Returns:
        The light, or None if too little of the disk lies in the image.
    """
    rows, columns = smooth.shape
    (ux, uy), light = _spheres()
    x, y = e.x + e.radius * ux, e.y + e.radius * uy
    left, right = max(0, math.floor(e.x - e.radius)), min(columns, math.ceil(e.x + e.radius) + 1)
    upper, lower = max(0, math.floor(e.y - e.radius)), min(rows, math.ceil(e.y + e.radius) + 1)
    inside = (x >= left) & (x <= right - 1) & (y >= upper) & (y <= lower - 1)
    if right - left < 4 or lower - upper < 4 or inside.sum() < 0.15 * POINTS:
        return None
    part, shrink = smooth[upper:lower, left:right], max(e.radius / SIDE_PX, 1.0)
    size = max(2, round((right - left) / shrink)), max(2, round((lower - upper) / shrink))
    part = CV.resize(part, size, interpolation=cv2.INTER_AREA)
    column = (x - left + 0.5) * size[0] / (right - left) - 0.5
    row = (y - upper + 0.5) * size[1] / (lower - upper) - 0.5
    seen = CV.remap(
        part, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).ravel()
    value = np.maximum(seen - np.float32(black), 0.0) * inside
    all_of = float(value @ value)
    if not all_of > 0.0:
        return None
    size_of = np.maximum((light * light) @ inside.astype(np.float32), 1e-9)
    left_over = 1.0 - (light @ value) ** 2 / size_of / all_of
    cost = left_over.reshape(LAWS, len(AZIMUTHS), len(PHASES))
    around = cost.min(axis=(0, 2))
    k = int(np.argmin(around))
    before, least, after = (float(around[i % len(around)]) for i in (k - 1, k, k + 1))
    between = 0.5 * (before - after) / max(before - 2.0 * least + after, 1e-12)
    phase = PHASES[int(np.argmin(cost[:, k].min(axis=0)))]
    return Shading((k + between) * math.radians(15.0), float(phase), least)
