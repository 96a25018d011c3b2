"""How points are spread over an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from messages.base import F64

COLUMNS, ROWS = 6, 4
"""The grid over the image in which landmarks are counted."""


def cell_of(pixel: F64, shape: tuple[int, int], columns: int = COLUMNS, rows: int = ROWS) -> NDArray[np.int64]:
    """Number (n,) of the grid cell in which each pixel (n, 2) lies; the image has ``shape`` (rows, columns)."""
    column = np.clip((pixel[:, 0] + 0.5) * columns / shape[1], 0, columns - 1).astype(np.int64)
    row = np.clip((pixel[:, 1] + 0.5) * rows / shape[0], 0, rows - 1).astype(np.int64)
    return row * columns + column


def cells_hit(pixel: F64, shape: tuple[int, int]) -> int:
    """In how many of the 6 x 4 cells of the image there is a pixel."""
    return len(np.unique(cell_of(pixel, shape)))


def evenly(pixel: F64, score: F64, shape: tuple[int, int], most: int) -> NDArray[np.int64]:
    """Indices of at most ``most`` points, spread over the image: first the best of each small cell, and so on."""
    if len(pixel) <= most:
        return np.arange(len(pixel))
    cell = cell_of(pixel, shape, 4 * COLUMNS, 4 * ROWS)
    order = np.lexsort((-score, cell))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(cell[order], cell[order])
    return np.sort(np.lexsort((-score, rank))[:most])
