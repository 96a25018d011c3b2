"""Messages of optical navigation: images, cameras, landmarks, poses."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from messages.base import (
    F64,
    Bound,
    Mat3,
    Mat6,
    Message,
    NanOk,
    ObjectMessage,
    Shape,
    Vec2,
    Vec3,
    Vec4,
    eye,
    ones,
    unknown,
    zeros,
)

MAX_LANDMARKS = 1024
"""Capacity of `LandmarksMsg`."""
MAX_CIRCLES = 10
"""Capacity of `OpNavCirclesMsg`."""
MAX_LIMB = 2000
"""Capacity of `OpNavLimbMsg`."""
MAX_MODES = 8
"""Common causes of errors in `OpNavLimbMsg`."""


class CameraImageMsg(ObjectMessage):
    """An image and the time at the middle of its exposure."""

    image: Annotated[NDArray[np.uint8], "-", "grey (H, W) or colour (H, W, 3) in the order red, green, blue"]
    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    label: Annotated[str, "-", "where the image comes from, such as a file name"] = ""


class CameraConfigMsg(Message):
    """A pinhole camera with Brown-Conrady distortion, and how it is mounted on the body."""

    width_px: Annotated[int, "px", "columns", Bound(gt=0)]
    height_px: Annotated[int, "px", "rows", Bound(gt=0)]
    focal_px: Annotated[Vec2, "px", "focal length along x and y", Bound(gt=0)]
    center_px: Annotated[Vec2, "px", "principal point; the middle of the first pixel is (0, 0)"]
    skew_px: Annotated[float, "px", "skew of the pixel axes"] = 0.0
    distortion: Annotated[F64, Shape(5), "-", "k1, k2, p1, p2, k3 of Brown (1971), in OpenCV's order"] = zeros(5)
    dcm_CB: Annotated[F64, Shape(3, 3), "-", "maps body to camera components"] = eye(3)
    chromatic: Annotated[Vec3, "-", "scale of the red, green and blue image about the principal point", Bound(gt=0)] = (
        ones(3)
    )
    chromatic_k1: Annotated[Vec3, "-", "what red, green and blue add to k1"] = zeros(3)


class PosePriorMsg(Message):
    """Where the camera is expected to be at the exposure of an image."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    r_CE_E: Annotated[Vec3, "m", "position of the camera relative to the Earth's centre, Earth-fixed"]
    beta_CE: Annotated[Vec4, "-", "attitude of the camera relative to E, Euler parameters, scalar first"]
    P_pose: Annotated[Mat6, "m^2, m*rad, rad^2", "covariance of position (E) and attitude error (C)"]


class LandmarksMsg(Message):
    """Points of the ground found in an image; only the first ``count`` entries mean anything, and the rest is NaN."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    count: Annotated[int, "-", "landmarks found", Bound(ge=0, le=MAX_LANDMARKS)]
    candidates: Annotated[int, "-", "places looked at that had a match of their own, before the consensus", Bound(ge=0)]
    cells: Annotated[int, "-", "of a grid of 6 x 4 over the image, those with a landmark", Bound(ge=0, le=24)]
    r_LE_E: Annotated[F64, Shape(MAX_LANDMARKS, 3), "m", "position of each landmark, Earth-fixed", NanOk()]
    pixel_px: Annotated[F64, Shape(MAX_LANDMARKS, 2), "px", "where it was seen (column, row), distorted", NanOk()]
    sigma_px: Annotated[F64, Shape(MAX_LANDMARKS), "px", "standard deviation of each coordinate", NanOk()]
    score: Annotated[F64, Shape(MAX_LANDMARKS), "-", "normalised correlation at the match", NanOk()]
    status: Annotated[int, "-", "0 found, else why there is none; see the spec of the writer"] = 0
    P_px: Annotated[
        F64, Shape(MAX_LANDMARKS, 2, 2), "px^2", "covariance of each match (trace: 2 sigma_px^2)", NanOk()
    ] = unknown(MAX_LANDMARKS, 2, 2)


class PoseFixMsg(Message):
    """Position and attitude of the camera from one image. If not ``valid``, the numbers are not to be used."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "the fix passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    inliers: Annotated[int, "-", "landmarks used", Bound(ge=0)]
    candidates: Annotated[int, "-", "landmarks looked at before the consensus", Bound(ge=0)]
    cells: Annotated[int, "-", "of a grid of 6 x 4 over the image, those with an inlier", Bound(ge=0, le=24)]
    rms_px: Annotated[float, "px", "root mean square residual of the inliers, two-dimensional", NanOk()]
    r_CE_E: Annotated[Vec3, "m", "position of the camera relative to the Earth's centre, Earth-fixed", NanOk()]
    beta_CE: Annotated[Vec4, "-", "attitude of the camera relative to E, Euler parameters, scalar first", NanOk()]
    P_pose: Annotated[Mat6, "m^2, m*rad, rad^2", "covariance of position (E) and attitude error (C)", NanOk()]


