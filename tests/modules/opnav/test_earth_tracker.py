"""The tracker: another date and sensor, clouds, real photos, what is no photo of the place, and bad input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fsw import Module, Out
from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from messages.base import F64
from messages.opnav import CameraConfigMsg, CameraImageMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import beta_from_dcm, dcm_from_rotation_vector
from modules.opnav.earth_tracker import EarthTracker, TrackerStatus
from modules.opnav.earth_tracker.ground import angles, ground_points, looking_down, unit_vectors
from modules.opnav.landmark_catalogue import Catalogue, build_catalogue
from tests.modules.opnav import season_scenes as seasons
from tests.modules.opnav import synthetic_ground as world
from tests.modules.opnav.test_landmark_finder import R_LAST, STATION, last_photo, nadir_view

CV: Any = cv2
DATA = Path(__file__).parents[3] / "sim" / "data"
ITAIPU = DATA / "landsat" / "landsat8_itaipu_20200518_rgb.tif"
CASES, DATES = 30, 4
OPAQUE = 0.75
"""Cloud through which less than a quarter of the ground's light comes."""


class Source(Module):
    """Writes what a test gives it."""

    out_image = Out(CameraImageMsg)
    out_camera = Out(CameraConfigMsg)
    out_prior = Out(PosePriorMsg)


def prior_of(r_CE_E: F64, dcm_CE: F64, sigma_m: float, sigma_rad: float, exposure_ns: int = 3) -> PosePriorMsg:
    P_pose = np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 3)
    return PosePriorMsg(exposure_ns=exposure_ns, r_CE_E=r_CE_E, beta_CE=beta_from_dcm(dcm_CE), P_pose=P_pose)


def look(
    catalogue: Catalogue, image: NDArray[np.uint8], camera: CameraConfigMsg | None, prior: PosePriorMsg | None
) -> LandmarksMsg:
    source, tracker = Source("source"), EarthTracker("tracker", catalogue)
    source.out_image.connect(tracker.in_image)
    source.out_camera.connect(tracker.in_camera)
    source.out_prior.connect(tracker.in_prior)
    tracker.step(0)
    assert tracker.out_landmarks.latest() is None
    source.out_image.write(CameraImageMsg(image=image, exposure_ns=3), 0)
    if camera is not None:
        source.out_camera.write(camera, 0)
    if prior is not None:
        source.out_prior.write(prior, 0)
    tracker.step(0)
    tracker.step(1)
    assert tracker.out_landmarks.seq == 1
    found = tracker.out_landmarks.latest()
    assert found is not None
    return found


class MadeUp(NamedTuple):
    catalogue: Catalogue
    shot: world.Shot
    photo: NDArray[np.uint8]
    camera: CameraConfigMsg


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> MadeUp:
    """A region with relief, its catalogue, and a photo by another renderer, darker, with noise."""
    folder, ground, shot = tmp_path_factory.mktemp("map"), world.region(), world.looking_down(shape=(300, 400))
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
    return MadeUp(build_catalogue(GeoMap.open([files], dem), levels=2, spacing=24), shot, photo, camera)


def test_relief_and_distortion(made_up: MadeUp, criterion: Callable[[str, float], None]) -> None:
    """TRACK-1: from a prior 4 km and 0.4 degrees off."""
    catalogue, shot, photo, camera = made_up
    start = dcm_from_rotation_vector(np.array([0.005, -0.004, 0.003])) @ shot.dcm_CE
    prior = prior_of(shot.r_CE_E + np.array([3e3, -2e3, 1e3]), start, 3e3, 5e-3)
    found = look(catalogue, photo, camera, prior)
    n = found.count
    assert found.status == TrackerStatus.FOUND
    assert n > 50
    assert found.cells > 15
    error = found.pixel_px[:n] - world.pixels_of(shot, found.r_LE_E[:n])
    criterion("TRACK-1", float(np.sqrt(np.mean(error**2))))
    assert np.allclose(found.sigma_px[:n] ** 2, 0.5 * np.trace(found.P_px[:n], axis1=1, axis2=2))
    assert np.linalg.eigvalsh(found.P_px[:n]).min() > 0.0
    assert np.isnan(found.r_LE_E[n:]).all() and np.isnan(found.P_px[n:]).all()
    again = look(catalogue, photo, camera, prior)
    assert again.pixel_px.tobytes() == found.pixel_px.tobytes()


