"""The cold start: a pose from SIFT features, when the attitude is hardly known."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap, MapError
from fsw.math.resection import attitude_from_rays, fit_pose
from messages.base import F64
from modules.opnav.features import Features, detect, mutual_matches
from modules.opnav.landmark_finder.consensus import homography_consensus, undistorted_px
from modules.opnav.landmark_finder.render import pinhole, render_view

WIDE_FOCAL = 0.54
"""Focal length of the rendered view to the width of the photo: 85 degrees, so a tilt of 15 stays inside."""
RATIO = 0.88
"""A feature's best match must be nearer than this times its second best (Lowe 2004, sec. 7.1)."""
CONSENSUS_PX = 6.0
MIN_INLIERS = 30
"""Fewer agreeing features than this are chance: wrong views gave up to 28 with plain SIFT words, up to 8 with these."""
LIMIT = 8000
MIN_MASK = 0.1
CV: Any = cv2


def _features(grey: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> Features:
    """Features after evening out the contrast."""
    clear = CV.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(grey)
    return detect("sift", clear, mask, LIMIT)


def acquire(geo_map: GeoMap, lens: F64, photo: NDArray[np.uint8], r_CE_E: F64, dcm_CE: F64) -> tuple[F64, F64] | None:
    """Position and attitude from features of a wide view about the expected boresight; any turn about it.

    Args:
        geo_map: map and heights.
        lens: lens vector (11,).
        photo: grey image (rows, columns).
        r_CE_E: expected position (3,) [m]; a few tens of km off will do.
        dcm_CE: expected attitude (3, 3); only its boresight matters, to some 15 degrees.

    Returns:
        (r_CE_E, dcm_CE), to a few km; or None if fewer features agree than chance might give.
    """
    width = photo.shape[1]
    wide = pinhole(WIDE_FOCAL * width, (width, width))
    try:
        view = render_view(geo_map, wide, (width, width), r_CE_E, dcm_CE)
    except MapError:
        return None
    if view.mask.mean() < MIN_MASK or min(photo.shape) < 64:
        return None
    mapped, seen = _features(view.image, view.mask), _features(photo, None)
    pairs = mutual_matches(seen.words, mapped.words, RATIO)
    map_px, photo_px = mapped.place_px[pairs[:, 1]], seen.place_px[pairs[:, 0]]
    agree = homography_consensus(undistorted_px(lens, photo_px), map_px, CONSENSUS_PX)
    if agree.sum() < MIN_INLIERS:
        return None
    return _pose(lens, view.ground(map_px[agree]), photo_px[agree], r_CE_E)


def _pose(lens: F64, ground: F64, seen: F64, r_CE_E: F64) -> tuple[F64, F64] | None:
    known = np.isfinite(ground).all(axis=1)
    ground, seen = ground[known], seen[known]
    if len(ground) < MIN_INLIERS:
        return None
    dcm_CE = attitude_from_rays(lens, ground, seen, r_CE_E)
    fit = fit_pose(lens, ground, seen, np.full(len(seen), 3.0), r_CE_E, dcm_CE)
    if fit is None or fit.inlier.sum() < MIN_INLIERS // 2:
        return None
    return fit.r_CE_E, fit.dcm_CE
