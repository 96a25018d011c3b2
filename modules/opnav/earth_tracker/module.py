"""The module: one set of landmarks, with covariances, per image."""

from __future__ import annotations

import enum
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw import Bound, In, Module, Out, Record
from fsw.math.camera import lens_vector
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, CameraImageMsg, LandmarksMsg, PosePriorMsg
from modules.estimation.rotations import dcm_from_beta
from modules.opnav.cells import cells_hit
from modules.opnav.earth_tracker.track import Params as TrackerParams
from modules.opnav.earth_tracker.track import Tracked, Tracker
from modules.opnav.landmark_catalogue import Catalogue
from modules.opnav.landmark_finder.search import Pose


class TrackerStatus(enum.IntEnum):
    """The value of ``status`` in `LandmarksMsg`."""

    FOUND = 0
    NO_PRIOR = 1
    WRONG_SIZE = 2
    NOT_SURE = 3


class EarthTracker(Module):
    """Finds landmarks of a catalogue in an image. See SPEC.md."""

    class Params(Record):
        """How many, how strictly, and how good the map is."""

        most: Annotated[int, "-", "landmarks looked for in each image", Bound(ge=20, le=MAX_LANDMARKS)] = 160
        min_score: Annotated[float, "-", "least normalised correlation of a match", Bound(gt=0, lt=1)] = 0.3
        min_lead: Annotated[float, "-", "least lead of a match over the next best", Bound(ge=0, lt=1)] = 0.05
        sigma_map: Annotated[float, "-", "error of a coordinate on the map, in its finest pixels", Bound(ge=0)] = 0.25

    params: Params
    shared = ("catalogue",)
    in_image = In(CameraImageMsg)
    in_camera = In(CameraConfigMsg)
    in_prior = In(PosePriorMsg)
    out_landmarks = Out(LandmarksMsg)

    def __init__(self, name: str, catalogue: Catalogue, params: Params | None = None) -> None:
        """Make a tracker.

        Args:
            name: unique name.
            catalogue: landmarks of where the camera may look.
            params: see `Params`.
        """
        super().__init__(name, params)
        self.catalogue = catalogue

    def step(self, t_ns: int) -> None:
        """Look for landmarks in each new image."""
        image = self.in_image.take()
        if image is None:
            return
        camera, prior = self.in_camera.latest(), self.in_prior.latest()
        if camera is None or prior is None or prior.exposure_ns != image.exposure_ns:
            message = message_of(image, None, TrackerStatus.NO_PRIOR)
        elif image.image.shape[:2] != (camera.height_px, camera.width_px):
            message = message_of(image, None, TrackerStatus.WRONG_SIZE)
        else:
            tracked = self._look(image, camera, prior)
            status = TrackerStatus.NOT_SURE if tracked is None else TrackerStatus.FOUND
            message = message_of(image, tracked, status)
        self.out_landmarks.write(message, t_ns)

    def _look(self, image: CameraImageMsg, camera: CameraConfigMsg, prior: PosePriorMsg) -> Tracked | None:
        p = self.params
        wanted = TrackerParams(p.most, p.min_score, p.min_lead, p.sigma_map)
        tracker = Tracker(self.catalogue, lens_vector(camera), grey_of(image.image), wanted)
        return tracker.run(Pose(prior.r_CE_E, dcm_from_beta(prior.beta_CE)), prior.P_pose)


def grey_of(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A grey picture (rows, columns) of a grey or red, green, blue one."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def message_of(image: CameraImageMsg, tracked: Tracked | None, status: TrackerStatus) -> LandmarksMsg:
    """The message of what was found; None: nothing."""
    n = 0 if tracked is None else len(tracked.P_px)
    ground, pixel = np.full((MAX_LANDMARKS, 3), np.nan), np.full((MAX_LANDMARKS, 2), np.nan)
    score, P_px = np.full(MAX_LANDMARKS, np.nan), np.full((MAX_LANDMARKS, 2, 2), np.nan)
    if tracked is not None:
        ground[:n], pixel[:n] = tracked.r_LE_E, tracked.found.seen
        score[:n], P_px[:n] = tracked.found.score, tracked.P_px
    return LandmarksMsg(
        exposure_ns=image.exposure_ns,
        count=n,
        candidates=0 if tracked is None else tracked.candidates,
        cells=cells_hit(pixel[:n], image.image.shape[:2]),
        r_LE_E=ground,
        pixel_px=pixel,
        sigma_px=np.sqrt(0.5 * np.trace(P_px, axis1=1, axis2=2)),
        score=score,
        status=int(status),
        P_px=P_px,
    )
