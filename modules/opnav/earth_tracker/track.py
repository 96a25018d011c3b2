"""From an expected pose to landmarks with covariances: which search comes when, and what passes the gates."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.math.resection import Resection, fit_pose, pose_derivatives
from messages.base import F64
from modules.opnav.earth_tracker.cold import cold_start
from modules.opnav.earth_tracker.match import ZOOM, Candidates, Fine, Look, Stopwatch
from modules.opnav.landmark_catalogue import Catalogue
from modules.opnav.landmark_finder.render import scaled_lens
from modules.opnav.landmark_finder.search import Pose, reach_px

FINE_REACH_PX = 24
"""Errors of the expected pose beyond this take a coarse search first."""
COARSE = ((2, 48, 120), (4, 96, 520), (2, 96, 240))
"""Coarse searches, in their order: pixels how many times as large; least and largest half-width of the search [px]."""
TURN_RAD = 0.1
"""If the turn about the boresight is less certain than this, turns are tried,"""
TURNS = 36
"""so many of them: edges correlate to some 6 degrees."""
AFTER_PX = 12
"""Half-width of the search after another one has found the pose."""
LAST_PX = 5
"""Half-width of the search of the last pass."""
CONSENSUS_PX = 3.0
MIN_AGREE = 12
"""Fewest matches that agree."""
MIN_AGREE_COARSE = 8
MIN_SHARE = 0.4
"""Least share of the matches of the last pass that agree."""
MIN_RIGHT = 0.6
"""Least share of these that fit the pose within their covariances."""
MIN_MIDDLE = 0.5
"""Least correlation of the middle of a match: a place under cloud may match by its surroundings."""
VEILS = ((0.0, 0.28), (0.3, 0.35), (0.7, 0.6), (1.3, 0.8), (2.0, 1.0), (5.0, np.inf))
"""A match is under cloud if it is brighter than the map says by more than the first number (in standard deviations of
all matches) and has less than the second of their median contrast."""
MIN_CLEAR = 0.03
"""So is one whose contrast over brightness is less than this part of the map's: three quarters of cloud leave a quarter
of the contrast and more than double the brightness, and haze and tone curve leave some third of the rest."""
FLOOR_PX = 0.03
"""Standard deviation of what interpolation and quantisation leave, added to every match."""
MAX_SIGMA_PX = 1.0
"""Matches less certain than this are of no use."""
GATE2 = 9.21
"""Squared length of a residual over its covariance that a right match exceeds once in a hundred."""
GATE_ROUNDS = 10
SETTLED_PX = 1.0
"""The last pass is repeated, from the pose it found, if the landmarks' prediction moves by more than this."""
CV: Any = cv2
LINALG: Any = np.linalg


class Params(NamedTuple):
    """What a person may set; see the spec."""

    most: int = 160
    min_score: float = 0.3
    min_lead: float = 0.05
    sigma_map: float = 0.25
    """A quarter of a pixel: by so much a map is displaced of which every second row and column was picked."""


class Tracked(NamedTuple):
    """Landmarks that passed; n of them."""

    found: Candidates
    r_LE_E: F64
    """(n, 3) [m]."""
    P_px: F64
    """(n, 2, 2) covariance [px^2]."""
    candidates: int
    """Matches before the consensus."""
    fit: Resection
    """The pose that they fix."""
    r_missed_E: F64
    """(m, 3) [m], of those looked for that did not pass."""


def veiled(fine: Fine) -> NDArray[np.bool_]:
    """Which matches lie under cloud: brighter and flatter than the others, or than any ground, given the map."""
    rows = np.column_stack([np.ones(len(fine.level)), fine.level[:, 1]])
    weight, error, spread = np.ones(len(rows)), fine.level[:, 0], 1.0
    for _ in range(10):  # a line through the levels of map and photo, robust
        line = np.linalg.lstsq(rows * weight[:, None], fine.level[:, 0] * weight, rcond=None)[0]
        error = fine.level[:, 0] - rows @ line
        spread = 1.4826 * float(np.median(np.abs(error))) + 1e-9
        weight = (1.0 + (error / spread) ** 2) ** -0.25
    brighter, contrast = error / spread, fine.contrast / np.median(fine.contrast)
    clear = fine.contrast * (fine.level[:, 1] + 1.0) / (fine.level[:, 0] + 1.0)
    return np.any([(brighter > b) & (contrast < c) for b, c in VEILS], axis=0) | (clear < MIN_CLEAR)


