"""Another date and another sensor: a map changed class by class, resampled, and photographed through air and cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.transform import Affine

from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from fsw.math.geodesy import ecef_from_geodetic, enu_dcm
from messages.base import F64
from messages.opnav import CameraConfigMsg
from modules.opnav.landmark_finder import render_view

CV: Any = cv2
RASTERIO: Any = rasterio


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
    soft = CV.GaussianBlur(np.dstack([grey, green]), (0, 0), 1.0)
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
        return lens_vector(self.camera)

    def pixels(self, r_LE_E: F64) -> F64:
        """Where places (n, 3) truly are in the photo, by OpenCV."""
        (fx, fy), (cx, cy) = self.camera.focal_px, self.camera.center_px
        k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        there = (r_LE_E - self.r_CE_E) @ self.dcm_CE.T
        turn = CV.Rodrigues(np.eye(3))[0]
        return CV.projectPoints(there, turn, np.zeros(3), k, self.camera.distortion)[0].reshape(-1, 2)


def pose_over(lat: float, lon: float, height: float, off_nadir: float, azimuth: float, turn: float) -> tuple[F64, F64]:
    """A camera that sees a place [rad] in the middle, ``off_nadir`` [rad] from a height [m], from an azimuth."""
    axes = np.empty((3, 3))
    enu_dcm(lat, lon, axes)
    target = np.array(ecef_from_geodetic(lat, lon, 0.0))
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


def shoot(
    geo_map: GeoMap, camera: CameraConfigMsg, r_CE_E: F64, dcm_CE: F64, rng: np.random.Generator, cloudy: float
) -> Shot:
    """A photo through air, with clouds over a part ``cloudy`` of it, uneven light, blur and noise."""
    shape = camera.height_px, camera.width_px
    view = render_view(geo_map, lens_vector(camera), shape, r_CE_E, dcm_CE)
    light = view.image / 255.0
    x, y = np.meshgrid(np.linspace(-1, 1, shape[1]), np.linspace(-1, 1, shape[0]))
    angle = rng.uniform(0, 2 * np.pi)
    ramp = np.cos(angle) * x + np.sin(angle) * y
    light *= 1.0 + rng.uniform(0.0, 0.25) * ramp
    haze = rng.uniform(0.0, 0.35) + 0.05 * field(rng, shape, 500.0) * rng.uniform(0, 1)
    light = light * (1.0 - haze) + 0.8 * haze
    rough = field(rng, shape, 130.0) + 0.35 * field(rng, shape, 35.0) + 0.12 * field(rng, shape, 9.0)
    level = np.quantile(rough, 1.0 - cloudy) if cloudy > 0 else np.inf
    thickness = rng.choice([0.5, 3.0])  # thin veils or solid cloud
    cloud = 1.0 - np.exp(-thickness * np.clip((rough - level) / 0.5, 0.0, None)) if cloudy > 0 else np.zeros(shape)
    top = 0.9 + 0.07 * field(rng, shape, 20.0)
    light = light * (1.0 - cloud) + top * cloud
    grey = CV.GaussianBlur(255.0 * light, (0, 0), rng.uniform(0.5, 0.9))
    grey += rng.normal(0.0, rng.uniform(1.0, 4.0), shape)
    return Shot(np.clip(np.rint(grey), 0, 255).astype(np.uint8), cloud, camera, r_CE_E, dcm_CE)


def random_case(
    geo_map: GeoMap, lat: float, lon: float, gsd: float, rng: np.random.Generator, size: int = 1024, cloudy: float = 0.0
) -> Shot:
    """A camera 300 to 800 km up, to 40 degrees off nadir, with pixels of some ``gsd`` [m] and a little distortion."""
    height, off = rng.uniform(300e3, 800e3), np.radians(rng.uniform(0.0, 40.0))
    r_CE_E, dcm_CE = pose_over(lat, lon, height, off, rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi))
    far = float(np.linalg.norm(r_CE_E - np.array(ecef_from_geodetic(lat, lon, 0.0))))
    camera = CameraConfigMsg(
        width_px=size,
        height_px=size,
        focal_px=np.full(2, far / (gsd * rng.uniform(0.9, 1.2))),
        center_px=np.full(2, (size - 1) / 2.0) + rng.uniform(-5, 5, 2),
        distortion=np.array([rng.uniform(-0.05, 0.05), 0.0, 2e-4, -2e-4, 0.0]),
    )
    return shoot(geo_map, camera, r_CE_E, dcm_CE, rng, cloudy)
