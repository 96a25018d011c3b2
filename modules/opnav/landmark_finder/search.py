"""From an expected pose to landmarks: which search comes when, and when the answer counts as sure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap, MapError
from fsw.math.resection import fit_pose, pose_derivatives
from messages.base import F64
from modules.opnav.landmark_finder.acquire import acquire
from modules.opnav.landmark_finder.consensus import homography_consensus, sigma_of, undistorted_px
from modules.opnav.landmark_finder.correlate import Matches, chip_centres, edges, match_chips
from modules.opnav.landmark_finder.render import View, render_view, scaled_lens

COARSE = 4
"""The coarse search works on pixels this many times as large."""
FINE_REACH_PX = 20
"""Errors of the expected pose beyond this take a coarse search first: it is the faster one."""
COARSE_REACH_PX = 240
"""Beyond this, features are used that need no expectation."""
COLD_REACH_PX = 40
"""Half-width of the search after the cold start: its poses are good to some ten pixels."""
REFINEMENTS = ((12, 4.0), (8, 3.0), (8, 3.0), (8, 3.0))
"""Half-width of the search and consensus threshold [px] of each pass; a pose that stands still ends them."""
SETTLED_PX = 0.5
"""A pose has settled when the prediction of the landmarks moves by less than this (median)."""
MIN_AGREE = 20
"""Fewest matches that agree, in any pass."""
MIN_SHARE = 0.25
"""Least share of the matches that agree, in a refining pass; by chance it would be 0.06 to 0.1."""
CV: Any = cv2


class Pose(NamedTuple):
    """Where the camera is thought to be."""

    r_CE_E: F64
    """Position, Earth-fixed (3,) [m]."""
    dcm_CE: F64
    """Maps Earth-fixed to camera components (3, 3)."""


class Found(NamedTuple):
    """Landmarks that agree with each other."""

    r_LE_E: F64
    """(n, 3) [m]."""
    seen: F64
    """(n, 2) [px]."""
    score: F64
    """(n,)."""
    candidates: int
    """Matches before the consensus."""


class Pass(NamedTuple):
    """Outcome of one render-and-match pass."""

    pose: Pose
    found: Found


def reach_px(lens: F64, shape: tuple[int, int], pose: Pose, P_pose: F64) -> float:
    """Three standard deviations of the prediction of the ground seen, the largest over the image [px]."""
    rows, columns = shape
    pixel = np.array([[x, y] for x in (0.1, 0.5, 0.9) for y in (0.1, 0.5, 0.9)]) * [columns, rows]
    rays = undistorted_px(lens, pixel) / lens[:2]
    distance = max(float(np.linalg.norm(pose.r_CE_E)) - 6.371e6, 1e5)
    ground = pose.r_CE_E + distance * np.column_stack([rays, np.ones(len(rays))]) @ pose.dcm_CE
    predicted, slopes = np.empty((len(pixel), 2)), np.empty((len(pixel), 2, 6))
    pose_derivatives(lens, ground, pose.r_CE_E, pose.dcm_CE, predicted, slopes)
    spread = np.einsum("nia,ab,njb->nij", slopes, P_pose, slopes)[np.isfinite(slopes[:, 0, 0])]
    if not len(spread):
        return np.inf
    return 3.0 * float(np.sqrt(max(np.linalg.eigvalsh(s)[-1] for s in spread)))


class Search:
    """A search in one photo."""

    def __init__(
        self, geo_map: GeoMap, lens: F64, photo: NDArray[np.uint8], spacing: int, scores: tuple[float, float]
    ) -> None:
        """Prepare.

        Args:
            geo_map: map and heights.
            lens: lens vector (11,).
            photo: grey image (rows, columns).
            spacing: pixels between chips.
            scores: least correlation of a match, and least lead over the next one.
        """
        self.geo_map, self.lens, self.photo, self.spacing, self.scores = geo_map, lens, photo, spacing, scores
        self.edges = edges(photo)

    def run(self, start: Pose, P_pose: F64) -> Found | None:
        """Landmarks, from an expected pose and its covariance (6, 6); None if not sure.

        The narrowest search that covers 3 sigma comes first; if it fails, the wider ones, for a prior may be worse
        than it says.
        """
        reach = self.reach_px(start, P_pose)
        ways: list[Callable[[], Pose | None]] = []
        if reach <= FINE_REACH_PX:
            ways.append(lambda: self._fine(start, max(12, int(np.ceil(reach)))))
        if reach <= COARSE_REACH_PX:
            ways.append(lambda: self._coarse(start))
        ways.append(lambda: self._cold(start))
        for way in ways:
            pose = way()
            found = None if pose is None else self._refine(pose)
            if found is not None:
                return found
        return None

    def reach_px(self, pose: Pose, P_pose: F64) -> float:
        """See `reach_px`."""
        return reach_px(self.lens, (self.photo.shape[0], self.photo.shape[1]), pose, P_pose)

    def _fine(self, start: Pose, window: int) -> Pose | None:
        done = self._pass(self.lens, self.photo, self.edges, start, window, 4.0, self.spacing)
        return None if done is None else done.pose

    def _coarse(self, start: Pose) -> Pose | None:
        rows, columns = (n // COARSE for n in self.photo.shape)
        small = CV.resize(
            self.photo[: rows * COARSE, : columns * COARSE], (columns, rows), interpolation=cv2.INTER_AREA
        )
        lens = scaled_lens(self.lens, COARSE)
        done = self._pass(lens, small, edges(small), start, COARSE_REACH_PX // COARSE, 2.0, 12)
        return None if done is None else done.pose

    def _cold(self, start: Pose) -> Pose | None:
        pose = acquire(self.geo_map, self.lens, self.photo, start.r_CE_E, start.dcm_CE)
        if pose is None:
            return None
        return self._fine(Pose(*pose), COLD_REACH_PX)

    def _refine(self, pose: Pose) -> Found | None:
        """Passes with narrow windows until the pose stands still."""
        for number, (window, threshold) in enumerate(REFINEMENTS):
            done = self._pass(self.lens, self.photo, self.edges, pose, window, threshold, self.spacing)
            if done is None or len(done.found.seen) < MIN_SHARE * done.found.candidates:
                return None
            moved = self._moved_px(pose, done.pose, done.found.r_LE_E)
            pose = done.pose
            if number > 0 and moved < SETTLED_PX:
                return done.found
        return None

    def _moved_px(self, before: Pose, after: Pose, r_LE_E: F64) -> float:
        pixels = [np.empty((len(r_LE_E), 2)) for _ in range(2)]
        slopes = np.empty((len(r_LE_E), 2, 6))
        for pose, pixel in zip((before, after), pixels, strict=True):
            pose_derivatives(self.lens, r_LE_E, pose.r_CE_E, pose.dcm_CE, pixel, slopes)
        return float(np.median(np.linalg.norm(pixels[1] - pixels[0], axis=1)))

    def _pass(
        self,
        lens: F64,
        photo: NDArray[np.uint8],
        photo_edges: NDArray[np.uint8],
        pose: Pose,
        window: int,
        threshold: float,
        spacing: int,
    ) -> Pass | None:
        """Render, match, find the consensus, fit the pose."""
        try:
            view = render_view(self.geo_map, lens, (photo.shape[0], photo.shape[1]), pose.r_CE_E, pose.dcm_CE)
        except MapError:
            return None
        centres = chip_centres(view, spacing)
        matches = match_chips(edges(view.image), photo_edges, centres, window, *self.scores)
        found = self._agreeing(lens, view, matches, threshold)
        if len(found.seen) < MIN_AGREE:
            return None
        sigma = sigma_of(found.score)
        fit = fit_pose(lens, found.r_LE_E, found.seen, sigma, pose.r_CE_E, pose.dcm_CE)
        if fit is None or fit.inlier.sum() < MIN_AGREE:
            return None
        return Pass(Pose(fit.r_CE_E, fit.dcm_CE), found)

    @staticmethod
    def _agreeing(lens: F64, view: View, matches: Matches, threshold: float) -> Found:
        rendered = matches.rendered.astype(float)
        ground = view.ground(rendered)
        agree = homography_consensus(undistorted_px(lens, rendered), undistorted_px(lens, matches.seen), threshold)
        agree &= np.isfinite(ground).all(axis=1)
        return Found(ground[agree], matches.seen[agree], matches.score[agree], len(matches.seen))
