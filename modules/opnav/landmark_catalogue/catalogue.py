"""What a catalogue holds, and how it is asked."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import spatial

from fsw.math.camera import undistort
from fsw.math.geodesy import A, ecef_from_geodetic, ray_to_height
from messages.base import F64
from modules.opnav.landmark_catalogue.kernel import see

CHIP = 64
"""Rows and columns of a chip."""
SPATIAL: Any = spatial


class CatalogueError(ValueError):
    """A catalogue that cannot be made, read or asked; one sentence that says which, why, and what to do."""


class Landmarks(NamedTuple):
    """Places with chips; n of them."""

    chips: NDArray[np.uint8]
    """(n, CHIP, CHIP) grey; row 0 north, column 0 west, the place in the middle, between four pixels."""
    gsd: F64
    """(n,) size of a chip's pixel on the ground [m]."""
    lat: F64
    """(n,) geodetic latitude [rad]."""
    lon: F64
    """(n,) longitude [rad]."""
    h: F64
    """(n,) height [m], as the height file counts it."""
    slope: F64
    """(n, 2) rise of the ground over the chip towards east and north [m/m]."""
    r_LE_E: F64
    """(n, 3) Earth-fixed [m]."""
    sigma: F64
    """(n, 2) Cramer-Rao bound of a match in the best and the worst direction, pixels per grey level of white noise."""


class MapFeatures(NamedTuple):
    """Features of the map for a cold start; m of them."""

    r_FE_E: F64
    """(m, 3) Earth-fixed [m]."""
    gsd: F64
    """(m,) pixel of the picture in which each was found [m]."""
    words: NDArray[Any]
    """(m, d) descriptors, as `modules.opnav.features` gives them: float32 or uint8."""


class Seen(NamedTuple):
    """Landmarks in a view; k of them."""

    mark: NDArray[np.int64]
    """(k,) of the landmarks in the catalogue."""
    pixel: F64
    """(k, 2) predicted column and row [px]."""
    zoom: F64
    """(k,) pixels of the image to one of the chip."""


