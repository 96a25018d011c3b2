"""The cold start: a pose from features of the image among those of the catalogue, when the attitude is hardly known."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import undistort
from fsw.math.resection import fit_pose
from messages.base import F64
from modules.opnav.features import Features, detect, mutual_matches
from modules.opnav.landmark_catalogue import Catalogue
from modules.opnav.landmark_catalogue.catalogue import ground_circle
from modules.opnav.landmark_finder.consensus import homography_consensus, undistorted_px
from modules.opnav.landmark_finder.search import Pose

RATIO = 0.88
"""A feature's best match must be nearer than this times its second best (Lowe 2004, sec. 7.1)."""
CONSENSUS_PX = 6.0
MIN_INLIERS = 25
"""Fewer agreeing features than this are chance."""
LIMIT = 5000
ZOOM = (0.3, 3.0)
"""Pixels of the image to one of the picture in which a feature was found."""
CV: Any = cv2


def cold_start(catalogue: Catalogue, lens: F64, photo: NDArray[np.uint8], start: Pose, P_pose: F64) -> Pose | None:
    """Position and attitude from matched features: homography consensus, then SQPNP (Terzakis and Lourakis 2020).

    Args:
        catalogue: features of the map.
        lens: lens vector (11,).
        photo: grey (rows, columns).
        start: expected pose; its position, good to some ten per cent of the height, says from where the catalogue is
            looked at.
        P_pose: covariance of the expected pose (6, 6); how far around the expected view features are taken.

    Returns:
        The pose, to some pixels; None if too few features agree.
    """
    if min(photo.shape) < 64:
        return None
    index = _reachable(catalogue, lens, (photo.shape[0], photo.shape[1]), start, P_pose)
    if len(index) < MIN_INLIERS:
        return None
    known = catalogue.features
    far = np.linalg.norm(known.r_FE_E[index] - start.r_CE_E, axis=1)
    zoom = known.gsd[index] * np.sqrt(lens[0] * lens[1]) / far
    index = index[(zoom > ZOOM[0]) & (zoom < ZOOM[1])]
    if len(index) < MIN_INLIERS:
        return None
    clear = CV.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(photo)
    seen: Features = detect(catalogue.detector, clear, None, LIMIT)
    pairs = mutual_matches(seen.words, known.words[index], RATIO)
    if len(pairs) < MIN_INLIERS:
        return None
    pixel, ground = seen.place_px[pairs[:, 0]], known.r_FE_E[index[pairs[:, 1]]]
    agree = homography_consensus(undistorted_px(lens, pixel), from_above(start.r_CE_E, ground, lens[0]), CONSENSUS_PX)
    if agree.sum() < MIN_INLIERS:
        return None
    return resect(lens, ground[agree], np.ascontiguousarray(pixel[agree]))


def _reachable(catalogue: Catalogue, lens: F64, shape: tuple[int, int], start: Pose, P_pose: F64) -> NDArray[np.int64]:
    """Features that the camera may see within 3 sigma of the expected pose."""
    height = max(float(np.linalg.norm(start.r_CE_E)) - 6.371e6, 1e5)
    shift = 3.0 * float(np.sqrt(max(np.linalg.eigvalsh(P_pose[:3, :3])[-1], 0.0)))
    turn = 3.0 * float(np.sqrt(max(np.linalg.eigvalsh(P_pose[3:5, 3:5])[-1], 0.0)))
    horizon = float(np.sqrt(max(float(start.r_CE_E @ start.r_CE_E) - 6.3e6**2, 0.0)))
    middle, radius = ground_circle(lens, shape, start.r_CE_E, start.dcm_CE, 0.0)
    reach = radius + shift + 2.0 * height * turn
    if turn > 0.5 or reach > horizon:
        middle, reach = start.r_CE_E, horizon + shift
    return catalogue.features_near(middle, reach)


def from_above(r_CE_E: F64, ground: F64, focal: float) -> F64:
    """Places (n, 3) [m] in an ideal camera that looks down from a position; NaN if they are 80 degrees off or more.

    Seen from one place, all pictures of all cameras are homographies of each other.
    """
    down = -r_CE_E / np.linalg.norm(r_CE_E)
    side = np.linalg.svd(down[None])[2][1:]
    if np.linalg.det(np.vstack([side, down])) < 0.0:  # a mirrored view has no homography that a camera gives
        side = side[::-1]
    ray = ground - r_CE_E
    z = ray @ down
    flat = np.full((len(ground), 2), np.nan)
    front = z > 0.17 * np.linalg.norm(ray, axis=1)
    flat[front] = focal * (ray[front] @ side.T) / z[front, None]
    return flat


def resect(lens: F64, ground: F64, pixel: F64) -> Pose | None:
    """A pose from places (n, 3) [m] and pixels (n, 2), without any start, robustly; None if they fix none."""
    tangents = np.empty((len(pixel), 2))
    undistort(lens, pixel, tangents)
    known = np.isfinite(tangents[:, 0]) & np.isfinite(ground).all(axis=1)
    if known.sum() < MIN_INLIERS:
        return None
    ground, pixel, tangents = ground[known], pixel[known], tangents[known]
    middle = ground.mean(axis=0)
    try:
        done, turn, shift = CV.solvePnP(
            (ground - middle) / 1e3, tangents, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:
        return None
    if not done:
        return None
    dcm = np.asarray(CV.Rodrigues(turn)[0], float)
    r_CE_E = middle - 1e3 * dcm.T @ np.asarray(shift, float).ravel()
    fit = fit_pose(lens, ground, pixel, np.full(len(pixel), 3.0), r_CE_E, dcm)
    if fit is None or fit.inlier.sum() < MIN_INLIERS // 2:
        return None
    return Pose(fit.r_CE_E, fit.dcm_CE)
