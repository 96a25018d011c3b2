"""Centre of brightness of the brightest connected patch of an image."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64

FOUND, NOTHING, AT_EDGE, TOO_SMALL_IMAGE = 0, 1, 12, 13


class Light(NamedTuple):
    """What was found; numbers are NaN if ``status`` is not `FOUND`."""

    status: int
    center_px: F64
    """Column, row (2,) [px]."""
    P_px: F64
    """Covariance (2, 2) [px^2]."""
    area_px: float
    """Area of the lit part [px^2]."""


def nothing(status: int) -> Light:
    """Why there is no centre."""
    return Light(status, np.full(2, np.nan), np.full((2, 2), np.nan), math.nan)


def centre_of_light(image: NDArray[np.uint8], contrast: float, blur: int, min_area: float, floor: float) -> Light:
    """Find the centre of brightness.

    Background and noise are those of the border of the image (median, and median deviation). Lit is what is brighter
    by ``contrast`` and by 5 standard deviations after a box blur; of the connected patches the one with the most light
    counts. Weights are grey levels above the background, not blurred, over the patch and a margin for faint edges.

    Args:
        image: grey (H, W) or colour (H, W, 3).
        contrast: least grey levels above the background.
        blur: width of the box blur [px], odd.
        min_area: smallest lit area [px^2].
        floor: standard deviation that each coordinate has in any case [px].
    """
    grey = (image if image.ndim == 2 else image.mean(axis=2)).astype(np.float32)
    if min(grey.shape) < blur + 2:
        return nothing(TOO_SMALL_IMAGE)
    border = np.concatenate([grey[0], grey[-1], grey[1:-1, 0], grey[1:-1, -1]])
    background = float(np.median(border))
    sigma = max(1.4826 * float(np.median(np.abs(border - background))), 1.0 / math.sqrt(12.0))
    level = background + max(contrast, 5.0 * sigma / blur)
    smooth = cv2.blur(grey, (blur, blur), borderType=cv2.BORDER_REPLICATE)
    count, labels = cv2.connectedComponents((smooth > level).astype(np.uint8))
    if count < 2:
        return nothing(NOTHING)
    light: Any = np.bincount(labels.ravel(), weights=(grey - background).ravel(), minlength=count)
    patch = labels == 1 + int(np.argmax(light[1:]))
    # a blurred edge is where half of the light is left, a terminator fades: a quarter is between
    quarter = 0.25 * float(np.percentile(grey[patch] - background, 90.0))
    area = float(np.count_nonzero(patch & (grey > background + max(quarter, 3.0 * sigma))))
    if area < min_area:
        return nothing(NOTHING)
    if patch[0].any() or patch[-1].any() or patch[:, 0].any() or patch[:, -1].any():
        return nothing(AT_EDGE)
    near = cv2.dilate(patch.astype(np.uint8), np.ones((blur, blur), np.uint8)) > 0
    near &= patch | (labels == 0)
    rows, columns = np.nonzero(near)
    weight = (grey[rows, columns] - background).astype(np.float64)
    total = float(weight.sum())
    x, y = float(weight @ columns) / total, float(weight @ rows) / total
    arm = np.stack([columns - x, rows - y]) / total
    return Light(FOUND, np.array([x, y]), sigma**2 * (arm @ arm.T) + floor**2 * np.eye(2), area)
