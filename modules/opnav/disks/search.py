"""Disks of planets and moons in an image: proposed, followed, measured, and refused if they are none."""

from __future__ import annotations

import enum
import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.checks import surroundings
from modules.opnav.disks.coarse import CUT, HEAD_ON, Light, Rays, all_within, lit, settle
from modules.opnav.disks.ellipse import Ellipse
from modules.opnav.disks.grey import F32, to_grey
from modules.opnav.disks.limb import Limb, limb_points
from modules.opnav.disks.outline import Outline, outline
from modules.opnav.disks.photometry import View
from modules.opnav.disks.profile import measured
from modules.opnav.disks.propose import Proposal, propose
from modules.opnav.disks.sun import sun_at

CV: Any = cv2
TURN = 2.0 * math.pi
TRIES = 24
"""Proposals that are looked at."""
LEAST_FALL = 3.5
"""Of brightness along a ray at the limb, to the noise of a pixel."""
MIN_SHARE = 0.5
"""Share of the limb that must be seen within 60 degrees of the Sun's azimuth, as far as it is in the image."""
MIN_KEPT = 0.65
"""Share of the measured points that must agree."""
MIN_POINTS = 12
NEAR_PX = 1.5
"""If the outline moves by more than this, the points are measured once more from there."""
FINE_RADIUS, FINE_DEPTH = 40.0, 6.0
"""The full model of the profile is for disks above this radius, with so much light behind the limb [px]."""
SECTOR_PX = 0.008
"""Standard deviation that the model of the profile adds to what the points of a sector share [px]; it
grows where less than 7 px of light lie behind the limb."""
SCATTER_PX = 0.3
SCATTER = 0.004
MAX_SCATTER_PX = 0.7
"""Points may scatter by this and this share of the radius (relief), or by 2.5 times what noise does, up to this."""
MAX_SIGMA = 0.045
"""Largest standard deviation of a radius, to the radius: where a line would do as well, there is no disk."""
BLOOM_PX = 1.0
"""Standard deviation of a saturated limb's place: a Gaussian blur of 0.7 px, four times over, moves it by 0.8 px."""
SATURATED, BLOOM_SHARE, BEHIND_PX = 0.99, 0.2, 3.0
"""Of the top value, for this share of the points, so far behind the limb [px]."""
WHOLE_ARC = math.radians(75.0)
"""Least limb of a disk that the frame does not cut off."""
CUT_SIGMA = 0.12
"""The same for a disk that the frame cuts off."""


class DiskStatus(enum.IntEnum):
    """Why there is no disk."""

    FOUND = 0
    NO_EDGES = 1
    """Nothing stands out from the noise: black, even, or noise alone."""
    NO_DISK = 2
    """There are edges, but no limb."""


class Disk(NamedTuple):
    """A disk and its limb."""

    ellipse: Ellipse
    """The mean of all nearly round ones that would look the same."""
    oval: bool
    """Whether the points say clearly that it is no circle."""
    P: F64
    """(5, 5) covariance of column, row, mean radius [px] and both ovals."""
    limb: Limb
    """The points that agree; their sigma is as large as their scatter says."""
    arc: float
    """Length of the limb that was seen [rad]."""
    rms: float
    """Root mean square distance of the points from the outline [px]."""
    light: Light
    votes: int
    """Edge pixels that proposed it."""


class Options(NamedTuple):
    """How to search; the defaults suit any image."""

    min_radius: float = 8.0
    max_radius: float = 4000.0
    """Limits of the radius [px]."""
    min_arc: float = math.radians(40.0)
    """Least limb that makes a disk [rad]."""
    most: int = 10
    """Disks wanted."""
    max_points: int = 2000
    """Points on a limb at most."""
    sun: Light | None = None
    """Where the Sun stands in the image, if that is known; else the image tells."""
    view: View | None = None
    """The camera and the direction of the Sun, if they are known: the light near the limb is then known much better."""


class Search(NamedTuple):
    """An image and what is the same for all its proposals."""

    values: F32
    smooth: F32
    """Without single bright pixels, and smoothed."""
    noise: float
    black: float
    """Level of what is dark in this image."""
    options: Options
    top: float
    """Where the image saturates."""


DEFAULTS = Options()


