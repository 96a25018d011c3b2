"""Chips of the rendered view, looked for in the photo by normalised correlation of their edges."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from messages.base import F64
from modules.opnav.landmark_finder.render import STEP, View

HALF = 20
"""Chips are 2 HALF + 1 pixels wide."""
MIN_CONTRAST = 2.0
"""Least standard deviation of a chip of the map, grey levels: the open sea is flatter."""
EDGE_BLUR_PX = 1.0
"""Standard deviation of the smoothing before the gradient: noise of the photo, and blocks of a compressed map."""
EDGE_GAIN = 10.0
WORKERS = os.cpu_count() or 1
CV: Any = cv2


class Matches(NamedTuple):
    """Chips found."""

    rendered: NDArray[np.int64]
    """(n, 2) column and row of each chip's middle in the rendered view."""
    seen: F64
    """(n, 2) column and row of the match in the photo."""
    score: F64
    """(n,) normalised correlation at the match."""

    def pick(self, which: NDArray[Any]) -> Matches:
        """The matches that an index or mask array names."""
        return Matches(self.rendered[which], self.seen[which], self.score[which])


def edges(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Square root of the gradient's magnitude, as an image of the same size.

    A map and a photo of another season agree in where the ground changes, less in which side is the brighter one; on
    the ten shipped photos this left half the residuals of a correlation of the grey levels. The square root keeps a
    few strong edges (snow, cloud) from outweighing the rest.
    """
    smooth = CV.GaussianBlur(grey.astype(np.float32), (0, 0), EDGE_BLUR_PX)
    gradient = np.hypot(CV.Sobel(smooth, -1, 1, 0), CV.Sobel(smooth, -1, 0, 1))
    return np.clip(np.rint(EDGE_GAIN * np.sqrt(gradient)), 0.0, 255.0).astype(np.uint8)


def chip_centres(view: View, spacing: int) -> NDArray[np.int64]:
    """Middles (n, 2) (column, row) of chips that lie wholly on the map and have contrast, on a regular grid."""
    rows, columns = view.mask.shape
    width = 2 * HALF + 1
    start = -(-HALF // STEP) * STEP
    grid = np.mgrid[start : rows - HALF : spacing, start : columns - HALF : spacing]
    row, column = grid[0].ravel(), grid[1].ravel()
    whole = CV.erode(view.mask.astype(np.uint8), np.ones((width, width), np.uint8))
    grey = view.image.astype(np.float32)
    mean, square = CV.boxFilter(grey, -1, (width, width)), CV.sqrBoxFilter(grey, -1, (width, width))
    deviation = np.sqrt(np.maximum(square - mean * mean, 0.0))
    good = (whole[row, column] > 0) & (deviation[row, column] >= MIN_CONTRAST)
    return np.column_stack([column[good], row[good]]).astype(np.int64)


def match_chips(
    chips: NDArray[np.uint8],
    photo: NDArray[np.uint8],
    centres: NDArray[np.int64],
    window: int,
    min_score: float,
    min_lead: float,
) -> Matches:
    """Look for chips within ``window`` pixels of where they are expected.

    A match counts if its correlation is at least ``min_score``, the next peak is lower by ``min_lead``, and it does not
    lie at the edge of the window. Sub-pixel by a parabola through the neighbours.

    Args:
        chips: the rendered view (rows, columns); its edges are what is wanted here.
        photo: the same of the photo, same size.
        centres: (n, 2) column and row of the chips.
        window: half-width of the search [px].
        min_score: least normalised correlation.
        min_lead: least lead over the next peak.
    """
    places = centres.tolist()
    cut = [chips[row - HALF : row + HALF + 1, column - HALF : column + HALF + 1] for column, row in places]
    found = match_templates(cut, photo, centres, window, min_score, min_lead)
    good = np.isfinite(found[:, 0])
    seen: F64 = centres[good].astype(np.float64) + found[good, :2] - window
    rows, columns = photo.shape
    inside = (seen >= HALF).all(axis=1) & (seen[:, 0] < columns - HALF) & (seen[:, 1] < rows - HALF)
    return Matches(centres[good][inside], seen[inside], found[good, 2][inside])


def match_templates(
    templates: Sequence[NDArray[np.uint8]] | NDArray[np.uint8],
    photo: NDArray[np.uint8],
    centres: NDArray[np.int64],
    window: int,
    min_score: float,
    min_lead: float,
) -> F64:
    """Look for templates near where they are expected, each on its own.

    Args:
        templates: n square pictures of one size, an odd number of pixels wide.
        photo: where to look (rows, columns).
        centres: (n, 2) column and row at which the middle of each template is expected.
        window: half-width of the search [px].
        min_score: least normalised correlation.
        min_lead: least lead over the next peak.

    Returns:
        (n, 3) column and row of the peak in the window, whose middle is (window, window), and its height; NaN if the
        peak is too low, not alone, or at the edge of the window.
    """
    padded = CV.copyMakeBorder(photo, window, window, window, window, cv2.BORDER_CONSTANT, value=0)
    found, places = np.full((len(centres), 3), np.nan), centres.tolist()

    def look(n: int) -> None:
        half = len(templates[n]) // 2
        column, row = places[n]
        top, left = row - half, column - half
        area = padded[top : row + half + 2 * window + 1, left : column + half + 2 * window + 1]
        peak(CV.matchTemplate(area, templates[n], cv2.TM_CCOEFF_NORMED), min_score, min_lead, found[n])

    def share(first: int) -> None:
        for n in range(first, len(places), WORKERS):
            look(n)

    # Each template has its own row of the answer, so the number of threads changes nothing but the time
    with ThreadPoolExecutor(WORKERS) as pool:
        list(pool.map(share, range(WORKERS)))
    return found


@compiled
def peak(surface: NDArray[np.float32], min_score: float, min_lead: float, out: F64) -> None:
    """Column, row (sub-pixel) and height of a surface's single peak, into ``out`` (3,); untouched if there is none."""
    rows, columns = surface.shape
    best, i, j = -2.0, 0, 0
    for a in range(rows):
        for b in range(columns):
            if surface[a, b] > best:
                best, i, j = surface[a, b], a, b
    if best < min_score or i == 0 or j == 0 or i == rows - 1 or j == columns - 1:
        return
    for a in range(rows):  # another local maximum, outside the slope of this one
        for b in range(columns):
            far = abs(a - i) > 2 or abs(b - j) > 2
            if far and surface[a, b] > best - min_lead and _is_peak(surface, a, b):
                return
    left, right = surface[i, j - 1], surface[i, j + 1]
    up, down = surface[i - 1, j], surface[i + 1, j]
    bend_x, bend_y = 2.0 * best - left - right, 2.0 * best - up - down
    if bend_x <= 0.0 or bend_y <= 0.0:
        return
    out[0] = j + 0.5 * (right - left) / bend_x
    out[1] = i + 0.5 * (down - up) / bend_y
    out[2] = best


@compiled
def _is_peak(surface: NDArray[np.float32], a: int, b: int) -> bool:
    """Whether no neighbour is higher."""
    rows, columns = surface.shape
    here = surface[a, b]
    for c in range(max(a - 1, 0), min(a + 2, rows)):
        for d in range(max(b - 1, 0), min(b + 2, columns)):
            if surface[c, d] > here:
                return False
    return True