class Tracker:
    """A search in one image."""

    def __init__(self, catalogue: Catalogue, lens: F64, photo: NDArray[np.uint8], params: Params) -> None:
        """Prepare.

        Args:
            catalogue: landmarks.
            lens: lens vector (11,).
            photo: grey (rows, columns).
            params: see `Params`.
        """
        self.catalogue, self.lens, self.photo, self.params = catalogue, lens, photo, params
        self.shape = photo.shape[0], photo.shape[1]
        self.watch = Stopwatch()
        self._looks: dict[int, Look] = {}

    def run(self, start: Pose, P_pose: F64) -> Tracked | None:
        """Landmarks, from an expected pose and its covariance (6, 6); None if not sure.

        The narrowest search that covers 3 sigma comes first; then the wider ones, for a prior may be worse than it
        says.
        """
        reach = reach_px(self.lens, self.shape, start, P_pose)
        ways: list[Callable[[], Pose | None]] = []
        if reach <= FINE_REACH_PX:
            ways.append(lambda: self._step(start, 1, max(8, int(np.ceil(reach)))))
        for coarse, least, largest in COARSE:
            if reach <= 2.0 * largest:  # a window that covers half of it is worth a try: the rest takes seconds
                window = min(max(least, int(np.ceil(reach))), largest)
                ways.append(functools.partial(self._step, start, coarse, window))
        if P_pose[5, 5] > TURN_RAD**2:
            ways.append(lambda: self._turned(start))
        ways.append(lambda: self._cold(start, P_pose))
        for number, way in enumerate(ways):
            pose = way()
            if pose is not None and not (number == 0 and reach <= FINE_REACH_PX):
                pose = self._step(pose, 1, AFTER_PX)
            tracked = None if pose is None else self._last(pose)
            if tracked is not None:
                return tracked
        return None

    def _turned(self, start: Pose) -> Pose | None:
        """A coarse search for every turn about the boresight."""
        coarse, _, window = COARSE[1]
        for k in range(1, TURNS):
            c, s = np.cos(2.0 * np.pi * k / TURNS), np.sin(2.0 * np.pi * k / TURNS)
            turned = Pose(start.r_CE_E, np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ start.dcm_CE)
            pose = self._step(turned, coarse, window)
            pose = None if pose is None else self._step(pose, coarse, 60) or self._step(pose, 1, 2 * AFTER_PX)
            if pose is not None:
                return pose
        return None

    def _cold(self, start: Pose, P_pose: F64) -> Pose | None:
        self.watch.start()
        pose = cold_start(self.catalogue, self.lens, self.photo, start, P_pose)
        self.watch.stop("cold start")
        return None if pose is None else self._step(pose, 4, 60) or self._step(pose, 1, 2 * AFTER_PX)

    def _scale(self, pose: Pose) -> int:
        """How much smaller the image must be for the finest chips to be fine enough."""
        seen = self.catalogue.in_view(self.lens, self.shape, pose.r_CE_E, pose.dcm_CE, 0.0)
        finest = seen.zoom[self.catalogue.landmarks.gsd[seen.mark] < 1.5 * self.catalogue.gsd]
        scale = 1
        while len(finest) and scale < 64 and float(np.median(finest)) / scale >= ZOOM[1]:
            scale *= 2
        return scale

    def _look(self, scale: int) -> Look:
        if scale not in self._looks:
            rows, columns = (n // scale for n in self.shape)
            small = self.photo[: rows * scale, : columns * scale]
            if scale > 1:
                small = CV.resize(small, (columns, rows), interpolation=cv2.INTER_AREA)
            self._looks[scale] = Look(self.catalogue, scaled_lens(self.lens, scale), small, self.watch)
        return self._looks[scale]

    def _step(self, pose: Pose, coarse: int, window_px: int) -> Pose | None:
        """A better pose from a search within ``window_px`` pixels of the image."""
        scale = self._scale(pose) * coarse
        look = self._look(scale)
        window = max(4, -(-window_px // scale))
        found, _ = look.candidates(look.templates(pose, self.params.most), window, self._scores)
        agree = look.agreeing(found, CONSENSUS_PX if coarse == 1 else 2.0)
        if agree.sum() < (MIN_AGREE if coarse == 1 else MIN_AGREE_COARSE):
            return None
        fit = self._fit(look, found.pick(agree), np.ones(int(agree.sum())), pose)
        return None if fit is None else Pose(fit.r_CE_E, fit.dcm_CE)

    @property
    def _scores(self) -> tuple[float, float]:
        return self.params.min_score, self.params.min_lead

    def _fit(self, look: Look, found: Candidates, sigma: F64, pose: Pose) -> Resection | None:
        look.watch.start()
        places = self.catalogue.landmarks.r_LE_E[found.mark]
        fit = fit_pose(look.lens, places, found.seen, sigma, pose.r_CE_E, pose.dcm_CE)
        look.watch.stop("pose")
        return fit

    def _last(self, pose: Pose) -> Tracked | None:
        """Passes with a narrow window and fine matching, until the pose stands still; then the gates."""
        for _ in range(3):
            scale = self._scale(pose)
            look = self._look(scale)
            templates = look.templates(pose, self.params.most)
            found, which = look.candidates(templates, LAST_PX, self._scores)
            total = len(found.seen)
            agree = np.flatnonzero(look.agreeing(found, CONSENSUS_PX))
            if len(agree) < max(MIN_AGREE, MIN_SHARE * total):
                return None
            fine = look.refine(templates, found.pick(agree), which[agree])
            if len(fine.middle) < MIN_AGREE:
                return None
            tracked = self._gate(look, fine, templates.mark, total, pose)
            if tracked is None:
                return None
            moved = self._moved(look, pose, tracked)
            if moved < SETTLED_PX:
                return self._full_size(tracked, scale)
            pose = Pose(tracked.fit.r_CE_E, tracked.fit.dcm_CE)
        return None

    def _gate(self, look: Look, fine: Fine, wanted: NDArray[np.int64], total: int, pose: Pose) -> Tracked | None:
        """Drop what is uncertain or under cloud, and what disagrees with the pose beyond its covariance."""
        P_px = fine.P_px + FLOOR_PX**2 * np.eye(2)
        sigma = np.sqrt(0.5 * np.trace(P_px, axis1=1, axis2=2))
        keep = np.flatnonzero((fine.middle >= MIN_MIDDLE) & (sigma <= MAX_SIGMA_PX) & ~veiled(fine))
        usable, grow, fit = len(keep), 1.0, None
        for _ in range(GATE_ROUNDS):
            if len(keep) < MIN_AGREE:
                return None
            fit = self._fit(look, fine.found.pick(keep), sigma[keep], pose)
            if fit is None:
                return None
            pose = Pose(fit.r_CE_E, fit.dcm_CE)
            precision: F64 = LINALG.inv(P_px[keep])
            error2: F64 = np.einsum("ni,nij,nj->n", fit.residual_px, precision, fit.residual_px)
            # Half of all squared lengths lie below 1.39 if the covariances are right; what is above is theirs to carry
            grow = max(1.0, float(np.median(error2)) / 1.386 * len(keep) / (len(keep) - 3.0))
            inside = error2 <= GATE2 * grow
            if inside.all():
                break
            keep = keep[inside]
        if fit is None or len(keep) < max(MIN_AGREE, MIN_RIGHT * usable) or len(keep) != len(fit.inlier):
            return None
        places = self.catalogue.landmarks.r_LE_E[fine.found.mark[keep]]
        # what the map errs by is mostly the same for all landmarks, so that the pose takes it up and the gates see none
        away = np.linalg.norm(places - fit.r_CE_E, axis=1)
        shift_px = self.params.sigma_map * self.catalogue.gsd * np.sqrt(look.lens[0] * look.lens[1]) / away
        P_map = shift_px[:, None, None] ** 2 * np.eye(2)
        missed = self.catalogue.landmarks.r_LE_E[np.setdiff1d(wanted, fine.found.mark[keep])]
        return Tracked(fine.found.pick(keep), places, grow * P_px[keep] + P_map, total, fit, missed)

    @staticmethod
    def _moved(look: Look, before: Pose, tracked: Tracked) -> float:
        """How far the prediction of the landmarks moved with the fit (median) [px]."""
        n = len(tracked.r_LE_E)
        pixel, slopes = np.empty((n, 2)), np.empty((n, 2, 6))
        pose_derivatives(look.lens, tracked.r_LE_E, before.r_CE_E, before.dcm_CE, pixel, slopes)
        after = tracked.found.seen - tracked.fit.residual_px
        return float(np.median(np.linalg.norm(after - pixel, axis=1)))

    @staticmethod
    def _full_size(tracked: Tracked, scale: int) -> Tracked:
        """The same in pixels of the image."""
        if scale == 1:
            return tracked
        found = tracked.found
        found = found._replace(seen=(found.seen + 0.5) * scale - 0.5, predicted=(found.predicted + 0.5) * scale - 0.5)
        fit = tracked.fit._replace(residual_px=tracked.fit.residual_px * scale)
        return tracked._replace(found=found, P_px=tracked.P_px * scale**2, fit=fit)
