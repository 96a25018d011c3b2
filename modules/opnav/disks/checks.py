"""What is around a disk, and in it."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from modules.opnav.disks.coarse import Light, lit
from modules.opnav.disks.ellipse import Ellipse, azimuths
from modules.opnav.disks.grey import F32

CV: Any = cv2
RAYS = 180
MIN_DARK = 0.65
MIN_FULL = 0.6


def surroundings(smooth: F32, e: Ellipse, black: float, light: Light, arc: float) -> str | None:
    """What is wrong: space beyond a disk is dark and even, and a disk that is lit all round is full.

    The first must hold for two thirds of its turn, so a moon before a ring or with another beside it is none the worse.

    Args:
        smooth: (rows, columns) grey, without spikes.
        e: its outline.
        black: level of the dark.
        light: from where it is lit.
        arc: length of the limb that was seen [rad].
    """
    rows, columns = smooth.shape
    theta = azimuths(RAYS)
    reach, nx, ny = e.at(theta)
    beyond = np.linspace(3.0, max(7.0, min(0.12 * e.radius, 25.0)), 7)
    rim = -np.minimum(np.array([2.0, 4.0, 0.1 * e.radius, 0.2 * e.radius]), 0.25 * e.radius)
    depth = np.concatenate([beyond, rim, -e.radius * np.array([0.25, 0.4, 0.6, 0.8])])
    x = (e.x + reach * np.cos(theta))[:, None] + nx[:, None] * depth
    y = (e.y + reach * np.sin(theta))[:, None] + ny[:, None] * depth
    inside = (x >= 0) & (x <= columns - 1) & (y >= 0) & (y <= rows - 1)
    profile = CV.remap(
        smooth, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    seen = inside[:, 0]
    bright = seen & lit(theta, light)
    if not bright.any():
        return "a limb outside of the image"
    height = float(np.median(profile[bright, 7:11].max(axis=1))) - black
    space = np.where(inside, profile, -np.inf)[seen, :7]
    dark = (space.max(axis=1) - space[:, 0] < 0.35 * height) & (space[:, 0] - black < 0.4 * height)
    if dark.mean() < MIN_DARK:
        return "no dark space around"
    core = profile[:, 11:][inside[:, 11:]]
    if arc > math.radians(200.0) and core.size and (core - black > 0.25 * height).mean() < MIN_FULL:
        return "a ring"
    return None