def test_what_is_missing_is_said(made_up: MadeUp) -> None:
    catalogue, shot, photo, camera = made_up
    prior = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3)
    late = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3, exposure_ns=4)
    upwards = prior_of(shot.r_CE_E, np.diag([1.0, -1.0, -1.0]) @ shot.dcm_CE, 1e3, 1e-3)
    inside = prior_of(0.5 * shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3)
    small = CameraConfigMsg(width_px=20, height_px=16, focal_px=np.full(2, 20.0), center_px=np.array([9.5, 7.5]))
    cases = [
        (look(catalogue, photo, None, prior), TrackerStatus.NO_PRIOR),
        (look(catalogue, photo, camera, None), TrackerStatus.NO_PRIOR),
        (look(catalogue, photo, camera, late), TrackerStatus.NO_PRIOR),
        (look(catalogue, photo[:-1], camera, prior), TrackerStatus.WRONG_SIZE),
        (look(catalogue, np.ascontiguousarray(photo[:, ::-1]), camera, upwards), TrackerStatus.NOT_SURE),
        (look(catalogue, photo, camera, inside), TrackerStatus.NOT_SURE),
        (look(catalogue, photo[:16, :20], small, prior), TrackerStatus.NOT_SURE),
    ]
    for found, status in cases:
        assert found.count == 0
        assert found.status == status
        assert np.isnan(found.pixel_px).all() and np.isnan(found.P_px).all()
    found = look(catalogue, photo, camera, upwards)  # a prior that is wrong and sure of itself
    error = found.pixel_px[: found.count] - world.pixels_of(shot, found.r_LE_E[: found.count])
    assert found.count > 50 and np.abs(error).max() < 1.0


def test_pixels_back_to_the_ground(made_up: MadeUp) -> None:
    """Ground points project onto their pixels by OpenCV; the pose comes back from its angles."""
    shot, lens = made_up.shot, lens_vector(made_up.camera)
    pixel = np.array([[0.0, 0.0], [399.0, 299.0], [120.5, 200.25]])
    places = ground_points(lens, shot.r_CE_E, shot.dcm_CE, pixel, 800.0)
    ground = world.positions(np.degrees(places[:, 0]), np.degrees(places[:, 1]), np.full(3, 800.0))
    assert np.allclose(world.pixels_of(shot, ground), pixel, atol=1e-6)
    assert np.allclose(np.linalg.norm(ground - shot.r_CE_E, axis=1), places[:, 2], atol=1e-3)
    rays = (ground - shot.r_CE_E) @ shot.dcm_CE.T
    assert np.allclose(unit_vectors(lens, pixel), rays / np.linalg.norm(rays, axis=1)[:, None], atol=1e-9)
    wanted = (0.4, -2.0, 5e5, 0.2, 4.0)
    r_CE_E, dcm_CE = looking_down(0.4, -2.0, 5e5, 4.0, 0.2)
    assert np.allclose(dcm_CE @ dcm_CE.T, np.eye(3), atol=1e-12) and np.linalg.det(dcm_CE) > 0.0
    assert np.allclose(angles(r_CE_E, dcm_CE), wanted, rtol=1e-9)


class Tried(NamedTuple):
    """A case, and what came of it."""

    shot: seasons.Shot
    found: LandmarksMsg


@pytest.fixture(scope="module")
def itaipu() -> Catalogue:
    return build_catalogue(GeoMap.open([ITAIPU]))


