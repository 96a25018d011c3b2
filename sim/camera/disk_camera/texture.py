"""Textures of bodies: rasters in latitude and longitude, made into cubes of several resolutions; invented ones too.

A cube has six faces, seen from the centre, so that looking a direction up takes no sine and has no pole. Each face
has a frame of one cell, in which neighbouring faces repeat, so that there is no seam.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from messages.base import F64

CV: Any = cv2
NDIMAGE: Any = ndimage
F32 = NDArray[np.float32]
LARGEST, SMALLEST = 1024, 8
"""Cells along an edge of a face."""
PLAIN: F32 = np.ones((6, 3, 3), np.float32)
"""The cube of a body without texture."""


def cubes(raster: NDArray[Any]) -> tuple[F32, ...]:
    """Cubes (6, n + 2, n + 2) of a raster, the finest first, each with half the cells of the one before.

    Args:
        raster: (rows, columns), factors on the brightness, of at least 0: north up, planetocentric latitude from 90 to
            -90 degrees, longitude from -180 degrees at the left edge eastward to 180.
    """
    n = LARGEST
    while n > SMALLEST and 4 * n > raster.shape[1]:
        n //= 2
    sizes = [n >> k for k in range(n.bit_length()) if n >> k >= SMALLEST]
    return tuple(_cube(np.asarray(raster, np.float32), size) for size in sizes)


def _cube(raster: F32, n: int) -> F32:
    rows, columns = 2 * n, 4 * n
    small = CV.resize(raster, (columns, rows), interpolation=cv2.INTER_AREA)
    padded = np.pad(np.hstack([small[:, -1:], small, small[:, :1]]), ((1, 1), (0, 0)), "edge")
    direction = cube_directions(n)
    lon = np.arctan2(direction[..., 1], direction[..., 0])
    lat = np.arctan2(direction[..., 2], np.hypot(direction[..., 0], direction[..., 1]))
    column = ((lon / np.pi + 1.0) * 0.5 * columns + 0.5).astype(np.float32)
    row = ((0.5 - lat / np.pi) * rows + 0.5).astype(np.float32)
    faces = [CV.remap(padded, column[k], row[k], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for k in range(6)]
    return np.stack(faces)


def cube_directions(n: int) -> F64:
    """Directions (6, n + 2, n + 2, 3), body-fixed, of the cells of a cube: faces +x, -x, +y, -y, +z, -z."""
    side = (np.arange(-1, n + 1) + 0.5) * 2.0 / n - 1.0
    b, a = np.meshgrid(side, side, indexing="ij")
    out = np.empty((6, n + 2, n + 2, 3))
    for face in range(6):
        axis = face // 2
        others = [k for k in range(3) if k != axis]
        out[face, ..., axis] = 1.0 - 2.0 * (face % 2)
        out[face, ..., others[0]], out[face, ..., others[1]] = a, b
    return out


def invented(seed: int, contrast: float, rows: int = 512, octaves: int = 6) -> F32:
    """A raster (rows, 2 rows) of light and dark patches of every size, as `cubes` takes it; no seam, no pole.

    Args:
        seed: which patches.
        contrast: standard deviation over the sphere, the mean being 1; nowhere darker than 0.05.
        rows: of the raster.
        octaves: sizes of patches, each half as large as the one before.
    """
    rng = np.random.default_rng(seed)
    lat = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    lon = np.pi * ((np.arange(2 * rows) + 0.5) / rows - 1.0)[None, :]
    place = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat) + 0.0 * lon])
    total = np.zeros((rows, 2 * rows))
    for k in range(octaves):
        lattice = rng.standard_normal((16, 16, 16))
        total += NDIMAGE.map_coordinates(lattice, place * 2.0**k + 8.0, order=1, mode="grid-wrap") / 1.7**k
    weight = np.broadcast_to(np.cos(lat), total.shape)
    total -= np.average(total, weights=weight)
    total *= contrast / np.sqrt(np.average(total * total, weights=weight))
    return np.maximum(1.0 + total, 0.05).astype(np.float32)
