"""A map at many pixels at once: OpenCV samples whole cells, level by level, what is left is sampled pixel by pixel."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from sim.camera.earth_camera.cells import cell_levels, mix_cells
from sim.camera.earth_camera.kernel import F32, U8, U16
from sim.camera.earth_camera.layers import View, Window

CV: Any = cv2


def origin(view: View, first: int, last: int) -> tuple[int, int] | None:
    """A pixel of a map near what rows of cells see of it, one that all levels have in common; None if they do not.

    Args:
        view: the map.
        first: row of cells.
        last: the row after the last one.
    """
    window = view.window
    at = view.at[first : last + 1].reshape(-1, 2)
    at = at[np.isfinite(at[:, 0])]
    if not len(at):
        return None
    raster = 2 ** (len(window.levels) - 1)
    x, y = (
        int(min(max(float(low), 0.0), size - 1.0)) // raster * raster
        for low, size in zip(at.min(axis=0), (window.levels[0, 2], window.levels[0, 1]), strict=True)
    )
    return x, y


def sample_cells(
    view: View, corner: tuple[int, int], x: F32, y: F32, first: int, left: int, use: U8, seen: U16, fresh: bool
) -> None:
    """Put the samples of cells into a band.

    Args:
        view: the map.
        corner: as of `origin`.
        x: columns of the map at the pixels (rows, columns), relative to it.
        y: rows likewise.
        first: row of cells.
        left: column of cells.
        use: the cells that are wanted.
        seen: in and out (rows, columns, 4), 0 to FULL.
        fresh: nothing in it is of value yet.
    """
    window, rows = view.window, len(x)
    top = len(window.levels) - 1
    weight, wanted = np.empty((top + 1, *use.shape), np.float32), np.empty(top + 1, np.uint8)
    cell_levels(view.prints, first, left, top, use, weight, wanted)
    for level in np.flatnonzero(wanted).tolist():
        if fresh:
            _remap(window, level, corner, x, y, seen)
            fresh = False
        else:
            one = _remap(window, level, corner, x, y, None)
            mix_cells(one.reshape(rows, -1), weight[level], seen.reshape(rows, -1))


def _remap(window: Window, level: int, corner: tuple[int, int], x: F32, y: F32, out: U16 | None) -> U16:
    """One level of a map at places of level 0."""
    start, rows, columns = window.levels[level].tolist()
    picture = window.pixels[start : start + rows * columns].reshape(rows, columns, 4)
    picture = picture[corner[1] >> level :, corner[0] >> level :]
    if level > 0:
        size, half = np.float32(0.5**level), np.float32(0.5)
        x, y = (x + half) * size - half, (y + half) * size - half
    return CV.remap(picture, x, y, cv2.INTER_LINEAR, out, cv2.BORDER_REPLICATE)
