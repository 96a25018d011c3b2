"""Photos of the Earth with known poses, drawn by the Earth camera from another map than the tracker's.

The map of the photo is the tracker's at another date and by another sensor (`write_date`), or another product. It
has sunlight, haze, clouds, terrain, blur and noise; where places are in it is computed by OpenCV.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import warp
from rasterio.transform import Affine

from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from fsw.math.geodesy import ecef_from_geodetic, enu_dcm
from messages.base import F64
from messages.opnav import CameraConfigMsg
from sim.camera.detector import expose
from sim.camera.earth_camera import EarthCameraParams, EarthRenderer, Pose
from sim.camera.earth_camera.clouds import BRIGHTNESS

CV: Any = cv2
RASTERIO: Any = rasterio
WARP: Any = warp
DATA = Path(__file__).parents[1] / "sim" / "data"
LUMA = np.array([0.299, 0.587, 0.114])


def field(rng: np.random.Generator, shape: tuple[int, int], size_px: float) -> F64:
    """A smooth random field of unit standard deviation, with features of some ``size_px``."""
    small = [max(4, round(n / size_px) + 3) for n in shape]
    cells = rng.normal(size=small)
    wide: F64 = CV.resize(cells, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return (wide - wide.mean()) / wide.std()


def another_date(rgb: NDArray[np.uint8], mask: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The ground at another time of the year, by another sensor's bands, as three equal bands.

    Six classes of ground by colour and brightness; each has its own gamma and a gain that varies over the scene.
    """
    light = rgb.astype(np.float64) / 255.0
    grey, green = light.mean(axis=2), light[..., 1] - 0.5 * (light[..., 0] + light[..., 2])
    soft: F64 = CV.GaussianBlur(np.dstack([grey, green]), (0, 0), 1.0)
    bright = np.digitize(soft[..., 0], np.quantile(soft[..., 0][mask], [1 / 3, 2 / 3]))
    lush = soft[..., 1] > np.quantile(soft[..., 1][mask], 0.5)
    kind = 2 * bright + lush
    mixed = light @ rng.dirichlet([3.0, 3.0, 3.0])
    gamma, gain = rng.uniform(0.7, 1.4, 6), rng.uniform(0.75, 1.3, 6)
    out = np.zeros(grey.shape)
    for k in range(6):
        change = gain[k] * np.exp(0.2 * field(rng, grey.shape, 150.0))
        out += np.where(kind == k, change * mixed ** gamma[k], 0.0)
    levels = np.clip(np.rint(255.0 * out / np.quantile(out[mask], 0.99)), 1, 255).astype(np.uint8)
    return np.dstack([levels] * 3)


def write_date(source: Path, target: Path, rng: np.random.Generator, coarser: float) -> Path:
    """A raster of another date: changed, blurred by the other sensor's optics, pixels ``coarser`` times as large."""
    with RASTERIO.open(source) as data:
        rgb = np.moveaxis(data.read([1, 2, 3]), 0, -1)
        mask = data.dataset_mask() > 0
        changed = CV.GaussianBlur(another_date(rgb, mask, rng), (0, 0), 0.45 * coarser)
        rows, columns = (int(n / coarser) for n in mask.shape)
        profile: dict[str, Any] = {
            "driver": "GTiff", "height": rows, "width": columns, "count": 3, "dtype": "uint8", "crs": data.crs,
            "transform": data.transform @ Affine.scale(coarser),
        }  # fmt: skip
        # the middles of the new pixels in the old ones: no corner is moved
        x = ((np.arange(columns) + 0.5) * coarser - 0.5).astype(np.float32)
        y = ((np.arange(rows) + 0.5) * coarser - 0.5).astype(np.float32)
        grid = np.meshgrid(x, y)
        new = CV.remap(changed, *grid, cv2.INTER_CUBIC)
        known = CV.remap(mask.astype(np.uint8) * 255, *grid, cv2.INTER_LINEAR) == 255
    with RASTERIO.Env(GDAL_TIFF_INTERNAL_MASK=True), RASTERIO.open(target, "w", **profile) as made:
        made.write(np.moveaxis(new, -1, 0))
        made.write_mask(known)
    return target


