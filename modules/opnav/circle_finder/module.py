"""CircleFinder: the disks of planets and moons in each image."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, Module, Out, Record
from messages.base import F64
from messages.environment import EphemerisMsg
from messages.opnav import MAX_CIRCLES, CameraConfigMsg, CameraImageMsg, OpNavCirclesMsg
from messages.states import NavAttMsg
from modules.opnav.circle_finder.compat import hough_circles
from modules.opnav.disks import Options, find_disks
from modules.opnav.disks.sun import view_of

BAD_IMAGE = 3
"""The image is too small or too large, or not one at all."""
MARS = 499


class CircleFinder(Module):
    """Finds disks of planets and moons in images. See SPEC.md."""

    class Params(Record):
        """How it looks; see SPEC.md."""

        body_id: Annotated[int, "-", "NAIF identifier of the body that the first disk is taken for"] = MARS
        min_radius_px: Annotated[float, "px", "least radius", Bound(ge=6)] = 8.0
        max_radius_px: Annotated[float, "px", "greatest radius", Bound(gt=0)] = 4000.0
        min_arc: Annotated[float, "rad", "least limb that makes a disk", Bound(gt=0, le=6.28)] = 0.7
        most: Annotated[int, "-", "disks at most", Bound(ge=1, le=MAX_CIRCLES)] = MAX_CIRCLES
        basilisk: Annotated[bool, "-", "reproduce Basilisk's houghCircles; only then the ones below count"] = False
        blur_px: Annotated[int, "px", "side of the box blur", Bound(ge=1)] = 5
        canny: Annotated[float, "-", "upper threshold of the edges", Bound(gt=0)] = 200.0
        votes: Annotated[float, "-", "least votes", Bound(gt=0)] = 20.0
        min_distance_px: Annotated[float, "px", "least distance between centres", Bound(gt=0)] = 50.0
        hough_min_radius_px: Annotated[int, "px", "least radius", Bound(ge=0)] = 0
        hough_max_radius_px: Annotated[int, "px", "greatest radius; 0 means any", Bound(ge=0)] = 0
        accumulator: Annotated[float, "px", "size of a cell of the accumulator", Bound(ge=1)] = 1.0
        noise_factor: Annotated[float, "px^2", "variance for each least number of votes", Bound(gt=0)] = 4.0

    params: Params
    in_image = In(CameraImageMsg)
    in_camera = In(CameraConfigMsg, optional=True)
    in_attitude = In(NavAttMsg, optional=True)
    in_sun = In(EphemerisMsg, optional=True)
    out_circles = Out(OpNavCirclesMsg)

    def step(self, t_ns: int) -> None:
        """Look for disks in each new image."""
        image = self.in_image.take()
        if image is None:
            return
        message = self._basilisk(image) if self.params.basilisk else self._look(image)
        self.out_circles.write(message, t_ns)

    def _look(self, image: CameraImageMsg) -> OpNavCirclesMsg:
        p = self.params
        view = view_of(self.in_camera.latest(), self.in_attitude.latest(), self.in_sun.latest())
        options = Options(p.min_radius_px, p.max_radius_px, p.min_arc, p.most, view=view)
        try:
            status, disks = find_disks(image.image, options)
        except ValueError:
            return self._message(image, np.empty((0, 3)), np.empty((0, 3, 3)), BAD_IMAGE)
        circles = np.array([d.ellipse[:3] for d in disks]).reshape(-1, 3)
        P = np.array([d.P[:3, :3] for d in disks]).reshape(-1, 3, 3)
        return self._message(image, circles, P, int(status))

    def _basilisk(self, image: CameraImageMsg) -> OpNavCirclesMsg:
        p = self.params
        radii = p.hough_min_radius_px, p.hough_max_radius_px
        found = hough_circles(image.image, p.blur_px, p.canny, p.votes, p.min_distance_px, radii, p.accumulator, p.most)
        # Of the last circle, and larger with more votes: so it is there
        variance = p.noise_factor * found[-1, 3] / p.votes if len(found) else math.nan
        return self._message(
            image, found[:, :3], np.tile(variance * np.eye(3), (len(found), 1, 1)), 0 if len(found) else 2
        )

    def _message(self, image: CameraImageMsg, circles: F64, P: F64, status: int) -> OpNavCirclesMsg:
        n = len(circles)
        center, radius = np.full((MAX_CIRCLES, 2), np.nan), np.full(MAX_CIRCLES, np.nan)
        covariance = np.full((MAX_CIRCLES, 3, 3), np.nan)
        center[:n], radius[:n], covariance[:n] = circles[:, :2], circles[:, 2], P
        return OpNavCirclesMsg(
            exposure_ns=image.exposure_ns,
            valid=n > 0,
            status=status,
            body_id=self.params.body_id,
            count=n,
            center_px=center,
            radius_px=radius,
            P_px=covariance,
        )
