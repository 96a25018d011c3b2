"""LimbFinder: points of the lit limb of a planet or moon in each image."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import Bound, In, Module, Out, Record
from messages.base import F64
from messages.environment import EphemerisMsg
from messages.opnav import MAX_LIMB, MAX_MODES, CameraConfigMsg, CameraImageMsg, OpNavLimbMsg
from messages.states import NavAttMsg
from modules.opnav.disks import Options, find_disks
from modules.opnav.disks.sun import view_of
from modules.opnav.limb_finder.compat import canny_points

BAD_IMAGE = 3
"""The image is too small or too large, or not one at all."""
MARS = 499
COMMON_PX = 0.03
"""Standard deviation of what the free profile is wrong by all around, where the Sun is not known [px]."""


class LimbFinder(Module):
    """Finds the lit limb of the greatest disk in images. See SPEC.md."""

    class Params(Record):
        """How it looks; see SPEC.md."""

        body_id: Annotated[int, "-", "NAIF identifier of the body"] = MARS
        min_radius_px: Annotated[float, "px", "least radius", Bound(ge=6)] = 8.0
        max_radius_px: Annotated[float, "px", "greatest radius", Bound(gt=0)] = 4000.0
        min_arc: Annotated[float, "rad", "least limb that makes a disk", Bound(gt=0, le=6.28)] = 0.7
        max_points: Annotated[int, "-", "points at most, evenly spread", Bound(ge=50, le=MAX_LIMB)] = MAX_LIMB
        basilisk: Annotated[bool, "-", "reproduce Basilisk's limbFinding; only then the ones below count"] = False
        blur_px: Annotated[int, "px", "side of the Gaussian kernel, odd", Bound(ge=1)] = 3
        canny_low: Annotated[float, "-", "lower threshold of the edges", Bound(gt=0)] = 100.0
        canny_high: Annotated[float, "-", "upper threshold of the edges", Bound(gt=0)] = 200.0
        least: Annotated[int, "-", "this many edge pixels or fewer are no limb", Bound(ge=0)] = 50

    params: Params
    in_image = In(CameraImageMsg)
    in_camera = In(CameraConfigMsg, optional=True)
    in_attitude = In(NavAttMsg, optional=True)
    in_sun = In(EphemerisMsg, optional=True)
    out_limb = Out(OpNavLimbMsg)

    def __init__(self, name: str, params: Params | None = None) -> None:
        """Make a finder.

        Args:
            name: unique name.
            params: see `Params`.

        Raises:
            ValueError: if the side of the kernel is even.
        """
        super().__init__(name, params)
        if self.params.blur_px % 2 == 0:
            raise ValueError(f"LimbFinder {name!r}: blur_px: expected an odd number, got {self.params.blur_px}")

    def step(self, t_ns: int) -> None:
        """Look for the limb in each new image."""
        image = self.in_image.take()
        if image is None:
            return
        message = self._basilisk(image) if self.params.basilisk else self._look(image)
        self.out_limb.write(message, t_ns)

    def _look(self, image: CameraImageMsg) -> OpNavLimbMsg:
        p = self.params
        view = view_of(self.in_camera.latest(), self.in_attitude.latest(), self.in_sun.latest())
        options = Options(p.min_radius_px, p.max_radius_px, p.min_arc, max_points=p.max_points, view=view)
        try:
            status, disks = find_disks(image.image, options)
        except ValueError:
            return self._message(image, np.empty((0, 2)), np.empty(0), BAD_IMAGE)
        if not disks:
            return self._message(image, np.empty((0, 2)), np.empty(0), int(status))
        limb = disks[0].limb
        modes = np.zeros((len(limb.x), MAX_MODES))
        modes[:, : limb.modes.shape[1]] = limb.modes if len(limb.modes) else 0.0
        common = 0.0 if len(limb.modes) else COMMON_PX
        return self._message(image, np.column_stack([limb.x, limb.y]), limb.sigma, int(status), common, modes)

    def _basilisk(self, image: CameraImageMsg) -> OpNavLimbMsg:
        p = self.params
        points = canny_points(image.image, p.blur_px, p.canny_low, p.canny_high, p.least)
        return self._message(image, points, np.full(len(points), np.nan), 0 if len(points) else 2)

    def _message(
        self,
        image: CameraImageMsg,
        points: F64,
        sigma: F64,
        status: int,
        common: float = 0.0,
        modes: F64 | None = None,
    ) -> OpNavLimbMsg:
        n, modes_px = len(points), np.zeros((MAX_LIMB, MAX_MODES))
        if modes is not None:
            modes_px[:n] = modes
        limb_px, sigma_px = np.full((MAX_LIMB, 2), np.nan), np.full(MAX_LIMB, np.nan)
        limb_px[:n], sigma_px[:n] = points, sigma
        return OpNavLimbMsg(
            exposure_ns=image.exposure_ns,
            valid=n > 0,
            status=status,
            body_id=self.params.body_id,
            count=n,
            limb_px=limb_px,
            sigma_px=sigma_px,
            common_px=common,
            modes_px=modes_px,
        )
