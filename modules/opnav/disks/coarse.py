"""From a proposed circle to an ellipse within a pixel or so: steepest falls along rays."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.ellipse import Ellipse, azimuths, fit
from modules.opnav.disks.grey import F32

CV: Any = cv2
MAX_RAYS = 240
STEP = 0.5
HEAD_ON = 0.15
"""Below this contrast of the light, the whole limb is taken for lit."""
HORN = math.radians(82.0)
"""Lit limb is what is nearer to the Sun's azimuth; beyond begins the terminator."""
DEEP = 8.0
SHARP = 0.42
"""A limb falls by this share of the light within that depth [px] over 3 px; a terminator by some quarter."""
CUT = 0.55
"""Where less of the turn is in the image, the light is known by the sharp falls alone."""
SHARP_RADIUS = 60.0
"""On smaller disks a terminator is as sharp as a limb [px]."""
NEIGHBOURS = 0.02
"""Of the turn, to each side: craters make a terminator sharp here and there."""


class Rays(NamedTuple):
    """Falls of brightness along rays: azimuths (n,), places (n, 2) [px], heights (n,), and which rays count."""

    theta: F64
    place: F64
    fall: F64
    inside: NDArray[np.bool_]
    """The ray's part near the limb lies in the image."""
    good: NDArray[np.bool_]
    """It has a fall that stands out."""
    sharp: NDArray[np.bool_]
    """The fall is steep: a limb, not a terminator."""


