"""Maps made for tests of the Earth camera, and a projection that shares nothing with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from rasterio.transform import Affine

from messages.base import F64
from messages.opnav import CameraConfigMsg
from sim.camera.earth_camera import Pose

WGS84_A, WGS84_E2 = 6378137.0, 6.69437999014e-3
"""As tables give them (NIMA TR8350.2)."""
PLAIN: dict[str, Any] = {"sunlight": False, "haze": 0.0, "star_gain": 0.0}
"""Parameters of the bare map."""
OVERHEAD = np.array([1.0, 0.0, 0.0])


def ecef(lat_deg: Any, lon_deg: Any, h: Any = 0.0) -> F64:
    """Earth-fixed positions (..., 3) [m] from the closed form."""
    lat, lon, h = np.broadcast_arrays(np.radians(lat_deg), np.radians(lon_deg), h)
    n = WGS84_A / np.sqrt(1.0 - WGS84_E2 * np.sin(lat) ** 2)
    p = (n + h) * np.cos(lat)
    return np.stack([p * np.cos(lon), p * np.sin(lon), (n * (1.0 - WGS84_E2) + h) * np.sin(lat)], axis=-1)


def looking(lat_deg: float, lon_deg: float, h: float, off_deg: float = 0.0, azimuth_deg: float = 0.0) -> Pose:
    """A camera over a place that looks off the vertical towards an azimuth, which is up in the picture."""
    lat, lon, off, azimuth = np.radians([lat_deg, lon_deg, off_deg, azimuth_deg])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    up = np.cross(east, north)
    ahead = np.sin(azimuth) * east + np.cos(azimuth) * north
    z = np.sin(off) * ahead - np.cos(off) * up
    y = -(np.cos(off) * ahead + np.sin(off) * up)
    return Pose(ecef(lat_deg, lon_deg, h)[None], np.array([[np.cross(y, z), y, z]]), np.eye(3)[None])


def camera(focal_px: float, width: int = 512, height: int = 512, **more: Any) -> CameraConfigMsg:
    """A camera with its principal point in the middle."""
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    focal = np.array([focal_px, focal_px])
    return CameraConfigMsg(width_px=width, height_px=height, focal_px=focal, center_px=centre, **more)


def project_cv(r_E: F64, pose: Pose, cam: CameraConfigMsg) -> F64:
    """Pixels (n, 2) of Earth-fixed points, by OpenCV."""
    k = np.array([[cam.focal_px[0], 0.0, cam.center_px[0]], [0.0, cam.focal_px[1], cam.center_px[1]], [0.0, 0.0, 1.0]])
    dcm, r = pose.dcm_CE[0], pose.r_CE_E[0]
    rotation, _ = cv2.Rodrigues(dcm)
    pixels, _ = cv2.projectPoints(np.asarray(r_E, float)[:, None], rotation, -dcm @ r, k, np.array(cam.distortion))
    return np.asarray(pixels[:, 0], np.float64)


def mercator(lat_deg: Any, lon_deg: Any) -> tuple[Any, Any]:
    """EPSG:3857 by its definition."""
    lat = np.radians(lat_deg)
    return WGS84_A * np.radians(lon_deg), WGS84_A * np.log(np.tan(np.pi / 4.0 + lat / 2.0))


def utm(lat_deg: Any, lon_deg: Any, middle_deg: float) -> tuple[Any, Any]:
    """Transverse Mercator, northern zone, by Kruger's series (Karney 2011, eq. 7 to 11, 35)."""
    f = 1.0 / 298.257223563
    n = f / (2.0 - f)
    radius = WGS84_A / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    alpha = [
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
        61 * n**3 / 240 - 103 * n**4 / 140,
        49561 * n**4 / 161280,
    ]
    e = np.sqrt(f * (2.0 - f))
    lat, turn = np.radians(lat_deg), np.radians(np.asarray(lon_deg) - middle_deg)
    t = np.sinh(np.arctanh(np.sin(lat)) - e * np.arctanh(e * np.sin(lat)))
    xi, eta = np.arctan2(t, np.cos(turn)), np.arctanh(np.sin(turn) / np.sqrt(1.0 + t**2))
    x, y = eta.copy(), xi.copy()
    for k, a in enumerate(alpha, 1):
        x += a * np.cos(2 * k * xi) * np.sinh(2 * k * eta)
        y += a * np.sin(2 * k * xi) * np.cosh(2 * k * eta)
    return 500000.0 + 0.9996 * radius * x, 0.9996 * radius * y


def write_map(path: Path, image: Any, crs: Any, transform: Affine | None, **more: Any) -> Path:
    """A GeoTIFF of an image (rows, columns) or (rows, columns, bands)."""
    bands = image[..., None] if image.ndim == 2 else image
    profile = {"driver": "GTiff", "height": image.shape[0], "width": image.shape[1], "count": bands.shape[2]}
    mask = more.pop("mask", None)
    with rasterio.open(path, "w", **profile, dtype=image.dtype, crs=crs, transform=transform, **more) as data:
        data.write(np.moveaxis(bands, 2, 0))
        if mask is not None:
            data.write_mask(mask)
    return path


def dots(x: Any, y: Any, size: float, sigma: float) -> tuple[Any, Affine]:
    """White Gaussian dots on grey at map coordinates: an image (rows, columns) and its transform."""
    left, top = float(np.min(x)) - 50 * size, float(np.max(y)) + 50 * size
    columns, rows = int((np.max(x) - left) / size) + 50, int((top - np.min(y)) / size) + 50
    image = np.zeros((rows, columns))
    half = int(6 * sigma)
    for u, v in zip((np.asarray(x) - left) / size - 0.5, (top - np.asarray(y)) / size - 0.5, strict=True):
        i, j = round(v), round(u)
        yy, xx = np.mgrid[max(i - half, 0) : i + half + 1, max(j - half, 0) : j + half + 1]
        spot = np.exp(-0.5 * ((xx - u) ** 2 + (yy - v) ** 2) / sigma**2)
        part = image[max(i - half, 0) : i + half + 1, max(j - half, 0) : j + half + 1]
        part += spot[: part.shape[0], : part.shape[1]]
    return np.rint(30.0 + 200.0 * image).astype(np.uint8), Affine(size, 0.0, left, 0.0, -size, top)


def centroids(image: Any, expected: F64, half: int) -> F64:
    """Centre of the light above the background near each expected pixel (n, 2); NaN where that is at the border."""
    found = np.full(expected.shape, np.nan)
    for k, (x, y) in enumerate(expected):
        j, i = round(x), round(y)
        if min(i, j) < half or i + half >= image.shape[0] or j + half >= image.shape[1]:
            continue
        part = image[i - half : i + half + 1, j - half : j + half + 1].astype(float)
        part = np.clip(part - np.median(np.concatenate([part[0], part[-1], part[:, 0], part[:, -1]])), 0.0, None)
        part[part < 0.02 * part.max()] = 0.0
        yy, xx = np.mgrid[i - half : i + half + 1, j - half : j + half + 1]
        found[k] = (part * xx).sum() / part.sum(), (part * yy).sum() / part.sum()
    return found


def from_origin(west: float, north: float, width: float, height: float) -> Affine:
    """The transform of a north-up map."""
    return Affine(width, 0.0, west, 0.0, -height, north)
