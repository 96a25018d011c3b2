"""Messages of orbits, of the clock of a camera, and of what is estimated about both."""

from __future__ import annotations

from typing import Annotated

from messages.base import F64, Bound, Message, NanOk, Shape, Vec2, Vec3


class PhotoTimeMsg(Message):
    """What is known of the time of a photo, and how it is to be looked for."""

    exposure_ns: Annotated[
        int, "ns", "middle of the exposure as far as the stamps tell, simulation time; names the photo"
    ]
    earliest_ns: Annotated[int, "ns", "the exposure was not before this"]
    latest_ns: Annotated[int, "ns", "the exposure was not after this"]
    sigma_s: Annotated[float, "s", "standard deviation of exposure_ns", Bound(ge=0)]
    even: Annotated[bool, "-", "the shutter ran evenly, so that the errors of all photos lie on a line in time"] = False
    attempt: Annotated[int, "-", "how often this photo was tried before without success", Bound(ge=0)] = 0
    last: Annotated[bool, "-", "no other photo of this round follows"] = False
    calibrate: Annotated[bool, "-", "lens, mounting and clock are to be estimated at the end of this round"] = False


class OrbitClockMsg(Message):
    """How the true track departs from the approximate orbit, and the shutter's clock from the stamps."""

    photos: Annotated[int, "-", "photos with a valid fix that went in", Bound(ge=0)]
    landmarks: Annotated[int, "-", "landmarks that went in", Bound(ge=0)]
    rms_px: Annotated[float, "px", "root mean square residual, two-dimensional, with robust weights", NanOk()]
    reference_ns: Annotated[int, "ns", "simulation time to which offset and clock refer"]
    offset_H: Annotated[Vec3, "m", "true minus approximate position: radial, along track, normal"]
    rate_T: Annotated[float, "m/s", "rate of the along-track offset"]
    clock_s: Annotated[float, "s", "to add to exposure times at the reference"]
    clock_rate: Annotated[float, "-", "growth of that correction with time"]
    P: Annotated[F64, Shape(6, 6), "m, m/s, s, -", "covariance of offset_H, rate_T, clock_s, clock_rate"]


class CameraAccuracyMsg(Message):
    """How well lens and mounting are known; never written while the mounting is unknown."""

    photos: Annotated[int, "-", "photos that went into the calibration", Bound(ge=0)]
    rms_px: Annotated[float, "px", "root mean square residual of the calibration, two-dimensional", NanOk()]
    sigma_focal_px: Annotated[float, "px", "standard deviation of the focal length", Bound(ge=0)]
    sigma_center_px: Annotated[Vec2, "px", "standard deviation of the principal point", Bound(ge=0)]
    sigma_distortion: Annotated[F64, Shape(5), "-", "standard deviations of k1, k2, p1, p2, k3", Bound(ge=0)]
    sigma_mounting: Annotated[Vec3, "rad", "of one photo's attitude relative to the mounting, about C", Bound(gt=0)]
    sigma_common_H: Annotated[Vec3, "m", "error that all fixes share: radial, along track, normal", Bound(ge=0)]