def write_relief(source: Path, target: Path, relief: float, rng: np.random.Generator) -> Path:
    """Heights from 0 to ``relief`` [m] under a raster, in pixels of some 90 m; mountains of some 5 km."""
    with RASTERIO.open(source) as data:
        box: tuple[float, float, float, float] = WARP.transform_bounds(data.crs, "EPSG:4326", *data.bounds)
    west, south, east, north = box
    step, edge = 0.0008, 0.02
    shape = int((north - south + 2.0 * edge) / step), int((east - west + 2.0 * edge) / step)
    hills = field(rng, shape, 60.0) + 0.3 * field(rng, shape, 15.0)
    profile: dict[str, Any] = {
        "driver": "GTiff", "height": shape[0], "width": shape[1], "count": 1, "dtype": "float32", "crs": "EPSG:4326",
        "transform": Affine(step, 0.0, west - edge, 0.0, -step, north + edge),
    }  # fmt: skip
    with RASTERIO.open(target, "w", **profile) as made:
        made.write((relief * (hills - hills.min()) / np.ptp(hills)).astype(np.float32), 1)
    return target


def at(lat: float, lon: float) -> F64:
    """Earth-fixed place (3,) [m] of the ellipsoid at a latitude and longitude [rad]."""
    return np.array(ecef_from_geodetic(lat, lon, 0.0))


def write_black(target: Path) -> Path:
    """A black map of the globe, on which clouds alone are seen."""
    profile: dict[str, Any] = {
        "driver": "GTiff", "height": 90, "width": 180, "count": 1, "dtype": "uint8", "crs": "EPSG:4326",
        "transform": Affine(2.0, 0.0, -180.0, 0.0, -2.0, 90.0),
    }  # fmt: skip
    with RASTERIO.open(target, "w", **profile) as made:
        made.write(np.zeros((90, 180), np.uint8), 1)
    return target


class Shot(NamedTuple):
    """A photo and the truth of it."""

    photo: NDArray[np.uint8]
    cloud: F64
    """(rows, columns) opacity of the cloud."""
    camera: CameraConfigMsg
    r_CE_E: F64
    dcm_CE: F64

    @property
    def lens(self) -> F64:
        """Lens vector (11,)."""
        return lens_vector(self.camera)

    def pixels(self, r_LE_E: F64) -> F64:
        """Where places (n, 3) truly are in the photo (n, 2) [px], by OpenCV."""
        if not len(r_LE_E):
            return np.empty((0, 2))
        (fx, fy), (cx, cy) = self.camera.focal_px, self.camera.center_px
        k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        there = (r_LE_E - self.r_CE_E) @ self.dcm_CE.T
        turn = CV.Rodrigues(np.eye(3))[0]
        return CV.projectPoints(there, turn, np.zeros(3), k, self.camera.distortion)[0].reshape(-1, 2)


def pose_over(lat: float, lon: float, height: float, off_nadir: float, azimuth: float, turn: float) -> tuple[F64, F64]:
    """A camera that sees a place [rad] in the middle, ``off_nadir`` [rad] from a height [m], from an azimuth."""
    axes = np.empty((3, 3))
    enu_dcm(lat, lon, axes)
    target = at(lat, lon)
    radius = float(np.linalg.norm(target))
    incidence = np.arcsin(min(0.95, np.sin(off_nadir) * (radius + height) / radius))
    along = np.array([np.sin(azimuth) * np.sin(incidence), np.cos(azimuth) * np.sin(incidence), np.cos(incidence)])
    along = axes.T @ along
    b = float(target @ along)
    distance = -b + np.sqrt(b * b + (radius + height) ** 2 - radius**2)
    z = -along
    x = np.cross(z, axes[1])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(turn), np.sin(turn)
    return target + distance * along, np.vstack([c * x + s * y, c * y - s * x, z])


class Sky(NamedTuple):
    """What is between the ground and the picture."""

    sun_E: F64
    """Direction of the Sun, Earth-fixed (3,)."""
    params: EarthCameraParams


