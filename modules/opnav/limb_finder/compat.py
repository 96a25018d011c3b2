"""Edges as Basilisk's limbFinding finds them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from messages.opnav import MAX_LIMB

CV: Any = cv2


def canny_points(image: NDArray[np.uint8], blur_px: int, low: float, high: float, least: int) -> F64:
    """Edge pixels in raster order, lit limb and terminator alike: Gaussian blur, Canny.

    Args:
        image: grey (rows, columns) or colour (rows, columns, 3), 8 bit.
        blur_px: side of the kernel, odd; its standard deviation is 1 px.
        low, high: thresholds of the edges.
        least: this many pixels or fewer are no limb.

    Returns:
        (n, 2) column and row, the first 2000.
    """
    grey = image if image.ndim == 2 else CV.cvtColor(image, cv2.COLOR_RGB2GRAY)
    smooth = CV.GaussianBlur(grey, (blur_px, blur_px), 1)
    edges = CV.Canny(smooth, low, high, apertureSize=3, L2gradient=True)
    points = np.argwhere(edges)[:, ::-1]
    return points[:MAX_LIMB].astype(float) if len(points) > least else np.empty((0, 2))
