"""Messages of filters and of attitude from directions: estimates with their covariance, and what measurements said."""

from __future__ import annotations

from typing import Annotated

from messages.base import F64, I64, Bound, Mat3, Mat6, Message, NanOk, Shape, Vec2, Vec3, Vec4


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


class EarthTrackerFilterMsg(Message):
    """State of the Earth tracker's filter. Sensors: landmarks, GPS, gyro, Sun sensors, magnetometer, tracker, stars."""

    estimate_ns: Annotated[int, "ns", "time of the estimate, simulation time"]
    status: Annotated[int, "-", "0 the estimate is for now, 9 there is no prediction to now"]
    x: Annotated[
        F64, Shape(13), "m, m/s, -, rad/s", "r_BN_N, v_BN_N, beta_BO (scalar first), omega_BO_B; O is the orbit frame"
    ]
    P: Annotated[
        F64, Shape(12, 12), "products of m, m/s, rad, rad/s", "covariance of dr, dv (N), theta_BO, domega_BO (B)"
    ]
    sensor_status: Annotated[I64, Shape(7), "-", "of each sensor: 0 used, 1 none new, else why not; see the spec"]
    nis: Annotated[F64, Shape(7), "-", "normalised innovation squared of each sensor, NaN if there is none", NanOk()]
    rows: Annotated[I64, Shape(7), "-", "degrees of freedom of nis"]
    landmarks: Annotated[int, "-", "landmarks used in this step", Bound(ge=0)]
    used: Annotated[I64, Shape(7), "-", "measurements of each sensor used since the start", Bound(ge=0)]
    refused: Annotated[I64, Shape(7), "-", "measurements of each sensor refused since the start", Bound(ge=0)]


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


POSE_STATES = 26
"""Numbers of the error state of `PoseFilterMsg`."""


class PoseFilterMsg(Message):
    """State of a filter of position, velocity and attitude. Numbers of an image are NaN or 0 where there was none."""

    estimate_ns: Annotated[int, "ns", "time of the estimate, simulation time"]
    status: Annotated[int, "-", "what became of the newest image: 0 used; see the spec of the writer"]
    status_fix: Annotated[int, "-", "what became of the newest pose"]
    status_gps: Annotated[int, "-", "what became of the newest position and velocity of the receiver"]
    status_star: Annotated[int, "-", "what became of the newest attitude of the star tracker"]
    status_vectors: Annotated[int, "-", "what became of the newest directions to stars"]
    lost: Annotated[bool, "-", "the estimate is not trusted, and a pose is looked for"]
    rate_held: Annotated[bool, "-", "the gyro is silent; the angular rate is held, and bias is relative to it"]
    r_BN_N: Annotated[Vec3, "m", "position of B relative to the centre of the planet, N components"]
    v_BN_N: Annotated[Vec3, "m/s", "inertial velocity of B, N components"]
    beta_BN: Annotated[Vec4, "-", "attitude, Euler parameters, scalar first"]
    bias_B: Annotated[Vec3, "rad/s", "bias of the gyro, B components"]
    P: Annotated[F64, Shape(POSE_STATES, POSE_STATES), "products of units", "covariance of the error state"]
    nis: Annotated[float, "-", "normalised innovation squared of the image's landmarks", NanOk()]
    freedom: Annotated[int, "-", "its degrees of freedom", Bound(ge=0)]
    landmarks: Annotated[int, "-", "landmarks of the image that could be used", Bound(ge=0)]
    accepted: Annotated[int, "-", "landmarks that agreed", Bound(ge=0)]
    contradicting: Annotated[int, "-", "images in a row that contradicted the estimate", Bound(ge=0)]
    images: Annotated[int, "-", "images used since the start", Bound(ge=0)]
    used: Annotated[int, "-", "other measurements used since the start", Bound(ge=0)]
    refused: Annotated[int, "-", "other measurements refused by their gate since the start", Bound(ge=0)]


class PoseNuisanceMsg(Message):
    """What a filter of the pose thinks of its sensors, with standard deviations; zero for what is taken as exact."""

    mount_C: Annotated[Vec3, "rad", "turn of the camera from its mounting, C components"]
    focal: Annotated[float, "-", "relative change of the focal length"]
    center_px: Annotated[Vec2, "px", "shift of the principal point"]
    k1: Annotated[float, "-", "change of the distortion k1"]
    gps_E: Annotated[Vec3, "m", "bias of the receiver, E components"]
    map_E: Annotated[Vec3, "m", "error that all places of the map share, E components"]
    time_s: Annotated[float, "s", "exposure after its stamp"]
    sigma_mount: Annotated[Vec3, "rad", "standard deviation of mount_C", Bound(ge=0)]
    sigma_focal: Annotated[float, "-", "standard deviation of focal", Bound(ge=0)]
    sigma_center_px: Annotated[Vec2, "px", "standard deviation of center_px", Bound(ge=0)]
    sigma_k1: Annotated[float, "-", "standard deviation of k1", Bound(ge=0)]
    sigma_gps: Annotated[Vec3, "m", "standard deviation of gps_E", Bound(ge=0)]
    sigma_map: Annotated[Vec3, "m", "standard deviation of map_E", Bound(ge=0)]
    sigma_time: Annotated[float, "s", "standard deviation of time_s", Bound(ge=0)]
