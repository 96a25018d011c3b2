"""The module: one set of landmarks per image."""

from __future__ import annotations

import enum
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw import Bound, In, Module, Out, Record
from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, CameraImageMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import dcm_from_beta
from modules.opnav.cells import cells_hit, evenly
from modules.opnav.landmark_finder.consensus import sigma_of
from modules.opnav.landmark_finder.search import Found, Pose, Search


class FinderStatus(enum.IntEnum):
    """The value of ``status`` in `LandmarksMsg`."""

    FOUND = 0
    NO_PRIOR = 1
    WRONG_SIZE = 2
    NOT_SURE = 3


class LandmarkFinder(Module):
    """Finds places of a georeferenced map in an image. See SPEC.md."""

    class Params(Record):
        """How densely and how strictly it looks."""

        spacing: Annotated[int, "px", "between the chips looked for, a multiple of 4", Bound(ge=4, le=200)] = 20
        min_score: Annotated[float, "-", "least normalised correlation of a match", Bound(gt=0, lt=1)] = 0.25
        min_lead: Annotated[float, "-", "least lead of a match over the next best", Bound(ge=0, lt=1)] = 0.04

    params: Params
    shared = ("geo_map",)
    in_image = In(CameraImageMsg)
    in_camera = In(CameraConfigMsg)
    in_prior = In(PosePriorMsg)
    out_landmarks = Out(LandmarksMsg)

    def __init__(self, name: str, geo_map: GeoMap, params: Params | None = None) -> None:
        """Make a finder.

        Args:
            name: unique name.
            geo_map: map and heights of where the camera may look.
            params: see `Params`.

        Raises:
            ValueError: if the spacing is not a multiple of 4.
        """
        super().__init__(name, params)
        if self.params.spacing % 4:
            raise ValueError(f"LandmarkFinder {name!r}: spacing: expected a multiple of 4, got {self.params.spacing}")
        self.geo_map = geo_map

    def step(self, t_ns: int) -> None:
        """Look for landmarks in each new image."""
        image = self.in_image.take()
        if image is None:
            return
        camera, prior = self.in_camera.latest(), self.in_prior.latest()
        if camera is None or prior is None or prior.exposure_ns != image.exposure_ns:
            message = nothing(image, FinderStatus.NO_PRIOR)
        elif image.image.shape[:2] != (camera.height_px, camera.width_px):
            message = nothing(image, FinderStatus.WRONG_SIZE)
        else:
            message = self._look(image, camera, prior)
        self.out_landmarks.write(message, t_ns)

    def _look(self, image: CameraImageMsg, camera: CameraConfigMsg, prior: PosePriorMsg) -> LandmarksMsg:
        grey = image.image if image.image.ndim == 2 else cv2.cvtColor(image.image, cv2.COLOR_RGB2GRAY)
        scores = (self.params.min_score, self.params.min_lead)
        search = Search(self.geo_map, lens_vector(camera), np.asarray(grey, np.uint8), self.params.spacing, scores)
        found = search.run(Pose(prior.r_CE_E, dcm_from_beta(prior.beta_CE)), prior.P_pose)
        return nothing(image, FinderStatus.NOT_SURE) if found is None else landmarks(image, found)


def nothing(image: CameraImageMsg, status: FinderStatus) -> LandmarksMsg:
    """The message that says: not sure of anything."""
    empty = Found(np.empty((0, 3)), np.empty((0, 2)), np.empty(0), 0)
    return _message(image, empty, np.arange(0, dtype=np.int64), 0, status)


def landmarks(image: CameraImageMsg, found: Found) -> LandmarksMsg:
    """The message of what was found: if there are more than it holds, the best, evenly spread.

    The candidates are then counted down in the same proportion, so that their ratio still says how many agreed.
    """
    kept = evenly(found.seen, found.score, image.image.shape[:2], MAX_LANDMARKS)
    candidates = round(found.candidates * len(kept) / len(found.seen))
    return _message(image, found, kept, candidates, FinderStatus.FOUND)


def _message(
    image: CameraImageMsg, found: Found, kept: NDArray[np.int64], candidates: int, status: FinderStatus
) -> LandmarksMsg:
    n = len(kept)
    ground, pixel = np.full((MAX_LANDMARKS, 3), np.nan), np.full((MAX_LANDMARKS, 2), np.nan)
    sigma, score = np.full(MAX_LANDMARKS, np.nan), np.full(MAX_LANDMARKS, np.nan)
    ground[:n], pixel[:n], score[:n] = found.r_LE_E[kept], found.seen[kept], found.score[kept]
    sigma[:n] = sigma_of(score[:n])
    return LandmarksMsg(
        exposure_ns=image.exposure_ns,
        count=n,
        candidates=candidates,
        cells=cells_hit(pixel[:n], image.image.shape[:2]),
        r_LE_E=ground,
        pixel_px=pixel,
        sigma_px=sigma,
        score=score,
        status=int(status),
        P_px=sigma[:, None, None] ** 2 * np.eye(2),
    )