@pytest.fixture(scope="module")
def tried(itaipu: Catalogue, tmp_path_factory: pytest.TempPathFactory) -> list[Tried]:
    """Random poses over other dates and sensors of the scene, half of them under clouds; priors 2 km, 0.3 deg off."""
    folder = tmp_path_factory.mktemp("dates")
    dates = [
        seasons.write_date(ITAIPU, folder / f"{k}.tif", np.random.default_rng(k), (1.0, 1.5)[k % 2])
        for k in range(DATES)
    ]
    made: list[Tried] = []
    for case in range(CASES):
        rng = np.random.default_rng(5000 + case)
        lat, lon = np.radians(np.array([-25.34, -54.54]) + rng.uniform(-0.06, 0.06, 2))
        cloudy = (0.0, 0.3, 0.15, 0.5)[case // DATES % 4]
        shot = seasons.random_case(GeoMap.open([dates[case % DATES]]), lat, lon, itaipu.gsd, rng, cloudy=cloudy)
        turn = dcm_from_rotation_vector(np.radians(0.3) * rng.normal(size=3))
        prior = prior_of(shot.r_CE_E + 2e3 * rng.normal(size=3), turn @ shot.dcm_CE, 2e3, np.radians(0.3))
        made.append(Tried(shot, look(itaipu, shot.photo, shot.camera, prior)))
    return made


@pytest.mark.slow
def test_another_date_and_sensor(tried: list[Tried], criterion: Callable[[str, float], None]) -> None:
    """TRACK-2 to TRACK-6."""
    errors: list[F64] = []
    squares: list[F64] = []
    covered = 0
    for shot, found in tried:
        n = found.count
        error = found.pixel_px[:n] - shot.pixels(found.r_LE_E[:n])
        errors.append(error)
        squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.P_px[:n]), error))
        column, row = np.rint(found.pixel_px[:n]).astype(int).T
        covered += int((shot.cloud[row, column] > OPAQUE).sum())
    error, square = np.concatenate(errors), np.concatenate(squares)
    assert len(error) > 50 * CASES
    criterion("TRACK-2", float(np.sqrt(np.mean(error**2))))
    criterion("TRACK-3", float(np.mean(square > 9.0)))
    criterion("TRACK-4", abs(0.5 * float(np.mean(square)) - 1.0))
    criterion("TRACK-5", float(covered))
    criterion("TRACK-6", float(np.mean([found.count == 0 for _, found in tried])))


@pytest.mark.slow
def test_false_photos(itaipu: Catalogue, tried: list[Tried], criterion: Callable[[str, float], None]) -> None:
    """TRACK-7: mirrored, upside down, cloud, black, noise, another place, and the right place in a wrong catalogue."""
    shot = tried[0].shot
    prior = prior_of(shot.r_CE_E, shot.dcm_CE, 2e3, np.radians(0.3))
    photo, rng = shot.photo, np.random.default_rng(3)
    soft = CV.GaussianBlur(rng.normal(size=photo.shape), (0, 0), 12.0)
    sky = ((soft - soft.min()) / np.ptp(soft) * 255).astype(np.uint8)
    elsewhere = np.ascontiguousarray(last_photo()[:972, :972].mean(axis=2)).astype(np.uint8)
    elsewhere = CV.resize(elsewhere, photo.shape[::-1])
    noise = rng.integers(0, 256, photo.shape).astype(np.uint8)
    mirrored, night = np.ascontiguousarray(photo[:, ::-1]), rng.poisson(2.0, photo.shape).astype(np.uint8)
    false = [mirrored, np.ascontiguousarray(photo[::-1]), sky, np.zeros_like(photo), night, noise, elsewhere]
    total = sum(look(itaipu, image, shot.camera, prior).count for image in false)
    aside = looking_down(np.radians(-25.34), np.radians(-54.54), 5e5, 0.0)
    over = prior_of(aside[0], aside[1], 2e3, np.radians(0.3))
    total += look(itaipu, last_photo(), STATION, over).count
    criterion("TRACK-7", float(total))


@pytest.mark.slow
def test_real_photo(criterion: Callable[[str, float], None]) -> None:
    """TRACK-8: a photo from the station, its turn about the boresight known to 3 degrees; the place by its orbit."""
    earth = DATA / "earth"
    maps = GeoMap.open([earth / "blue_marble_z8_caspian.tif"], earth / "nasa_topography_2048x1024.png")
    from modules.opnav.earth_tracker.geolocate import Guess, locate
    from modules.opnav.landmark_finder.search import Pose

    photo = np.rint(last_photo() @ np.array([0.299, 0.587, 0.114])).astype(np.uint8)
    guess = Guess(Pose(R_LAST + np.array([2e4, -2e4, 1e4]), nadir_view(np.zeros(3))), np.diag([9e8] * 3 + [0.01] * 3))
    found = locate(photo, STATION, maps, guess)
    assert found is not None
    criterion("TRACK-8", float(np.linalg.norm(found.tracked.fit.r_CE_E - R_LAST)) / 1e3)
    assert found.report["landmarks"] == len(found.tracked.P_px) >= 12
    assert found.report["height_m"] == pytest.approx(423.45e3, abs=5e3)