def rays(smooth: F32, ellipse: Ellipse, window: float, least: float) -> Rays:
    """The outermost of the strong falls of each ray, within ``window`` [px] of an ellipse.

    Args:
        smooth: (rows, columns), without spikes.
        ellipse: where to look.
        window: half-width [px].
        least: least height of a fall.
    """
    rows, columns = smooth.shape
    count = int(min(max(2.0 * math.pi * ellipse.radius, 72), MAX_RAYS))
    theta = azimuths(count)
    reach, nx, ny = ellipse.at(theta)
    x0, y0 = ellipse.x + reach * np.cos(theta), ellipse.y + reach * np.sin(theta)
    margin = 3.0
    depth = np.arange(-min(window, 0.9 * ellipse.radius) - margin, window + margin + 0.01, STEP)
    x, y = x0[:, None] + nx[:, None] * depth, y0[:, None] + ny[:, None] * depth
    inside = (x0 > 2) & (x0 < columns - 3) & (y0 > 2) & (y0 < rows - 3)
    profile = CV.remap(
        smooth, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    lag = round(2 * 1.5 / STEP)
    fall = profile[:, :-lag] - profile[:, lag:]
    at = depth[:-lag] + 1.5
    off = (x[:, :-lag] < 0) | (x[:, lag:] > columns - 1) | (x[:, lag:] < 0) | (x[:, :-lag] > columns - 1)
    off |= (y[:, :-lag] < 0) | (y[:, lag:] > rows - 1) | (y[:, lag:] < 0) | (y[:, :-lag] > rows - 1)
    fall[off] = -1.0
    peak = np.zeros(fall.shape, np.bool_)
    peak[:, 1:-1] = (fall[:, 1:-1] >= fall[:, :-2]) & (fall[:, 1:-1] > fall[:, 2:])
    best = fall.max(axis=1)
    strong = peak & (fall > np.maximum(0.5 * best, least)[:, None])
    good = inside & strong.any(axis=1)
    index = fall.shape[1] - 1 - np.argmax(strong[:, ::-1], axis=1)
    d = at[index]
    place = np.column_stack([x0 + nx * d, y0 + ny * d])
    each = np.arange(count)
    within = profile[each[:, None], np.maximum(index[:, None] - np.arange(0, round(DEEP / STEP), 2), 0)].max(axis=1)
    sharp = fall[each, index] > SHARP * (within - profile[each, index + lag])
    return Rays(theta, place, fall[each, index], inside, good, sharp)


class Light(NamedTuple):
    """From where a disk is lit, by the heights of the falls around it."""

    azimuth: float
    """Of the Sun in the image, from column towards row [rad]."""
    contrast: float
    """First harmonic of the falls to their mean: 0 lit head on, 1.6 half or less of it lit."""


def light_of(seen: Rays) -> Light:
    """Fit fall(azimuth) = a + b cos + c sin over the rays in the image, where rays without a fall count as zero."""
    theta, fall = seen.theta[seen.inside], np.where(seen.good, seen.fall, 0.0)[seen.inside]
    fall = np.minimum(fall, 3.0 * np.median(fall[fall > 0])) if (fall > 0).any() else fall
    rows = np.column_stack([np.ones_like(theta), np.cos(theta), np.sin(theta)])
    if len(theta) < 8 or not fall.any():
        return Light(0.0, 0.0)
    # Where little of the turn is in the image, the harmonic is drawn towards what the mean alone would say
    left = rows.T @ rows + np.diag([0.0, 1.0, 1.0]) * 0.02 * len(seen.theta)
    a, b, c = np.linalg.solve(left, rows.T @ fall)
    return Light(math.atan2(c, b), math.hypot(b, c) / max(a, 1e-9) if a > 0 else 2.0)


def mostly(which: NDArray[np.bool_], of: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Members of (n,) whose neighbours on both sides, over a turn, mostly are such too."""
    half = max(2, round(len(which) * NEIGHBOURS))
    both = np.stack([which, of]).astype(float)
    around = np.concatenate([both[:, -half:], both, both[:, :half]], axis=1).cumsum(axis=1)
    near = around[:, 2 * half :] - np.pad(around, ((0, 0), (1, 0)))[:, : len(which)]
    return which & (near[0] > 0.7 * near[1])


def middle_of(seen: Rays) -> Light:
    """The middle of the limb that is seen, for a disk cut off by the frame."""
    theta = seen.theta[seen.good]
    return Light(math.atan2(np.sin(theta).sum(), np.cos(theta).sum()), 1.0)


def lit(theta: F64, light: Light, within: float = HORN) -> NDArray[np.bool_]:
    """Azimuths (n,) whose limb is lit for certain: all, if the disk is lit head on, else those near the Sun's [rad]."""
    if light.contrast < HEAD_ON:
        return np.ones(len(theta), np.bool_)
    return np.cos(theta - light.azimuth) > math.cos(within)


def settle(smooth: F32, start: Ellipse, least: float, sun: Light | None) -> tuple[Ellipse, Rays, Light] | None:
    """Follow the limb from a proposed circle, with ever narrower windows; None if too few rays agree.

    Args:
        smooth: (rows, columns), without spikes.
        start: where to look.
        least: least height of a fall [levels].
        sun: where the Sun stands, if that is known.
    """
    e, light = start, Light(0.0, 0.0)
    seen = None
    windows = [max(4.0, share * e.radius) for share in (0.08, 0.03)] + [4.0, 4.0]
    for window in windows:
        seen = rays(smooth, e, min(window, 60.0), least)
        cut = sun is None and seen.inside.mean() < CUT and e.radius > SHARP_RADIUS
        if cut:
            seen = seen._replace(good=seen.good & mostly(seen.good & seen.sharp, seen.inside))
        light = sun or (middle_of(seen) if cut else light_of(seen))
        used = seen.good & lit(seen.theta, light)
        x, y = seen.place[used].T
        if len(x) < 12 or len(x) < 0.3 * (seen.inside & lit(seen.theta, light)).sum():
            return None
        sigma = np.full(len(x), max(0.5, 0.1 * window))
        made, agree, scale = fit(e._replace(oval_x=0.0, oval_y=0.0), x, y, sigma, False, max(window, 2.0), 5)
        if used.mean() > 0.2 and not cut:
            oval, agree_oval, scale_oval = fit(e, x, y, sigma, True, max(window, 2.0), 5)
            if agree_oval.sum() > 1.04 * agree.sum() or scale_oval < 0.75 * scale:
                made, agree = oval, agree_oval
        if agree.sum() < max(10.0, 0.4 * len(x)):
            return None
        e = made
    return None if seen is None else (e, seen, light)
