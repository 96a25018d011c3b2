"""A made-up region with relief, its map as files, and photos of it by a renderer of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import erfa
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import Affine
from scipy.interpolate import LinearNDInterpolator

from messages.base import F64

CV: Any = cv2
ERFA: Any = erfa
RASTERIO: Any = rasterio
LAT, LON = 36.0, 52.0
"""Middle of the region [deg]."""


class Region(NamedTuple):
    """Texture and heights on one geographic grid."""

    texture: NDArray[np.uint8]
    heights: F64
    lat_deg: F64
    lon_deg: F64
    pixel_deg: float


class Shot(NamedTuple):
    """A camera in the sky."""

    k: F64
    distortion: F64
    shape: tuple[int, int]
    r_CE_E: F64
    dcm_CE: F64


def region(pixels: int = 480, pixel_deg: float = 0.013, relief: float = 2500.0) -> Region:
    rng = np.random.default_rng(11)
    noise = rng.normal(size=(pixels, pixels))
    fine, broad = CV.GaussianBlur(noise, (0, 0), 1.6), CV.GaussianBlur(noise, (0, 0), 12.0)
    texture = np.clip(120.0 + 45.0 * fine / fine.std() + 20.0 * broad / broad.std(), 0, 255).astype(np.uint8)
    hills = CV.GaussianBlur(rng.normal(size=(pixels, pixels)), (0, 0), 15.0)
    heights = relief * (hills - hills.min()) / np.ptp(hills)
    offset: F64 = (np.arange(pixels, dtype=np.float64) + 0.5 - pixels / 2) * pixel_deg
    return Region(
        texture, heights, np.asarray(LAT - offset, np.float64), np.asarray(LON + offset, np.float64), pixel_deg
    )


def write_map(path: Path, band: NDArray[Any], ground: Region) -> Path:
    left, top = ground.lon_deg[0] - ground.pixel_deg / 2, ground.lat_deg[0] + ground.pixel_deg / 2
    transform = Affine(ground.pixel_deg, 0.0, left, 0.0, -ground.pixel_deg, top)
    options = {"driver": "GTiff", "height": band.shape[0], "width": band.shape[1], "count": 1, "dtype": band.dtype}
    with RASTERIO.open(path, "w", crs="EPSG:4326", transform=transform, **options) as out:
        out.write(band, 1)
    return path


def looking_down(tilt: tuple[float, float, float] = (0.05, -0.03, 0.4), shape: tuple[int, int] = (240, 320)) -> Shot:
    """A camera 420 km above the middle of the region, turned from nadir by a rotation vector [rad]."""
    r = np.array(ERFA.gd2gc(1, np.radians(LON), np.radians(LAT), 420e3))
    down = -r / np.linalg.norm(r)
    right = np.cross(down, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    nadir = np.array([right, np.cross(down, right), down])
    turn: F64 = CV.Rodrigues(np.array(tilt))[0].T
    focal = 0.8 * shape[1]
    k = np.array([[focal, 0.0, (shape[1] - 1) / 2 + 2.0], [0.0, focal, (shape[0] - 1) / 2 - 1.0], [0.0, 0.0, 1.0]])
    return Shot(k, np.array([0.03, -0.02, 0.001, -0.001, 0.0]), shape, r, turn @ nadir)


def positions(lat_deg: Any, lon_deg: Any, h: Any) -> F64:
    return np.asarray(ERFA.gd2gc(1, np.radians(lon_deg), np.radians(lat_deg), h))


def pixels_of(shot: Shot, r_LE_E: F64) -> F64:
    """Pixels (n, 2) of Earth-fixed points, by OpenCV."""
    rotation = CV.Rodrigues(shot.dcm_CE)[0]
    seen = CV.projectPoints(r_LE_E - shot.r_CE_E, rotation, np.zeros(3), shot.k, shot.distortion)[0]
    return np.asarray(seen).reshape(-1, 2)


def photo_of(ground: Region, shot: Shot) -> NDArray[np.uint8]:
    """A photo by projecting every pixel of the map forwards, and interpolating between where they fall."""
    lat, lon = np.meshgrid(ground.lat_deg, ground.lon_deg, indexing="ij")
    seen = pixels_of(shot, positions(lat.ravel(), lon.ravel(), ground.heights.ravel()))
    column, row = np.meshgrid(np.arange(shot.shape[1]), np.arange(shot.shape[0]))
    near = (np.abs(seen - np.array(shot.shape[::-1]) / 2) < np.array(shot.shape[::-1]) * 0.52).all(axis=1)
    value: Any = LinearNDInterpolator(seen[near], ground.texture.ravel()[near].astype(float))(column, row)
    return np.clip(np.nan_to_num(value), 0, 255).astype(np.uint8)


def lens_of(shot: Shot) -> F64:
    """Numbers of the lens in the order of `fsw.math.camera`."""
    from fsw.math.camera import monotonic_limit

    d = shot.distortion
    head = [shot.k[0, 0], shot.k[1, 1], shot.k[0, 2], shot.k[1, 2], 0.0]
    return np.array([*head, *d, monotonic_limit(float(d[0]), float(d[1]), float(d[4]))])