def find_disks(image: NDArray[Any], options: Options = DEFAULTS) -> tuple[DiskStatus, list[Disk]]:
    """Find the disks in an image.

    Args:
        image: (rows, columns) or (rows, columns, 1, 3 or 4), 8 or 16 bit or floating point.
        options: how to search.

    Returns:
        Status, and the disks, the one with most limb first. What is not surely a disk is left out.

    Raises:
        ValueError: if it is no image, too small, too large, or holds NaN.
    """
    grey = to_grey(image)
    proposals = propose(grey.values, grey.noise, options.min_radius, options.max_radius)
    if not proposals:
        return DiskStatus.NO_EDGES, []
    smooth = CV.GaussianBlur(CV.medianBlur(grey.values, 3), (0, 0), 0.8)
    black = float(np.percentile(smooth[::7, ::5], 1.0))
    search = Search(grey.values, smooth, grey.noise, black, options, grey.top)
    found: list[Disk] = []
    for p in proposals[:TRIES]:
        if len(found) < options.most and not any(_same(p, d) for d in found):
            disk = measure(search, p)
            if isinstance(disk, Disk) and not any(_same(disk.ellipse, d) for d in found):
                found.append(disk)
    found.sort(key=lambda d: -len(d.limb.x) * d.arc)
    return (DiskStatus.FOUND if found else DiskStatus.NO_DISK), found


def _same(p: Proposal | Ellipse, disk: Disk) -> bool:
    """Whether a circle has its centre in a disk that was found, or the other way round."""
    return math.hypot(p.x - disk.ellipse.x, p.y - disk.ellipse.y) < max(p.radius, disk.ellipse.radius)


def measure(search: Search, proposal: Proposal) -> Disk | str:
    """The disk near a proposed circle, or in words why it is none."""
    options, least = search.options, LEAST_FALL * search.noise
    start = Ellipse(proposal.x, proposal.y, proposal.radius)
    sun = options.sun if options.view is None else sun_at(options.view, start.x, start.y)
    settled = settle(search.smooth, start, least, search.black, sun)
    if settled is None:
        return "no limb along the rays"
    made = _measured(search, *settled, proposal.votes)
    if isinstance(made, str) or sun is not None:
        return made
    wider = all_within(search.smooth, made.ellipse, *settled[1:], least)
    again = made if wider is None else _measured(search, *wider, proposal.votes)
    return made if isinstance(again, str) else again


def _measured(search: Search, e: Ellipse, seen: Rays, light: Light, votes: int) -> Disk | str:
    """The disk along an outline that was followed."""
    options = search.options
    near = seen.good & (np.abs(e.distance(*seen.place.T)[0]) < max(1.5, 0.005 * e.radius))
    expected = seen.inside & lit(seen.theta, light, math.radians(60.0))
    if (near & expected).sum() < MIN_SHARE * max(int(expected.sum()), 1):
        return "gaps in the limb"
    if TURN * near.mean() < 0.8 * options.min_arc:
        return "a short arc"
    made: tuple[Limb, Outline] | None = None
    for _ in range(2):
        if not e.radius <= 2.0 * options.max_radius:  # a line, which would be looked for far beyond the image
            return "a radius outside of the limits"
        azimuths, depths = _usable(search.smooth, e, seen, light)
        limb = limb_points(search.values, search.noise, e, azimuths, depths, options.max_points)
        fitted = None if limb is None or len(limb.x) < MIN_POINTS else outline(e, limb)
        if limb is None or fitted is None:
            return "few points"
        made, before, e = (limb, fitted), e, fitted.ellipse
        if math.hypot(e.x - before.x, e.y - before.y) + abs(e.radius - before.radius) < NEAR_PX:
            break
    assert made is not None
    limb, fitted = made[0].pick(made[1].keep), made[1]
    d, theta = e.distance(limb.x, limb.y)[0], np.arctan2(limb.y - e.y, limb.x - e.x) % TURN
    rms, arc = float(np.sqrt(np.mean(d**2))), len(np.unique((theta / TURN * 72).astype(int))) / 72 * TURN
    blind = (
        1.9 * math.sqrt(limb.blur) * search.noise / float(np.median(limb.step))
    )  # of a blurred step's place in noise
    rough = max(SCATTER_PX + SCATTER * e.radius, min(2.5 * blind, MAX_SCATTER_PX))
    if fitted.keep.mean() < MIN_KEPT or rms > rough:
        return "points that do not agree"
    cut = bool(seen.inside.mean() < CUT)
    most, least = (CUT_SIGMA, options.min_arc) if cut else (MAX_SIGMA, max(options.min_arc, WHOLE_ARC))
    if arc < least or not math.sqrt(fitted.P[2, 2]) < most * e.radius:
        return "too little of a circle"
    if not options.min_radius <= e.radius <= options.max_radius:
        return "a radius outside of the limits"
    if wrong := surroundings(search.smooth, e, search.black, light, arc):
        return wrong
    lit_px = float(np.median(_usable(search.smooth, e, seen, light)[1]))
    if (known := _known(search, e, seen, light, limb)) is not None:
        limb, fitted = known
        e, rms = fitted.ellipse, float(np.sqrt(np.mean(fitted.ellipse.distance(limb.x, limb.y)[0] ** 2)))
        return Disk(e, fitted.oval, fitted.P, limb, arc, rms, light, votes)
    if e.radius > FINE_RADIUS and lit_px > FINE_DEPTH and (again := _finest(search, e, seen, light)) is not None:
        limb, fitted = again[0]._replace(blur=limb.blur), again[1]
        e, rms = fitted.ellipse, float(np.sqrt(np.mean(fitted.ellipse.distance(limb.x, limb.y)[0] ** 2)))
    # What the points of a sector share must not average out in a fit that takes them as independent
    model = np.hypot(limb.common, SECTOR_PX * (7.0 / lit_px) ** 2)
    shared = np.sqrt(np.bincount(limb.sector)[limb.sector]) * model[limb.sector]
    limb = limb._replace(sigma=np.hypot(limb.sigma * fitted.scale, shared))
    return Disk(e, fitted.oval, fitted.P + _bloom(search, e, limb, light), limb, arc, rms, light, votes)


