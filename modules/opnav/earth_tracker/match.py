"""One look at an image: landmarks of the catalogue in view, as the camera would see them, found or not."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.cells import evenly
from modules.opnav.earth_tracker.kernel import OUT, back_project, refine_all, warp_chips
from modules.opnav.landmark_catalogue import CHIP, Catalogue
from modules.opnav.landmark_finder.consensus import homography_consensus, undistorted_px
from modules.opnav.landmark_finder.correlate import WORKERS, match_templates
from modules.opnav.landmark_finder.search import Pose

HALF = 16
"""Templates are 2 HALF + 1 pixels wide."""
MARGIN = 5
"""More pixels on each side, for the edges' smoothing."""
ZOOM = (0.8, 1.8)
"""Pixels of the image to one of a chip: below, the chip does not fill the template; above, it is too coarse."""
BLUR_PX = 1.0
GAIN = 10.0
THIRD = (2 * HALF + 1) // 6
WINDOW_SIGMA = 0.9
"""Standard deviation of the weights of the fine matching, to HALF."""
CV: Any = cv2


class Candidates(NamedTuple):
    """Landmarks matched one by one; n of them."""

    mark: NDArray[np.int64]
    """(n,) in the catalogue."""
    predicted: F64
    """(n, 2) [px]."""
    seen: F64
    """(n, 2) [px]."""
    score: F64
    """(n,) normalised correlation."""

    def pick(self, which: NDArray[Any]) -> Candidates:
        """Those that an index or mask array names."""
        return Candidates(self.mark[which], self.predicted[which], self.seen[which], self.score[which])


class Fine(NamedTuple):
    """Landmarks after the fine matching."""

    found: Candidates
    P_px: F64
    """(n, 2, 2) covariance [px^2]."""
    middle: F64
    """(n,) correlation of the innermost third."""
    contrast: F64
    """(n,) contrast to the map's."""
    level: F64
    """(n, 2) mean grey level of the innermost third, in the photo and on the map."""


class Templates(NamedTuple):
    """Chips as seen."""

    mark: NDArray[np.int64]
    """(n,) in the catalogue."""
    predicted: F64
    """(n, 2) predicted places [px]."""
    centre: NDArray[np.int64]
    """(n, 2) pixels on which the templates are centred."""
    edges: NDArray[np.uint8]
    """(n, 2 HALF + 3, 2 HALF + 3)."""
    level: F64
    """(n,) mean grey level of the innermost third."""


class Stopwatch:
    """Seconds spent in each stage."""

    def __init__(self) -> None:
        """Start at nothing."""
        self.spent: dict[str, float] = {}
        self.used: dict[str, float] = {}
        """Processor time of all threads."""
        self._since = time.perf_counter(), time.process_time()

    def start(self) -> None:
        """Begin a stage."""
        self._since = time.perf_counter(), time.process_time()

    def stop(self, stage: str) -> None:
        """End it, and begin the next."""
        now = time.perf_counter(), time.process_time()
        for total, end, begin in zip((self.spent, self.used), now, self._since, strict=True):
            total[stage] = total.get(stage, 0.0) + end - begin
        self._since = now


