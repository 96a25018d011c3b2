"""What the tests of finder and tracker share: a module fed by hand, made-up photos, and a real one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw import Module, Out
from fsw.imaging.maps import GeoMap
from fsw.math.geodesy import ecef_from_geodetic
from messages.base import F64
from messages.opnav import CameraConfigMsg, CameraImageMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import beta_from_dcm, dcm_from_rotation_vector
from modules.opnav.earth_tracker import EarthTracker
from modules.opnav.landmark_finder import LandmarkFinder
from tests.modules.opnav import synthetic_ground as world

CV: Any = cv2
DATA = Path(__file__).parents[3] / "sim" / "data"
STATION = CameraConfigMsg(
    width_px=1296,
    height_px=972,
    focal_px=np.array([1031.6, 1031.6]),
    center_px=np.array([631.5, 466.1]),
    distortion=np.array([0.028, -0.019, 0.0, 0.0, 0.0]),
)
R_LAST = np.array(ecef_from_geodetic(np.radians(34.8848), np.radians(53.1493), 423.45e3))
"""Where the station was at the last photo, by its two-line elements."""


class Source(Module):
    """Writes what a test gives it."""

    out_image = Out(CameraImageMsg)
    out_camera = Out(CameraConfigMsg)
    out_prior = Out(PosePriorMsg)


def prior_of(r_CE_E: F64, dcm_CE: F64, sigma_m: float, sigma_rad: float, exposure_ns: int = 3) -> PosePriorMsg:
    P_pose = np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 3)
    return PosePriorMsg(exposure_ns=exposure_ns, r_CE_E=r_CE_E, beta_CE=beta_from_dcm(dcm_CE), P_pose=P_pose)


def look(
    module: LandmarkFinder | EarthTracker,
    image: NDArray[np.uint8],
    camera: CameraConfigMsg | None,
    prior: PosePriorMsg | None,
) -> LandmarksMsg:
    """What a new module says to one image."""
    source = Source("source")
    source.out_image.connect(module.in_image)
    source.out_camera.connect(module.in_camera)
    source.out_prior.connect(module.in_prior)
    module.step(0)
    assert module.out_landmarks.latest() is None
    source.out_image.write(CameraImageMsg(image=image, exposure_ns=3), 0)
    if camera is not None:
        source.out_camera.write(camera, 0)
    if prior is not None:
        source.out_prior.write(prior, 0)
    module.step(0)
    module.step(1)
    assert module.out_landmarks.seq == 1
    found = module.out_landmarks.latest()
    assert found is not None
    assert found.exposure_ns == 3
    return found


class MadeUp(NamedTuple):
    """A region with relief, and a photo of it by another renderer, darker, with noise."""

    geo_map: GeoMap
    shot: world.Shot
    photo: NDArray[np.uint8]
    camera: CameraConfigMsg


def scene(folder: Path, shape: tuple[int, int]) -> MadeUp:
    ground, shot = world.region(), world.looking_down(shape=shape)
    files = world.write_map(folder / "map.tif", ground.texture, ground)
    dem = world.write_map(folder / "dem.tif", ground.heights.astype(np.float32), ground)
    noise = np.random.default_rng(6).normal(0, 2.0, shot.shape)
    photo = np.clip(0.7 * world.photo_of(ground, shot) + 20 + noise, 0, 255).astype(np.uint8)
    camera = CameraConfigMsg(
        width_px=shot.shape[1],
        height_px=shot.shape[0],
        focal_px=np.array([shot.k[0, 0], shot.k[1, 1]]),
        center_px=shot.k[:2, 2],
        distortion=shot.distortion,
    )
    return MadeUp(GeoMap.open([files], dem), shot, photo, camera)


def caspian_map() -> GeoMap:
    earth = DATA / "earth"
    return GeoMap.open([earth / "blue_marble_z8_caspian.tif"], earth / "nasa_topography_2048x1024.png")


def last_photo() -> NDArray[np.uint8]:
    return np.asarray(CV.imread(str(DATA / "iss_photos" / "iss_20230505T033039.jpg"))[..., ::-1])


def nadir_view(turn: F64) -> F64:
    """Nadir, the top of the image in flight direction (133 deg), then turned by a rotation vector [rad]."""
    z = -R_LAST / np.linalg.norm(R_LAST)
    north = np.array([0.0, 0.0, 1.0]) - z * z[2]
    north /= np.linalg.norm(north)
    y = -(np.cos(2.32) * north + np.sin(2.32) * np.cross(z, north))
    return dcm_from_rotation_vector(turn) @ np.array([np.cross(y, z), y, z])