class OpNavCirclesMsg(Message):
    """Disks of planets or moons found in an image, the surest first; beyond ``count`` the numbers are NaN."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "at least one disk was found that passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    body_id: Annotated[int, "-", "NAIF identifier of the body that the first disk is taken for"]
    count: Annotated[int, "-", "disks found", Bound(ge=0, le=MAX_CIRCLES)]
    center_px: Annotated[F64, Shape(MAX_CIRCLES, 2), "px", "centre of each disk (column, row)", NanOk()]
    radius_px: Annotated[F64, Shape(MAX_CIRCLES), "px", "radius of each disk", NanOk()]
    P_px: Annotated[F64, Shape(MAX_CIRCLES, 3, 3), "px^2", "covariance of column, row and radius", NanOk()]


class OpNavLimbMsg(Message):
    """Points of a lit limb; only the first ``count`` entries mean anything, and the rest is NaN."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "the points passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    body_id: Annotated[int, "-", "NAIF identifier of the body"]
    count: Annotated[int, "-", "points found", Bound(ge=0, le=MAX_LIMB)]
    limb_px: Annotated[F64, Shape(MAX_LIMB, 2), "px", "points of the limb (column, row), distorted", NanOk()]
    sigma_px: Annotated[F64, Shape(MAX_LIMB), "px", "standard deviation across the limb", NanOk()]
    common_px: Annotated[float, "px", "standard deviation of a shift outward that all points share", Bound(ge=0)] = 0.0
    modes_px: Annotated[
        F64, Shape(MAX_LIMB, MAX_MODES), "px", "shifts outward that go together: a column is one sigma of one cause"
    ] = zeros(MAX_LIMB, MAX_MODES)


class OpNavMsg(Message):
    """Position of the camera C relative to a body P from one image. Not ``valid``: the numbers are not to be used."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "the position passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    fault_detected: Annotated[bool, "-", "two image chains disagree"]
    body_id: Annotated[int, "-", "NAIF identifier of the body"]
    r_CP_N: Annotated[Vec3, "m", "position of the camera relative to the body's centre, N components", NanOk()]
    r_CP_B: Annotated[Vec3, "m", "the same in B components", NanOk()]
    r_CP_C: Annotated[Vec3, "m", "the same in C components", NanOk()]
    P_rr_N: Annotated[Mat3, "m^2", "covariance of the position, N components", NanOk()]
    P_rr_B: Annotated[Mat3, "m^2", "the same in B components", NanOk()]
    P_rr_C: Annotated[Mat3, "m^2", "the same in C components", NanOk()]


class OpNavBrightnessMsg(Message):
    """Centre of brightness of a body's lit part, which is not the body's centre. Not ``valid``: not to be used."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "a lit body was found that passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    body_id: Annotated[int, "-", "NAIF identifier of the body that the light is taken for"]
    center_px: Annotated[Vec2, "px", "centre of brightness (column, row), distorted", NanOk()]
    P_px: Annotated[F64, Shape(2, 2), "px^2", "covariance of column and row", NanOk()]
    area_px: Annotated[float, "px^2", "area of the lit part", NanOk()]


class OpNavDirectionMsg(Message):
    """Direction of a body P from the camera C from one image. If not ``valid``, the numbers are not to be used."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "the direction passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    body_id: Annotated[int, "-", "NAIF identifier of the body"]
    u_PC_N: Annotated[Vec3, "-", "unit vector from the camera to the body's centre, N components", NanOk()]
    u_PC_B: Annotated[Vec3, "-", "the same in B components", NanOk()]
    u_PC_C: Annotated[Vec3, "-", "the same in C components", NanOk()]
    P_uu_N: Annotated[Mat3, "-", "covariance of the unit vector, N components; none along it", NanOk()]
    P_uu_B: Annotated[Mat3, "-", "the same in B components", NanOk()]
    P_uu_C: Annotated[Mat3, "-", "the same in C components", NanOk()]
