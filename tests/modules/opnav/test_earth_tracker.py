"""The tracker: another date and sensor, clouds, real photos, what is no photo of the place, and bad input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import earth_scene as scenes
from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from messages.base import F64
from messages.opnav import CameraConfigMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import dcm_from_rotation_vector
from modules.opnav.earth_tracker import EarthTracker, TrackerStatus
from modules.opnav.earth_tracker.geolocate import Guess, locate
from modules.opnav.earth_tracker.ground import angles, ground_points, looking_down, unit_vectors
from modules.opnav.landmark_catalogue import Catalogue, build_catalogue, region_of
from modules.opnav.landmark_finder.search import Pose
from tests.modules.opnav import synthetic_ground as world
from tests.modules.opnav.landmark_rig import (
    DATA,
    R_LAST,
    STATION,
    MadeUp,
    caspian_map,
    last_photo,
    look,
    nadir_view,
    prior_of,
    scene,
)

CV: Any = cv2
ITAIPU = DATA / "landsat" / "landsat8_itaipu_20200518_rgb.tif"
GLOBE, CASPIAN = (DATA / "earth" / n for n in ("blue_marble_global_10800x5400.tif", "blue_marble_z8_caspian.tif"))
CASES, DATES = 24, 4
OPAQUE, HIDDEN = 0.75, 0.6
"""Cloud through which less than a quarter of the ground's light comes; so much of the image under it may hide all."""
EXACT = EarthTracker.Params(sigma_map=0.0)
"""For maps that agree with each other."""


def track(
    catalogue: Catalogue,
    image: NDArray[np.uint8],
    camera: CameraConfigMsg | None,
    prior: PosePriorMsg | None,
    params: EarthTracker.Params = EXACT,
) -> LandmarksMsg:
    return look(EarthTracker("tracker", catalogue, params), image, camera, prior)


class Shown(NamedTuple):
    catalogue: Catalogue
    scene: MadeUp


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """A region with relief, its catalogue, and a photo."""
    made = scene(tmp_path_factory.mktemp("map"), (300, 400))
    return Shown(build_catalogue(made.geo_map, levels=2, spacing=24), made)


def test_relief_and_distortion(made_up: Shown, criterion: Callable[[str, float], None]) -> None:
    """TRACK-1: from a prior 4 km and 0.4 degrees off."""
    catalogue, (_, shot, photo, camera) = made_up
    start = dcm_from_rotation_vector(np.array([0.005, -0.004, 0.003])) @ shot.dcm_CE
    prior = prior_of(shot.r_CE_E + np.array([3e3, -2e3, 1e3]), start, 3e3, 5e-3)
    found = track(catalogue, photo, camera, prior)
    n = found.count
    assert found.status == TrackerStatus.FOUND
    assert n > 50
    assert found.cells > 15
    error = found.pixel_px[:n] - world.pixels_of(shot, found.r_LE_E[:n])
    criterion("TRACK-1", float(np.sqrt(np.mean(error**2))))
    assert np.allclose(found.sigma_px[:n] ** 2, 0.5 * np.trace(found.P_px[:n], axis1=1, axis2=2))
    assert np.linalg.eigvalsh(found.P_px[:n]).min() > 0.0
    assert np.isnan(found.r_LE_E[n:]).all() and np.isnan(found.P_px[n:]).all()
    again = track(catalogue, photo, camera, prior)
    assert again.pixel_px.tobytes() == found.pixel_px.tobytes()


def test_what_is_missing_is_said(made_up: Shown) -> None:
    catalogue, (_, shot, photo, camera) = made_up
    prior = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3)
    late = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3, exposure_ns=4)
    upwards = prior_of(shot.r_CE_E, np.diag([1.0, -1.0, -1.0]) @ shot.dcm_CE, 1e3, 1e-3)
    inside = prior_of(0.5 * shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3)
    small = CameraConfigMsg(width_px=20, height_px=16, focal_px=np.full(2, 20.0), center_px=np.array([9.5, 7.5]))
    cases = [
        (track(catalogue, photo, None, prior), TrackerStatus.NO_PRIOR),
        (track(catalogue, photo, camera, None), TrackerStatus.NO_PRIOR),
        (track(catalogue, photo, camera, late), TrackerStatus.NO_PRIOR),
        (track(catalogue, photo[:-1], camera, prior), TrackerStatus.WRONG_SIZE),
        (track(catalogue, np.ascontiguousarray(photo[:, ::-1]), camera, upwards), TrackerStatus.NOT_SURE),
        (track(catalogue, photo, camera, inside), TrackerStatus.NOT_SURE),
        (track(catalogue, photo[:16, :20], small, prior), TrackerStatus.NOT_SURE),
    ]
    for found, status in cases:
        assert found.count == 0
        assert found.status == status
        assert np.isnan(found.pixel_px).all() and np.isnan(found.P_px).all()
    found = track(catalogue, photo, camera, upwards)  # a prior that is wrong and sure of itself
    error = found.pixel_px[: found.count] - world.pixels_of(shot, found.r_LE_E[: found.count])
    assert found.count > 50 and np.abs(error).max() < 1.0