def _bloom(search: Search, e: Ellipse, limb: Limb, light: Light) -> F64:
    """Covariance (5, 5) that saturation adds: where the light behind a limb is cut off, so is half of its height.

    The limb then looks farther out, most where the disk is brightest, so towards the Sun; by how much depends on light
    that is not in the image.
    """
    added = np.zeros((5, 5))
    _, nx, ny = e.distance(limb.x, limb.y)
    rows, columns = search.values.shape
    x = np.clip(np.rint(limb.x - BEHIND_PX * nx).astype(np.int64), 0, columns - 1)
    y = np.clip(np.rint(limb.y - BEHIND_PX * ny).astype(np.int64), 0, rows - 1)
    if (search.values[y, x] >= SATURATED * search.top).mean() > BLOOM_SHARE:
        way = np.array([math.cos(light.azimuth), math.sin(light.azimuth)])
        added[:2, :2] = BLOOM_PX**2 * (np.outer(way, way) if light.contrast >= HEAD_ON else np.eye(2))
        added[2, 2] = BLOOM_PX**2
    return added


def _known(search: Search, e: Ellipse, seen: Rays, light: Light, limb: Limb) -> tuple[Limb, Outline] | None:
    """Points by the light that Sun and camera let expect; None if these are not known, or the points do not fit."""
    if search.options.view is None:
        return None
    azimuths, depths = _usable(search.smooth, e, seen, light)
    image, most = (search.values, search.noise, search.top), search.options.max_points
    found = measured(*image, e, azimuths, depths, most, search.options.view, limb)
    fitted = None if found is None or len(found.x) < MIN_POINTS else outline(e, found)
    if found is None or fitted is None or fitted.keep.mean() < MIN_KEPT:
        return None
    return found.pick(fitted.keep), fitted


def _finest(search: Search, e: Ellipse, seen: Rays, light: Light) -> tuple[Limb, Outline] | None:
    """Points by the full model of the profile, which is too pliant to tell what is a limb; None if they are worse."""
    azimuths, depths = _usable(search.smooth, e, seen, light)
    limb = limb_points(search.values, search.noise, e, azimuths, depths, search.options.max_points, fine=True)
    fitted = None if limb is None or len(limb.x) < MIN_POINTS else outline(e, limb)
    if limb is None or fitted is None or fitted.keep.mean() < MIN_KEPT:
        return None
    return limb.pick(fitted.keep), fitted


def _usable(smooth: F32, e: Ellipse, seen: Rays, light: Light) -> tuple[NDArray[np.bool_], F64]:
    """Azimuths that are lit limb in the image, and how deep the light goes there [px]."""
    reach, nx, ny = e.at(seen.theta)
    depth = np.arange(-2.0, 12.01, 0.5)
    x = (e.x + reach * np.cos(seen.theta))[:, None] - nx[:, None] * depth
    y = (e.y + reach * np.sin(seen.theta))[:, None] - ny[:, None] * depth
    profile = CV.remap(
        smooth, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    above = profile - profile[:, :1]
    ended = (above < 0.5 * np.maximum.accumulate(above, axis=1)) & (depth > 1.5)
    deep = np.where(ended.any(axis=1), depth[np.argmax(ended, axis=1)], 12.0)
    near = seen.good & (np.abs(e.distance(*seen.place.T)[0]) < 3.0)
    return near & lit(seen.theta, light), np.clip(0.7 * deep, 2.5, 7.0)
