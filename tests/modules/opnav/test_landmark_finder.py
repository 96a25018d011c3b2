"""The finder on made-up and on real photos, and on what is no photo of the place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fsw import Module, Out
from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from fsw.math.geodesy import ecef_from_geodetic
from fsw.math.resection import attitude_from_rays, fit_pose
from messages.base import F64
from messages.opnav import CameraConfigMsg, CameraImageMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import beta_from_dcm, dcm_from_rotation_vector
from modules.opnav.landmark_finder import FinderStatus, LandmarkFinder
from modules.opnav.landmark_finder.search import COARSE_REACH_PX, FINE_REACH_PX, Pose, Search
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
    geo_map: GeoMap, image: NDArray[np.uint8], camera: CameraConfigMsg | None, prior: PosePriorMsg | None
) -> LandmarksMsg:
    source, finder = Source("source"), LandmarkFinder("finder", geo_map)
    source.out_image.connect(finder.in_image)
    source.out_camera.connect(finder.in_camera)
    source.out_prior.connect(finder.in_prior)
    finder.step(0)
    assert finder.out_landmarks.latest() is None
    source.out_image.write(CameraImageMsg(image=image, exposure_ns=3), 0)
    if camera is not None:
        source.out_camera.write(camera, 0)
    if prior is not None:
        source.out_prior.write(prior, 0)
    finder.step(0)
    finder.step(1)
    assert finder.out_landmarks.seq == 1
    found = finder.out_landmarks.latest()
    assert found is not None
    assert found.exposure_ns == 3
    return found


def camera_of(shot: world.Shot) -> CameraConfigMsg:
    return CameraConfigMsg(
        width_px=shot.shape[1],
        height_px=shot.shape[0],
        focal_px=np.array([shot.k[0, 0], shot.k[1, 1]]),
        center_px=shot.k[:2, 2],
        distortion=shot.distortion,
    )


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> tuple[GeoMap, world.Shot, NDArray[np.uint8]]:
    """A region, a camera over it, and its photo by another renderer, darker, with noise."""
    folder, ground, shot = tmp_path_factory.mktemp("map"), world.region(), world.looking_down()
    files = world.write_map(folder / "map.tif", ground.texture, ground)
    dem = world.write_map(folder / "dem.tif", ground.heights.astype(np.float32), ground)
    noise = np.random.default_rng(6).normal(0, 2.0, shot.shape)
    photo = np.clip(0.7 * world.photo_of(ground, shot) + 20 + noise, 0, 255).astype(np.uint8)
    return GeoMap.open([files], dem), shot, photo


def test_synthetic_photo(
    made_up: tuple[GeoMap, world.Shot, NDArray[np.uint8]], criterion: Callable[[str, float], None]
) -> None:
    """FIND-2: from a prior 4 km and 0.4 degrees off."""
    geo_map, shot, photo = made_up
    start = dcm_from_rotation_vector(np.array([0.005, -0.004, 0.003])) @ shot.dcm_CE
    prior = prior_of(shot.r_CE_E + np.array([3e3, -2e3, 1e3]), start, 3e3, 5e-3)
    found = look(geo_map, photo, camera_of(shot), prior)
    assert found.status == FinderStatus.FOUND
    assert found.count > 70
    assert found.cells > 15
    n = found.count
    error = found.pixel_px[:n] - world.pixels_of(shot, found.r_LE_E[:n])
    criterion("FIND-2", float(np.sqrt(np.mean(error**2))))
    assert np.isnan(found.r_LE_E[n:]).all()
    again = look(geo_map, photo, camera_of(shot), prior)
    assert again.pixel_px.tobytes() == found.pixel_px.tobytes()


def test_what_is_missing_is_said(made_up: tuple[GeoMap, world.Shot, NDArray[np.uint8]]) -> None:
    geo_map, shot, photo = made_up
    camera, prior = camera_of(shot), prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3)
    late = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3, exposure_ns=4)
    upwards = prior_of(shot.r_CE_E, np.diag([1.0, -1.0, -1.0]) @ shot.dcm_CE, 1e3, 1e-3)
    cases = [
        (look(geo_map, photo, None, prior), FinderStatus.NO_PRIOR),
        (look(geo_map, photo, camera, None), FinderStatus.NO_PRIOR),
        (look(geo_map, photo, camera, late), FinderStatus.NO_PRIOR),
        (look(geo_map, photo[:-1], camera, prior), FinderStatus.WRONG_SIZE),
        (look(geo_map, photo, camera, upwards), FinderStatus.NOT_SURE),
    ]
    for found, status in cases:
        assert found.count == 0
        assert found.status == status
        assert np.isnan(found.pixel_px).all()


def test_reach_grows_with_the_prior(made_up: tuple[GeoMap, world.Shot, NDArray[np.uint8]]) -> None:
    geo_map, shot, photo = made_up
    search = Search(geo_map, world.lens_of(shot), photo, 20, (0.25, 0.04))
    pose = Pose(shot.r_CE_E, shot.dcm_CE)
    # 1 km at 420 km is f / 420 px; 3 sigma, and somewhat more towards the corners
    along = search.reach_px(pose, np.diag([1e6] * 3 + [0.0] * 3))
    assert along == pytest.approx(3.0 * shot.k[0, 0] / 420.0, rel=0.4)
    turn = search.reach_px(pose, np.diag([0.0] * 3 + [1e-4] * 3))
    assert turn == pytest.approx(3.0 * shot.k[0, 0] * 0.01, rel=0.6)
    assert FINE_REACH_PX < COARSE_REACH_PX


def test_spacing_fits_the_grid(made_up: tuple[GeoMap, world.Shot, NDArray[np.uint8]]) -> None:
    with pytest.raises(ValueError, match="multiple of 4"):
        LandmarkFinder("finder", made_up[0], LandmarkFinder.Params(spacing=18))


@pytest.fixture(scope="module")
def caspian() -> GeoMap:
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


def test_real_photo(caspian: GeoMap, criterion: Callable[[str, float], None]) -> None:
    """FIND-3: a photo from the station; the turn about the boresight unknown, then a prior too sure of itself."""
    cold = prior_of(R_LAST + np.array([2e4, -2e4, 1e4]), nadir_view(np.array([0.0, 0.0, 2.0])), 30e3, 3.0)
    first = look(caspian, last_photo(), STATION, cold)
    assert first.count > 700
    assert first.cells > 18
    lens, n = lens_vector(STATION), first.count
    attitude = attitude_from_rays(lens, first.r_LE_E[:n], first.pixel_px[:n], R_LAST)
    fit = fit_pose(lens, first.r_LE_E[:n], first.pixel_px[:n], first.sigma_px[:n], R_LAST, attitude)
    assert fit is not None
    assert np.linalg.norm(fit.r_CE_E - R_LAST) < 20e3
    turn = dcm_from_rotation_vector(np.radians([1.0, -1.0, 1.0])) @ fit.dcm_CE
    off = prior_of(fit.r_CE_E + np.array([12e3, -6e3, 4e3]), turn, 1e3, 1e-3)
    second = look(caspian, last_photo(), STATION, off)
    criterion("FIND-3", 1.0 - second.count / second.candidates)
    assert abs(second.count - first.count) < 0.02 * first.count


def test_false_photos(caspian: GeoMap, criterion: Callable[[str, float], None]) -> None:
    """FIND-4: mirrored, sky, black; the prior is right."""
    prior = prior_of(R_LAST, nadir_view(np.zeros(3)), 3e3, 0.2)
    photo = last_photo()
    clouds = CV.GaussianBlur(np.random.default_rng(3).normal(128, 60, photo.shape[:2]), (0, 0), 12.0)
    sky = np.clip((clouds - clouds.min()) / np.ptp(clouds) * 255, 0, 255).astype(np.uint8)
    false = [np.ascontiguousarray(photo[:, ::-1]), sky, np.zeros_like(sky)]
    criterion("FIND-4", float(sum(look(caspian, image, STATION, prior).count for image in false)))
