"""The finder on made-up and on real photos, and on what is no photo of the place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from fsw.math.resection import attitude_from_rays, fit_pose
from messages.opnav import CameraConfigMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import dcm_from_rotation_vector
from modules.opnav.landmark_finder import FinderStatus, LandmarkFinder
from modules.opnav.landmark_finder.search import COARSE_REACH_PX, FINE_REACH_PX, Pose, Search
from tests.modules.opnav import synthetic_ground as world
from tests.modules.opnav.landmark_rig import (
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


def find(
    geo_map: GeoMap, image: NDArray[np.uint8], camera: CameraConfigMsg | None, prior: PosePriorMsg | None
) -> LandmarksMsg:
    return look(LandmarkFinder("finder", geo_map), image, camera, prior)


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> MadeUp:
    return scene(tmp_path_factory.mktemp("map"), (240, 320))


def test_synthetic_photo(made_up: MadeUp, criterion: Callable[[str, float], None]) -> None:
    """FIND-2: from a prior 4 km and 0.4 degrees off."""
    geo_map, shot, photo, camera = made_up
    start = dcm_from_rotation_vector(np.array([0.005, -0.004, 0.003])) @ shot.dcm_CE
    prior = prior_of(shot.r_CE_E + np.array([3e3, -2e3, 1e3]), start, 3e3, 5e-3)
    found = find(geo_map, photo, camera, prior)
    assert found.status == FinderStatus.FOUND
    assert found.count > 70
    assert found.cells > 15
    n = found.count
    error = found.pixel_px[:n] - world.pixels_of(shot, found.r_LE_E[:n])
    criterion("FIND-2", float(np.sqrt(np.mean(error**2))))
    assert np.isnan(found.r_LE_E[n:]).all()
    again = find(geo_map, photo, camera, prior)
    assert again.pixel_px.tobytes() == found.pixel_px.tobytes()


def test_what_is_missing_is_said(made_up: MadeUp) -> None:
    geo_map, shot, photo, camera = made_up
    prior = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3)
    late = prior_of(shot.r_CE_E, shot.dcm_CE, 1e3, 1e-3, exposure_ns=4)
    upwards = prior_of(shot.r_CE_E, np.diag([1.0, -1.0, -1.0]) @ shot.dcm_CE, 1e3, 1e-3)
    cases = [
        (find(geo_map, photo, None, prior), FinderStatus.NO_PRIOR),
        (find(geo_map, photo, camera, None), FinderStatus.NO_PRIOR),
        (find(geo_map, photo, camera, late), FinderStatus.NO_PRIOR),
        (find(geo_map, photo[:-1], camera, prior), FinderStatus.WRONG_SIZE),
        (find(geo_map, photo, camera, upwards), FinderStatus.NOT_SURE),
    ]
    for found, status in cases:
        assert found.count == 0
        assert found.status == status
        assert np.isnan(found.pixel_px).all()


def test_reach_grows_with_the_prior(made_up: MadeUp) -> None:
    geo_map, shot, photo, _ = made_up
    search = Search(geo_map, world.lens_of(shot), photo, 20, (0.25, 0.04))
    pose = Pose(shot.r_CE_E, shot.dcm_CE)
    # 1 km at 420 km is f / 420 px; 3 sigma, and somewhat more towards the corners
    along = search.reach_px(pose, np.diag([1e6] * 3 + [0.0] * 3))
    assert along == pytest.approx(3.0 * shot.k[0, 0] / 420.0, rel=0.4)
    turn = search.reach_px(pose, np.diag([0.0] * 3 + [1e-4] * 3))
    assert turn == pytest.approx(3.0 * shot.k[0, 0] * 0.01, rel=0.6)
    assert FINE_REACH_PX < COARSE_REACH_PX


def test_spacing_fits_the_grid(made_up: MadeUp) -> None:
    with pytest.raises(ValueError, match="multiple of 4"):
        LandmarkFinder("finder", made_up.geo_map, LandmarkFinder.Params(spacing=18))


@pytest.fixture(scope="module")
def caspian() -> GeoMap:
    return caspian_map()


def test_real_photo(caspian: GeoMap, criterion: Callable[[str, float], None]) -> None:
    """FIND-3: a photo from the station; the turn about the boresight unknown, then a prior too sure of itself."""
    cold = prior_of(R_LAST + np.array([2e4, -2e4, 1e4]), nadir_view(np.array([0.0, 0.0, 2.0])), 30e3, 3.0)
    first = find(caspian, last_photo(), STATION, cold)
    assert first.count > 700
    assert first.cells > 18
    lens, n = lens_vector(STATION), first.count
    attitude = attitude_from_rays(lens, first.r_LE_E[:n], first.pixel_px[:n], R_LAST)
    fit = fit_pose(lens, first.r_LE_E[:n], first.pixel_px[:n], first.sigma_px[:n], R_LAST, attitude)
    assert fit is not None
    assert np.linalg.norm(fit.r_CE_E - R_LAST) < 20e3
    turn = dcm_from_rotation_vector(np.radians([1.0, -1.0, 1.0])) @ fit.dcm_CE
    off = prior_of(fit.r_CE_E + np.array([12e3, -6e3, 4e3]), turn, 1e3, 1e-3)
    second = find(caspian, last_photo(), STATION, off)
    criterion("FIND-3", 1.0 - second.count / second.candidates)
    assert abs(second.count - first.count) < 0.02 * first.count


def test_false_photos(caspian: GeoMap, criterion: Callable[[str, float], None]) -> None:
    """FIND-4: mirrored, sky, black; the prior is right."""
    prior = prior_of(R_LAST, nadir_view(np.zeros(3)), 3e3, 0.2)
    photo = last_photo()
    clouds = CV.GaussianBlur(np.random.default_rng(3).normal(128, 60, photo.shape[:2]), (0, 0), 12.0)
    sky = np.clip((clouds - clouds.min()) / np.ptp(clouds) * 255, 0, 255).astype(np.uint8)
    false = [np.ascontiguousarray(photo[:, ::-1]), sky, np.zeros_like(sky)]
    criterion("FIND-4", float(sum(find(caspian, image, STATION, prior).count for image in false)))