def random_sky(lat: float, lon: float, rng: np.random.Generator, clouds: float) -> Sky:
    """Sunlight from 25 to 75 degrees above a place [rad], haze, clouds over about a part of the sky, blur and noise."""
    axes = np.empty((3, 3))
    enu_dcm(lat, lon, axes)
    high, azimuth = np.radians(rng.uniform(25.0, 75.0)), rng.uniform(0.0, 2.0 * np.pi)
    sun = axes.T @ np.array([np.sin(azimuth) * np.cos(high), np.cos(azimuth) * np.cos(high), np.sin(high)])
    params = EarthCameraParams(
        haze=rng.uniform(0.0, 1.5),
        aerosol=rng.uniform(0.0, 0.4),
        brightness=0.9 / np.sin(high),
        clouds=clouds,
        cloud_seed=int(rng.integers(1, 1000)),
        cloud_height=rng.uniform(1e3, 8e3),
        gamma=rng.uniform(1.0, 2.0),
        psf_sigma_px=rng.uniform(0.5, 0.9),
        vignetting=rng.uniform(0.0, 0.3),
        shot_noise=True,
        full_well=rng.uniform(2e3, 2e4),
        read_noise=rng.uniform(5.0, 25.0),
        black_level=0.02,
    )
    return Sky(sun, params)


def shoot(
    maps: GeoMap, black: GeoMap, camera: CameraConfigMsg, pose: tuple[F64, F64], sky: Sky, rng: np.random.Generator
) -> Shot:
    """A photo by the Earth camera.

    Args:
        maps: of the photo, with terrain or without.
        black: see `write_black`.
        camera: lens and size.
        pose: r_CE_E and dcm_CE.
        sky: Sun, air, detector.
        rng: for the noise.
    """
    r, dcm = pose
    row = Pose(r[None], np.ascontiguousarray(dcm[None]), np.eye(3)[None])
    light = EarthRenderer(camera, maps, sky.params).render(row, sky.sun_E).radiance
    level = expose((light @ LUMA).astype(np.float32), sky.params, rng.integers(1, 2**63, 4, dtype=np.uint64))
    cloud = np.zeros(level.shape)
    if sky.params.clouds > 0.0:
        bare = EarthCameraParams(
            sunlight=False, haze=0.0, star_gain=0.0, clouds=sky.params.clouds, cloud_seed=sky.params.cloud_seed,
            cloud_height=sky.params.cloud_height,
        )  # fmt: skip
        cloud = EarthRenderer(camera, black, bare).render(row, sky.sun_E).radiance[..., 0] / BRIGHTNESS
    return Shot(level, cloud.astype(np.float64), camera, r, dcm)


def random_camera(pixel_m: float, distance: float, size: int, rng: np.random.Generator) -> CameraConfigMsg:
    """A square camera whose pixels see some ``pixel_m`` [m] at a distance [m], with a little distortion."""
    return CameraConfigMsg(
        width_px=size,
        height_px=size,
        focal_px=np.full(2, distance / (pixel_m * rng.uniform(0.9, 1.2))),
        center_px=np.full(2, (size - 1) / 2.0) + rng.uniform(-5, 5, 2),
        distortion=np.array([rng.uniform(-0.05, 0.05), 0.0, 2e-4, -2e-4, 0.0]),
    )


def random_case(
    maps: GeoMap,
    black: GeoMap,
    place: tuple[float, float],
    pixel_m: float,
    rng: np.random.Generator,
    *,
    size: int = 1024,
    clouds: float = 0.0,
    most_off_deg: float = 40.0,
) -> Shot:
    """A photo of a place (latitude, longitude [rad]) from 300 to 800 km, to some degrees off nadir, any turn."""
    height, off = rng.uniform(300e3, 800e3), math.radians(rng.uniform(0.0, most_off_deg))
    pose = pose_over(*place, height, off, rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi))
    distance = float(np.linalg.norm(pose[0] - at(*place)))
    camera = random_camera(pixel_m, distance, size, rng)
    return shoot(maps, black, camera, pose, random_sky(*place, rng, clouds), rng)
