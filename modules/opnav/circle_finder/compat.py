"""Circles as Basilisk's houghCircles finds them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64

CV: Any = cv2
THRESHOLD = 15
"""Grey levels up to this are dark."""


def hough_circles(
    image: NDArray[np.uint8],
    blur_px: int,
    canny: float,
    votes: float,
    min_distance_px: float,
    radii_px: tuple[int, int],
    accumulator: float,
    most: int,
) -> F64:
    """Circles of the thresholded image: threshold, box blur, OpenCV's Hough gradient method.

    Args:
        image: grey (rows, columns) or colour (rows, columns, 3), 8 bit.
        blur_px: side of the box.
        canny: upper threshold of the edges.
        votes: least votes.
        min_distance_px: least distance between centres.
        radii_px: limits; 0 and 0 mean any.
        accumulator: cells of the accumulator, pixels for each.
        most: circles at most.

    Returns:
        (n, 4): column, row, radius [px], votes; most votes first.
    """
    grey = image if image.ndim == 2 else CV.cvtColor(image, cv2.COLOR_RGB2GRAY)
    dark = CV.threshold(grey, THRESHOLD, 255, cv2.THRESH_BINARY_INV)[1]
    smooth = CV.blur(dark, (blur_px, blur_px))
    found = CV.HoughCirclesWithAccumulator(
        smooth,
        cv2.HOUGH_GRADIENT,
        accumulator,
        min_distance_px,
        param1=canny,
        param2=votes,
        minRadius=radii_px[0],
        maxRadius=radii_px[1],
    )
    return np.empty((0, 4)) if found is None else np.asarray(found, float).reshape(-1, 4)[:most]
