"""Messages of filters and of attitude from directions: estimates with their covariance, and what measurements said."""

from __future__ import annotations

from typing import Annotated

from messages.base import F64, Bound, Mat3, Mat6, Message, NanOk, Shape, Vec3, Vec4


class OpNavFilterMsg(Message):
    """State of a filter of the orbit about a body P. Numbers of a measurement are NaN where there was none."""

    estimate_ns: Annotated[int, "ns", "time of the estimate, simulation time"]
    status: Annotated[int, "-", "0 a measurement was used, else why not; see the spec of the writer"]
    x: Annotated[F64, Shape(6), "m, m/s", "position and velocity of the camera relative to P, N components"]
    P: Annotated[Mat6, "m^2, m^2/s, m^2/s^2", "their covariance"]
    innovation: Annotated[Vec3, "m", "measured minus predicted position, N components", NanOk()]
    P_innovation: Annotated[Mat3, "m^2", "covariance of the innovation", NanOk()]
    nis: Annotated[float, "-", "normalised innovation squared", NanOk()]
    residual: Annotated[Vec3, "m", "measured minus estimated position after the update, N components", NanOk()]
    used: Annotated[int, "-", "measurements used since the start", Bound(ge=0)]
    refused: Annotated[int, "-", "measurements refused since the start", Bound(ge=0)]


class PixelLineFilterMsg(Message):
    """State of a filter of orbit and pixel bias. Numbers of a measurement are NaN where there was none."""

    estimate_ns: Annotated[int, "ns", "time of the estimate, simulation time"]
    status: Annotated[int, "-", "0 a measurement was used, else why not; see the spec of the writer"]
    x: Annotated[
        F64, Shape(9), "m, m/s, px", "position and velocity of the camera relative to P, N components, and bias"
    ]
    P: Annotated[F64, Shape(9, 9), "products of m, m/s, px", "their covariance"]
    innovation: Annotated[Vec3, "px", "measured minus predicted column, row and radius", NanOk()]
    P_innovation: Annotated[Mat3, "px^2", "covariance of the innovation", NanOk()]
    nis: Annotated[float, "-", "normalised innovation squared", NanOk()]
    residual: Annotated[Vec3, "px", "measured minus estimated column, row and radius after the update", NanOk()]
    used: Annotated[int, "-", "measurements used since the start", Bound(ge=0)]
    refused: Annotated[int, "-", "measurements refused since the start", Bound(ge=0)]


class HeadingFilterMsg(Message):
    """State of a filter of the direction to a body. Numbers of a measurement are NaN where there was none."""

    estimate_ns: Annotated[int, "ns", "time of the estimate, simulation time"]
    status: Annotated[int, "-", "0 a measurement was used, else why not; see the spec of the writer"]
    x: Annotated[
        F64, Shape(5), "-, rad/s", "direction to the body, B components, and angular rate about axes 2 and 3 of S"
    ]
    P: Annotated[F64, Shape(5, 5), "products of -, rad/s", "their covariance"]
    innovation: Annotated[Vec3, "-", "measured minus predicted direction, B components", NanOk()]
    P_innovation: Annotated[Mat3, "-", "covariance of the innovation", NanOk()]
    nis: Annotated[float, "-", "normalised innovation squared", NanOk()]
    residual: Annotated[Vec3, "-", "measured minus estimated direction after the update, B components", NanOk()]
    used: Annotated[int, "-", "measurements used since the start", Bound(ge=0)]
    refused: Annotated[int, "-", "measurements refused since the start", Bound(ge=0)]


MAX_DIRECTIONS = 16
"""Capacity of `DirectionsMsg`."""


class DirectionsMsg(Message):
    """Directions measured in B and known in N, such as to the Sun, along the field, to stars; beyond ``count`` NaN."""

    exposure_ns: Annotated[int, "ns", "time of the measurements, simulation time"]
    valid: Annotated[bool, "-", "the directions may be used"]
    count: Annotated[int, "-", "number of directions", Bound(ge=0, le=MAX_DIRECTIONS)]
    measured_B: Annotated[F64, Shape(MAX_DIRECTIONS, 3), "-", "measured directions, of any length, B", NanOk()]
    known_N: Annotated[F64, Shape(MAX_DIRECTIONS, 3), "-", "the same directions as known, of any length, N", NanOk()]
    sigma: Annotated[F64, Shape(MAX_DIRECTIONS), "rad", "standard deviation about each axis across it", NanOk()]


class AttitudeFixMsg(Message):
    """Attitude from directions of one instant. If not ``valid``, the numbers are NaN."""

    exposure_ns: Annotated[int, "ns", "time of the measurements, simulation time"]
    valid: Annotated[bool, "-", "the attitude passed every check"]
    status: Annotated[int, "-", "0 valid, else the check that failed; see the spec of the writer"]
    beta_BN: Annotated[Vec4, "-", "attitude of B relative to N, Euler parameters, scalar first, not negative", NanOk()]
    P_att: Annotated[Mat3, "rad^2", "covariance of the attitude error, B components", NanOk()]
    loss: Annotated[float, "-", "weighted squares that remain, by their degrees of freedom; about 1", NanOk()]
