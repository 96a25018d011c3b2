"""SURF: speeded-up robust features (Bay, Ess, Tuytelaars and Van Gool 2008, Comp. Vision Image Understanding 110).

The image is summed once (integral image); box filters of any size then cost the same. A feature is a maximum over
place and scale of the determinant of the Hessian by boxes, Dxx Dyy - (0.9 Dxy)^2; its orientation is that of the
strongest Haar responses in a sector of 60 degrees; its descriptor is 4 x 4 sums of (dx, dy, |dx|, |dy|) in a square of
20 scales turned to it: 64 numbers of unit length. OpenCV's wheels have no SURF, so it is written here.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.features.surf_kernel import WORD, describe, hessian, maxima, orient

CV: Any = cv2
WORKERS = os.cpu_count() or 1
OCTAVES = ((9, 15, 21, 27), (15, 27, 39, 51), (27, 51, 75, 99), (51, 99, 147, 195))
"""Side of the filters [px] of the four layers of each octave; each octave is sampled half as densely as the last."""
THRESHOLD = 1e-4
"""Least determinant, for grey levels from 0 to 1."""
SIGMA_PER_SIDE = 1.2 / 9.0
"""The 9 x 9 filter stands for a Gaussian of 1.2 pixels."""


def surf(
    grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, limit: int
) -> tuple[F64, F64, F64, F64, NDArray[np.float32]]:
    """Features of a grey image.

    Args:
        grey: (rows, columns).
        mask: (rows, columns), 0 where no features are wanted; or None.
        limit: most features; the strongest are kept.

    Returns:
        Places (n, 2) [px], sizes (n,) [px], angles (n,) [rad], determinants (n,), descriptors (n, 64).
    """
    total: F64 = CV.integral(grey, sdepth=cv2.CV_64F)
    with ThreadPoolExecutor(WORKERS) as pool:
        layers = _layers(total, pool)
        found = np.vstack([_octave(layers, octave) for octave in range(len(OCTAVES))])
        if mask is not None:
            column, row = np.rint(found[:, :2]).astype(np.int64).T
            found = found[mask[row.clip(0, grey.shape[0] - 1), column.clip(0, grey.shape[1] - 1)] > 0]
        found = found[np.argsort(-found[:, 3], kind="stable")[:limit]]
        angle, words = np.empty(len(found)), np.empty((len(found), WORD), np.float32)

        def share(first: int) -> None:
            for n in range(first, len(found), WORKERS):
                x, y, size = found[n, 0], found[n, 1], found[n, 2]
                angle[n] = orient(total, x, y, size)
                describe(total, x, y, size, angle[n], words[n])

        list(pool.map(share, range(WORKERS)))
    return found[:, :2].copy(), found[:, 2].copy(), angle, found[:, 3].copy(), words


def _layers(total: F64, pool: ThreadPoolExecutor) -> dict[tuple[int, int], NDArray[np.float32]]:
    """Determinants for each filter side and sampling step."""
    rows, columns = total.shape[0] - 1, total.shape[1] - 1
    wanted = [(side, 2**octave) for octave, sides in enumerate(OCTAVES) for side in sides]
    layers = {(side, step): np.zeros((-(-rows // step), -(-columns // step)), np.float32) for side, step in wanted}
    jobs = [(side, step, band) for side, step in wanted for band in range(WORKERS)]

    def fill(job: tuple[int, int, int]) -> None:
        side, step, band = job
        layer = layers[side, step]
        hessian(total, side, step, len(layer) * band // WORKERS, len(layer) * (band + 1) // WORKERS, layer)

    list(pool.map(fill, jobs))
    return layers


def _octave(layers: dict[tuple[int, int], NDArray[np.float32]], octave: int) -> F64:
    """Maxima (n, 4) of one octave: column, row [px], size [px], determinant."""
    step, sides = 2**octave, OCTAVES[octave]
    parts: list[F64] = [np.empty((0, 4))]
    for low, middle, high in zip(sides, sides[1:], sides[2:], strict=False):
        trio = layers[low, step], layers[middle, step], layers[high, step]
        out = np.empty((trio[0].size // 4 + 1, 4))
        n = maxima(*trio, middle, high - middle, step, THRESHOLD, out)
        out[:n, 2] *= SIGMA_PER_SIDE
        parts.append(out[:n])
    return np.vstack(parts)
