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
from modules.opnav.disks.shading import shading

CV: Any = cv2
MAX_RAYS = 240
STEP = 0.5
HEAD_ON = 0.15
"""Below this contrast of the light, the whole limb is taken for lit."""
HORN = math.radians(82.0)
"""Lit limb is what is nearer to the Sun's azimuth; beyond begins the terminator."""
WHOLE = 0.95
"""Share of the turn: where less of it is in the image, the light is known by the shading of the disk."""
CUT, CUT_RADIUS = 0.55, 60.0
"""Where less is in the image of a disk above this radius [px], no ellipse is tried at first."""
BEYOND = 0.06
"""How far beyond the outline light is looked for, to the radius."""
MOST = 0.7
"""Share of a limb lit all round that must be seen."""
MUCH = 0.08
"""Light beyond the outline on more than this share of the turn is too much."""
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
    return Rays(theta, place, fall[np.arange(count), index], inside, good)


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
    """The middle of the limb that is seen, for a disk of which little more is in the image."""
    theta = seen.theta[seen.good]
    return Light(math.atan2(np.sin(theta).sum(), np.cos(theta).sum()), 1.0)


def lit(theta: F64, light: Light, within: float = HORN) -> NDArray[np.bool_]:
    """Azimuths (n,) whose limb is lit for certain: all, if the disk is lit head on, else those near the Sun's [rad]."""
    if light.contrast < HEAD_ON:
        return np.ones(len(theta), np.bool_)
    return np.cos(theta - light.azimuth) > math.cos(within)


def settle(
    smooth: F32, start: Ellipse, least: float, black: float, sun: Light | None
) -> tuple[Ellipse, Rays, Light] | None:
    """Follow the limb from a proposed circle, with ever narrower windows; None if too few rays agree.

    Args:
        smooth: (rows, columns), without spikes.
        start: where to look.
        least: least height of a fall [levels].
        black: level of the dark.
        sun: where the Sun stands, if that is known.

    Returns:
        The outline, the falls around it, of which only those on the limb are good, and the light.
    """
    e = start
    made: tuple[Ellipse, Rays, Light] | None = None
    for window in (*(max(4.0, share * e.radius) for share in (0.08, 0.03)), 4.0, 4.0):
        seen = rays(smooth, e, min(window, 60.0), least)
        light = sun or _light(smooth, e, black, seen)
        found = _follow(e, seen, lit(seen.theta, light), window)
        if found is None:
            return None
        e = found
        made = e, seen, light
    return made


def _light(smooth: F32, e: Ellipse, black: float, seen: Rays) -> Light:
    """From the falls around a whole disk; of one that the frame cuts off, from its shading."""
    if seen.inside.mean() > WHOLE:
        return light_of(seen)
    if (found := shading(smooth, e, black)) is None:
        return middle_of(seen)
    return Light(found.azimuth, 1.0 if found.phase > 0.0 else 0.0)


def _follow(e: Ellipse, seen: Rays, limb: NDArray[np.bool_], window: float) -> Ellipse | None:
    """Circle or ellipse through the falls on a limb; None if too few agree."""
    used = seen.good & limb
    x, y = seen.place[used].T
    if len(x) < 12 or len(x) < 0.3 * (seen.inside & limb).sum():
        return None
    sigma, most = np.full(len(x), max(0.5, 0.1 * window)), max(window, 2.0)
    made, agree, scale = fit(e._replace(oval_x=0.0, oval_y=0.0), x, y, sigma, False, most, 5)
    if used.mean() > 0.2 and not cut_off(e, seen):
        oval, agree_oval, scale_oval = fit(e, x, y, sigma, True, most, 5)
        if agree_oval.sum() > 1.04 * agree.sum() or scale_oval < 0.75 * scale:
            made, agree = oval, agree_oval
    return None if agree.sum() < max(10.0, 0.4 * len(x)) else made


def cut_off(e: Ellipse, seen: Rays) -> bool:
    """Whether the frame leaves so little of a disk that a circle must do for the start."""
    return bool(seen.inside.mean() < CUT) and e.radius > CUT_RADIUS


def all_within(smooth: F32, e: Ellipse, seen: Rays, light: Light, least: float) -> tuple[Ellipse, Rays, Light] | None:
    """The outline, with the falls away from the Sun that lie beyond it: no light is beyond a limb.

    A disk that is lit nearly head on shows its limb all round, or nearly so, and half of it says little of the radius.

    Args:
        smooth, least: as in `settle`.
        e, seen, light: what was found so far.

    Returns:
        None if there is no such light, or if the rest does not agree with it.
    """
    window = max(4.0, min(BEYOND * e.radius, 60.0))
    for number in range(3):
        seen = rays(smooth, e, window, least)
        d, bright = e.distance(*seen.place.T)[0], lit(seen.theta, light)
        limb = bright | (d > -0.5)
        if number == 0:
            beyond = mostly(seen.good & ~bright & (d > max(1.0, 0.004 * e.radius)), seen.inside & ~bright)
            if beyond.mean() < MUCH:
                return None
            limb = bright | beyond
        seen = seen._replace(good=seen.good & limb)
        found = _follow(e, seen, limb, window)
        if found is None:
            return None
        e, window = found, 4.0
    return (e, seen, Light(light.azimuth, 0.0)) if seen.good.sum() > MOST * seen.inside.sum() else None