@dataclasses.dataclass(frozen=True, eq=False)
class Catalogue:
    """Landmarks and features of a map. Immutable; made by `build_catalogue` or `read_catalogue`."""

    maps: tuple[str, ...]
    """Names of the files it was made from."""
    gsd: float
    """Size of a pixel of the finest chips [m]."""
    detector: str
    """Whose descriptors, a name in `modules.opnav.features.DETECTORS`."""
    landmarks: Landmarks
    features: MapFeatures

    def __len__(self) -> int:
        """Number of landmarks."""
        return len(self.landmarks.lat)

    @functools.cached_property
    def _trees(self) -> tuple[Any, Any]:
        return SPATIAL.cKDTree(self.landmarks.r_LE_E), SPATIAL.cKDTree(self.features.r_FE_E)

    def near(self, r_E: F64, radius: float) -> NDArray[np.int64]:
        """Landmarks within a distance [m] of a point (3,) [m], Earth-fixed, in ascending order."""
        return np.sort(np.array(self._trees[0].query_ball_point(r_E, radius), np.int64))

    def features_near(self, r_E: F64, radius: float) -> NDArray[np.int64]:
        """Features likewise."""
        return np.sort(np.array(self._trees[1].query_ball_point(r_E, radius), np.int64))

    def inside(self, polygon: F64) -> NDArray[np.int64]:
        """Landmarks inside a polygon on the ground, also across longitude 180 and over a pole.

        Edges are great circles (on the unit sphere of geodetic normals). The polygon must fit into a hemisphere.

        Args:
            polygon: latitude and longitude (k, 2) [rad] of its corners, in order.

        Raises:
            CatalogueError: if there are fewer than three corners, one is not finite, or they span a hemisphere.
        """
        polygon = np.asarray(polygon, float)
        if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
            raise CatalogueError(f"polygon: expected three or more finite corners (k, 2), got {polygon.tolist()}")
        corner, place = _normals(polygon[:, 0], polygon[:, 1]), _normals(self.landmarks.lat, self.landmarks.lon)
        middle = corner.sum(axis=0)
        length = float(np.linalg.norm(middle))
        middle = middle / max(length, 1e-12)
        if length < 1e-6 or (corner @ middle < 0.02).any():
            raise CatalogueError("polygon: it spans more than a hemisphere; ask for parts of it")
        side = np.linalg.svd(middle[None])[2][1:]  # gnomonic plane: great circles are straight
        front = place @ middle > 0.02
        ring, flat = corner @ side.T / (corner @ middle)[:, None], place[front] @ side.T
        flat = flat / (place[front] @ middle)[:, None]
        hit = np.zeros(len(flat), np.bool_)
        for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            crosses = (y0 > flat[:, 1]) != (y1 > flat[:, 1])
            if crosses.any():
                hit ^= crosses & (flat[:, 0] < x0 + (flat[:, 1] - y0) * (x1 - x0) / (y1 - y0))
        return np.flatnonzero(front)[hit]

    def in_view(self, lens: F64, shape: tuple[int, int], r_CE_E: F64, dcm_CE: F64, margin_px: float) -> Seen:
        """Landmarks that a camera sees.

        Args:
            lens: lens vector (11,).
            shape: rows and columns of the image.
            r_CE_E: position of the camera, Earth-fixed (3,) [m].
            dcm_CE: maps Earth-fixed to camera components (3, 3).
            margin_px: least distance from the image's edge; negative takes in what is outside.
        """
        middle, radius = ground_circle(lens, shape, r_CE_E, dcm_CE, margin_px)
        index = self.near(middle, radius)
        marks, seen = self.landmarks, np.empty((len(index), 3))
        places = marks.r_LE_E[index], marks.lat[index], marks.lon[index], marks.gsd[index]
        see(lens, np.ascontiguousarray(r_CE_E, float), np.ascontiguousarray(dcm_CE, float), *places, seen)
        rows, columns = shape
        with np.errstate(invalid="ignore"):
            inside = (seen[:, :2] >= margin_px).all(axis=1)
            inside &= (seen[:, 0] <= columns - 1.0 - margin_px) & (seen[:, 1] <= rows - 1.0 - margin_px)
        return Seen(index[inside], seen[inside, :2], seen[inside, 2])


def ground_circle(lens: F64, shape: tuple[int, int], r_CE_E: F64, dcm_CE: F64, margin_px: float) -> tuple[F64, float]:
    """A ball (centre (3,), radius [m]) around all ground in view; up to the horizon if a corner misses the Earth."""
    rows, columns = shape
    ends_x, ends_y = ([margin_px, 0.5 * (n - 1.0), n - 1.0 - margin_px] for n in (columns, rows))
    pixel = np.array([[x, y] for x in ends_x for y in ends_y])
    tangents = np.empty((9, 2))
    undistort(lens, pixel, tangents)
    rays = np.column_stack([tangents, np.ones(9)])
    rays = rays / np.linalg.norm(rays, axis=1)[:, None] @ dcm_CE
    cx, cy, cz = (float(c) for c in r_CE_E)
    ground = np.full((9, 3), np.nan)
    for k, (dx, dy, dz) in enumerate(rays.tolist()):
        lat, lon, distance = ray_to_height(cx, cy, cz, dx, dy, dz, 0.0)
        if distance > 0.0:
            ground[k] = ecef_from_geodetic(lat, lon, 0.0)
    if not np.isfinite(ground).all():
        return np.asarray(r_CE_E, float), float(np.sqrt(max(r_CE_E @ r_CE_E - (0.99 * A) ** 2, 0.0)))
    return ground[4], 1.05 * float(np.linalg.norm(ground - ground[4], axis=1).max()) + 2e4


def _normals(lat: F64, lon: F64) -> F64:
    return np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
