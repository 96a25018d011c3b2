"""A map at many pixels at once: OpenCV samples whole cells, level by level, what is left is sampled pixel by pixel."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.camera.earth_camera.cells import cell_levels, mix_cells, nearest_corner
from sim.camera.earth_camera.kernel import F32, U8, U16
from sim.camera.earth_camera.layers import View, Window

CV: Any = cv2


class Desk:
    """Arrays that a thread uses again and again: fresh memory costs more time than what is done in it."""

    def __init__(self) -> None:
        """Nothing is held yet."""
        self._held: dict[str, NDArray[Any]] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """An array of any contents, valid until the next call with this name."""
        size = math.prod(shape)
        if name not in self._held or self._held[name].size < size:
            self._held[name] = np.empty(size, dtype)
        return self._held[name][:size].reshape(shape)


def origin(view: View, first: int, last: int) -> tuple[int, int] | None:
    """A pixel of a map near what rows of cells see of it, one that all levels have in common; None if they do not.

    Args:
        view: the map.
        first: row of cells.
        last: the row after the last one.
    """
    levels = view.window.levels
    rows, columns = levels[0, 1:].tolist()
    x, y = nearest_corner(view.at, first, last, 2 ** (len(levels) - 1), rows, columns)
    return None if x < 0 else (x, y)


def sample_cells(
    view: View,
    corner: tuple[int, int],
    x: F32,
    y: F32,
    first: int,
    left: int,
    use: U8,
    seen: U16,
    fresh: bool,
    desk: Desk,
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
        desk: of the thread.
    """
    window, rows = view.window, len(x)
    top = len(window.levels) - 1
    weight, wanted = np.empty((top + 1, *use.shape), np.float32), np.empty(top + 1, np.uint8)
    cell_levels(view.prints, first, left, top, use, weight, wanted)
    for level in np.flatnonzero(wanted).tolist():
        if fresh:
            _remap(window, level, corner, x, y, seen, desk)
            fresh = False
        else:
            one = _remap(window, level, corner, x, y, desk.array("one", seen.shape, np.uint16), desk)
            mix_cells(one.reshape(rows, -1), weight[level], seen.reshape(rows, -1))


def _remap(window: Window, level: int, corner: tuple[int, int], x: F32, y: F32, out: U16, desk: Desk) -> U16:
    """One level of a map at places of level 0."""
    start, rows, columns = window.levels[level].tolist()
    picture = window.pixels[start : start + rows * columns].reshape(rows, columns, 4)
    picture = picture[corner[1] >> level :, corner[0] >> level :]
    if level > 0:
        size = 0.5**level
        at = desk.array("at level", (2, *x.shape), np.float32)
        x, y = (CV.addWeighted(a, size, a, 0.0, 0.5 * size - 0.5, b) for a, b in zip((x, y), at, strict=True))
    return CV.remap(picture, x, y, cv2.INTER_LINEAR, out, cv2.BORDER_REPLICATE)