def test_pixels_back_to_the_ground(made_up: Shown) -> None:
    """Ground points project onto their pixels by OpenCV; the pose comes back from its angles."""
    shot, lens = made_up.scene.shot, lens_vector(made_up.scene.camera)
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

    shot: scenes.Shot
    found: LandmarksMsg

    @property
    def error(self) -> F64:
        """Of each match (n, 2) [px]."""
        n = self.found.count
        return self.found.pixel_px[:n] - self.shot.pixels(self.found.r_LE_E[:n])

    @property
    def square(self) -> F64:
        """The same squared over its covariance (n,)."""
        return np.einsum("ni,nij,nj->n", self.error, np.linalg.inv(self.found.P_px[: self.found.count]), self.error)

    @property
    def covered(self) -> int:
        """Matches on cloud."""
        column, row = np.rint(self.found.pixel_px[: self.found.count]).astype(int).T
        return int((self.shot.cloud[row, column] > OPAQUE).sum())


def off_by(shot: scenes.Shot, rng: np.random.Generator) -> PosePriorMsg:
    """A prior 2 km and 0.3 degrees off in each component."""
    turn = dcm_from_rotation_vector(np.radians(0.3) * rng.normal(size=3))
    return prior_of(shot.r_CE_E + 2e3 * rng.normal(size=3), turn @ shot.dcm_CE, 2e3, np.radians(0.3))


@pytest.fixture(scope="module")
def itaipu() -> Catalogue:
    return build_catalogue(GeoMap.open([ITAIPU]))


@pytest.fixture(scope="module")
def black(tmp_path_factory: pytest.TempPathFactory) -> GeoMap:
    return GeoMap.open([scenes.write_black(tmp_path_factory.mktemp("black") / "black.tif")])


