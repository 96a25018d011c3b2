"""Images of any kind as grey values, and how noisy they are."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
CV: Any = cv2
MIN_SIDE = 32
"""Smaller images hold no disk that could be told from a star."""
MAX_PIXELS = 120_000_000
QUANTISATION = 0.29
"""Standard deviation of rounding, 1 / sqrt(12)."""


class Grey(NamedTuple):
    """An image to search."""

    values: F32
    """(rows, columns), in the levels of the input."""
    noise: float
    """Standard deviation of the noise, at least that of rounding [levels]."""
    top: float
    """Where the input saturates [levels]."""


def to_grey(image: NDArray[Any]) -> Grey:
    """Grey values of an image.

    Args:
        image: (rows, columns) or (rows, columns, 1, 3 or 4), colours in the order red, green, blue (alpha is ignored);
            8 or 16 bit unsigned, or floating point in any unit.

    Raises:
        ValueError: if it is not an image, is smaller than 32 pixels or too large, or holds NaN or infinity.
    """
    if image.ndim == 3 and image.shape[2] in (1, 3, 4):
        image = np.ascontiguousarray(image[..., 0] if image.shape[2] == 1 else image[..., :3])
    elif image.ndim != 2:
        raise ValueError(f"image: expected (rows, columns) or (rows, columns, 3), got the shape {image.shape}")
    rows, columns = image.shape[:2]
    if min(rows, columns) < MIN_SIDE:
        raise ValueError(f"image: {columns} x {rows} pixels are too few; at least {MIN_SIDE} x {MIN_SIDE} are needed")
    if rows * columns > MAX_PIXELS:
        raise ValueError(f"image: {columns} x {rows} pixels are too many; crop or reduce it below {MAX_PIXELS} pixels")
    if image.dtype.name not in ("uint8", "uint16") and not np.issubdtype(image.dtype, np.floating):
        raise ValueError(f"image: expected 8 or 16 bit unsigned or floating point values, got {image.dtype}")
    floating = np.issubdtype(image.dtype, np.floating)
    values = image.astype(np.float32)
    if floating and not np.isfinite(values).all():
        raise ValueError("image: it holds NaN or infinite values; replace them")
    if values.ndim == 3:
        values = CV.cvtColor(values, cv2.COLOR_RGB2GRAY)
    step = float(np.ptp(values)) * 1e-4 if floating else 1.0
    top = float(values.max()) if floating else float(np.iinfo(image.dtype).max)
    return Grey(values, max(noise_of(values), QUANTISATION * step, 1e-12), top)


def noise_of(values: F32) -> float:
    """Standard deviation of the noise from second differences (Immerkaer 1996), by their median: edges do not count.

    Where most pixels are equal (a clipped sky), only those that differ are looked at.
    """
    step = max(1, min(values.shape) // 512)
    part = values if step == 1 else values[: 512 * step, : 512 * step]
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6.0
    rough = np.abs(CV.filter2D(part, -1, kernel)[1:-1, 1:-1]).ravel()[::7]
    rough = rough[rough > 0]
    return 0.0 if len(rough) < 100 else float(np.median(rough)) / 0.6745