def edge_image(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Square root of the smoothed gradient's magnitude; as `landmark_finder.correlate.edges`, but for speed."""
    smooth = CV.GaussianBlur(grey.astype(np.float32), (0, 0), BLUR_PX)
    magnitude = CV.magnitude(CV.Sobel(smooth, cv2.CV_32F, 1, 0), CV.Sobel(smooth, cv2.CV_32F, 0, 1))
    return CV.convertScaleAbs(CV.sqrt(magnitude), alpha=GAIN)


class Look:
    """An image, at one scale, and what it takes to look at it."""

    def __init__(self, catalogue: Catalogue, lens: F64, photo: NDArray[np.uint8], watch: Stopwatch) -> None:
        """Prepare.

        Args:
            catalogue: landmarks.
            lens: lens vector (11,) of this scale.
            photo: grey (rows, columns).
            watch: where the time goes.
        """
        self.catalogue, self.lens, self.watch = catalogue, lens, watch
        self.shape = photo.shape[0], photo.shape[1]
        watch.start()
        self.edges = edge_image(photo)
        self.levels = CV.blur(photo, (2 * THIRD + 1, 2 * THIRD + 1))
        watch.stop("edges")

    def templates(self, pose: Pose, most: int) -> Templates:
        """The best landmarks in view, evenly spread, at most ``most``, as the camera would see them."""
        self.watch.start()
        marks = self.catalogue.landmarks
        seen = self.catalogue.in_view(self.lens, self.shape, pose.r_CE_E, pose.dcm_CE, HALF + 2)
        right = np.flatnonzero((seen.zoom >= ZOOM[0]) & (seen.zoom < ZOOM[1]))
        worst = marks.sigma[seen.mark[right], 1] * seen.zoom[right]
        chosen = right[evenly(seen.pixel[right], -worst, self.shape, most)]
        index, predicted = seen.mark[chosen], np.ascontiguousarray(seen.pixel[chosen])
        centre = np.rint(predicted).astype(np.int64)
        self.watch.stop("query")
        reach = HALF + MARGIN
        if not len(index):
            return Templates(index, predicted, centre, np.empty((0, 2 * HALF + 3, 2 * HALF + 3), np.uint8), np.empty(0))
        nodes = np.empty((len(index), 3, 3, 2))
        places = marks.lat[index], marks.lon[index], marks.r_LE_E[index], marks.slope[index], marks.gsd[index]
        camera = self.lens, np.ascontiguousarray(pose.r_CE_E), np.ascontiguousarray(pose.dcm_CE)
        back_project(*camera, *places, centre, reach, 0.5 * (CHIP - 1.0), nodes)
        warped, whole = np.empty((len(index), 2 * reach + 1, 2 * reach + 1), np.uint8), np.empty(len(index))
        warp_chips(marks.chips, index, nodes, reach, warped, whole)
        strip = edge_image(warped.reshape(-1, 2 * reach + 1)).reshape(warped.shape)
        inner = np.ascontiguousarray(strip[:, MARGIN - 1 : 1 - MARGIN, MARGIN - 1 : 1 - MARGIN])
        third = slice(reach - THIRD, reach + THIRD + 1)
        level = warped[:, third, third].mean(axis=(1, 2))
        keep = whole > 0.85
        self.watch.stop("warp")
        return Templates(index[keep], predicted[keep], centre[keep], inner[keep], level[keep])

    def candidates(
        self, templates: Templates, window: int, scores: tuple[float, float]
    ) -> tuple[Candidates, NDArray[np.int64]]:
        """Templates with a peak of their own within ``window`` pixels, and which of the templates they are."""
        self.watch.start()
        inner = np.ascontiguousarray(templates.edges[:, 1:-1, 1:-1])
        peaks = match_templates(inner, self.edges, templates.centre, window, *scores)
        good = np.flatnonzero(np.isfinite(peaks[:, 0]))
        fraction = templates.predicted[good] - templates.centre[good]
        seen = templates.centre[good] + peaks[good, :2] - window + fraction
        rows, columns = self.shape
        inside = (seen >= HALF).all(axis=1) & (seen[:, 0] < columns - HALF) & (seen[:, 1] < rows - HALF)
        good, seen = good[inside], seen[inside]
        self.watch.stop("correlate")
        return Candidates(templates.mark[good], templates.predicted[good], seen, peaks[good, 2]), good

    def agreeing(self, found: Candidates, threshold: float) -> NDArray[np.bool_]:
        """Which candidates agree with one homography from predicted to seen places, to ``threshold`` pixels."""
        self.watch.start()
        ideal = undistorted_px(self.lens, found.predicted), undistorted_px(self.lens, found.seen)
        agree = homography_consensus(*ideal, threshold)
        self.watch.stop("consensus")
        return agree

    def refine(self, templates: Templates, found: Candidates, which: NDArray[np.int64]) -> Fine:
        """Fine matching of candidates; those that do not settle drop out."""
        self.watch.start()
        axis = np.arange(-HALF, HALF + 1) / (WINDOW_SIGMA * HALF)
        weight = np.exp(-0.5 * (axis[:, None] ** 2 + axis**2))
        fraction = templates.predicted[which] - templates.centre[which]
        photo, cut = self.edges.astype(np.float32), templates.edges[which].astype(np.float32)
        start, out = np.ascontiguousarray(found.seen - fraction), np.empty((len(which), OUT))

        def share(first: int) -> None:
            refine_all(photo, cut, weight, start, first, WORKERS, out)

        with ThreadPoolExecutor(WORKERS) as pool:
            list(pool.map(share, range(WORKERS)))
        good = np.flatnonzero(np.isfinite(out).all(axis=1))
        out = out[good]
        P_px = out[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
        settled = found.pick(good)._replace(seen=out[:, :2] + fraction[good], score=out[:, 5])
        self.watch.stop("refine")
        column, row = np.rint(out[:, :2]).astype(np.int64).T
        level = np.column_stack([self.levels[row, column], templates.level[which][good]]).astype(float)
        return Fine(settled, P_px, out[:, 6], out[:, 7] ** 2, level)