@pytest.fixture(scope="module")
def tried(itaipu: Catalogue, black: GeoMap, tmp_path_factory: pytest.TempPathFactory) -> list[Tried]:
    """Random poses over other dates and sensors of the scene, drawn by the Earth camera, most of them with clouds."""
    folder = tmp_path_factory.mktemp("dates")
    dates = [
        scenes.write_date(ITAIPU, folder / f"{k}.tif", np.random.default_rng(k), (1.0, 1.5)[k % 2])
        for k in range(DATES)
    ]
    made: list[Tried] = []
    for case in range(CASES):
        rng = np.random.default_rng(5000 + case)
        place = tuple(np.radians(np.array([-25.34, -54.54]) + rng.uniform(-0.06, 0.06, 2)).tolist())
        maps = GeoMap.open([dates[case % DATES]])
        shot = scenes.random_case(maps, black, place, itaipu.gsd, rng, clouds=(0.0, 0.3, 0.5, 0.4)[case // DATES % 4])
        made.append(Tried(shot, track(itaipu, shot.photo, shot.camera, off_by(shot, rng))))
    return made


@pytest.mark.slow
def test_another_date_and_sensor(tried: list[Tried], criterion: Callable[[str, float], None]) -> None:
    """TRACK-2 to TRACK-6."""
    error, square = np.concatenate([t.error for t in tried]), np.concatenate([t.square for t in tried])
    assert len(error) > 50 * CASES
    criterion("TRACK-2", float(np.sqrt(np.mean(error**2))))
    criterion("TRACK-3", float(np.mean(square > 9.0)))
    criterion("TRACK-4", abs(0.5 * float(np.mean(square)) - 1.0))
    criterion("TRACK-5", float(sum(t.covered for t in tried)))
    open_to_view = [t for t in tried if (t.shot.cloud > OPAQUE).mean() < HIDDEN]
    criterion("TRACK-6", float(np.mean([t.found.count == 0 for t in open_to_view])))


@pytest.mark.slow
def test_another_product(black: GeoMap, criterion: Callable[[str, float], None]) -> None:
    """TRACK-9, TRACK-10: the photo shows a regional map, the catalogue is of the global one, which is displaced."""
    region = GeoMap.open([CASPIAN, GLOBE], DATA / "earth" / "nasa_topography_2048x1024.png")
    catalogue = build_catalogue(GeoMap.open([GLOBE]), region_of(region.layers[0]), detector=None)
    made: list[Tried] = []
    for case in range(8):
        rng = np.random.default_rng(6000 + case)
        place = tuple(np.radians(np.array([36.9, 51.3]) + rng.uniform(-1.0, 1.0, 2)).tolist())
        shot = scenes.random_case(region, black, place, 3000.0, rng, size=400)
        made.append(Tried(shot, track(catalogue, shot.photo, shot.camera, off_by(shot, rng), EarthTracker.Params())))
    assert all(t.found.count > 12 for t in made)
    criterion("TRACK-9", float(np.sqrt(np.mean(np.concatenate([t.error for t in made]) ** 2))))
    criterion("TRACK-10", float(np.mean(np.concatenate([t.square for t in made]) > 9.0)))


@pytest.mark.slow
def test_mountains_off_nadir(black: GeoMap, tmp_path: Path, criterion: Callable[[str, float], None]) -> None:
    """TRACK-11, TRACK-12: two kilometres of relief, 10 to 40 degrees off nadir, heights in photo and catalogue."""
    heights = scenes.write_relief(ITAIPU, tmp_path / "dem.tif", 2000.0, np.random.default_rng(3))
    catalogue = build_catalogue(GeoMap.open([ITAIPU], heights), detector=None)
    maps = GeoMap.open([scenes.write_date(ITAIPU, tmp_path / "date.tif", np.random.default_rng(8), 1.0)], heights)
    made: list[Tried] = []
    for case in range(4):
        rng = np.random.default_rng(3000 + case)
        lat, lon = np.radians(np.array([-25.34, -54.54]) + rng.uniform(-0.05, 0.05, 2)).tolist()
        azimuth, turn = rng.uniform(0.0, 2.0 * np.pi, 2).tolist()
        pose = scenes.pose_over(lat, lon, 500e3, np.radians(10.0 * (case + 1)), azimuth, turn)
        camera = scenes.random_camera(30.0, float(np.linalg.norm(pose[0] - scenes.at(lat, lon))), 800, rng)
        shot = scenes.shoot(maps, black, camera, pose, scenes.random_sky(lat, lon, rng, 0.0), rng)
        made.append(Tried(shot, track(catalogue, shot.photo, shot.camera, off_by(shot, rng))))
    assert all(t.found.count > 30 for t in made)
    criterion("TRACK-11", float(np.sqrt(np.mean(np.concatenate([t.error for t in made]) ** 2))))
    criterion("TRACK-12", float(np.mean(np.concatenate([t.square for t in made]) > 9.0)))


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
    total = sum(track(itaipu, image, shot.camera, prior).count for image in false)
    aside = looking_down(np.radians(-25.34), np.radians(-54.54), 5e5, 0.0)
    over = prior_of(aside[0], aside[1], 2e3, np.radians(0.3))
    total += track(itaipu, last_photo(), STATION, over).count
    criterion("TRACK-7", float(total))


@pytest.mark.slow
def test_real_photo(criterion: Callable[[str, float], None]) -> None:
    """TRACK-8: a photo from the station, its turn about the boresight known to 3 degrees; the place by its orbit."""
    photo = np.rint(last_photo() @ np.array([0.299, 0.587, 0.114])).astype(np.uint8)
    guess = Guess(Pose(R_LAST + np.array([2e4, -2e4, 1e4]), nadir_view(np.zeros(3))), np.diag([9e8] * 3 + [0.01] * 3))
    found = locate(photo, STATION, caspian_map(), guess)
    assert found is not None
    criterion("TRACK-8", float(np.linalg.norm(found.tracked.fit.r_CE_E - R_LAST)) / 1e3)
    assert found.report["landmarks"] == len(found.tracked.P_px) >= 12
    assert found.report["height_m"] == pytest.approx(423.45e3, abs=5e3)
