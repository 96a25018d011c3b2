"""Parameters of the filter."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import Bound, Mat3, Record, Shape, Vec3, eye, zeros
from fsw.math.checks import require_rotation
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH
from messages.base import F64, Vec2, ones
from modules.estimation.pose_mekf.layout import CORE
from modules.estimation.relative_od_ukf.kernel import require_covariance

_ZONALS = np.array([J2_EARTH, 0.0, 0.0, 0.0, 0.0])
_STAR = np.array([4.85e-5, 4.85e-5, 2.91e-4])
_MAP = 25.0 * np.eye(3)
_LOST = np.array([2e4, 30.0, 0.1])


class PoseMekfParams(Record):
    """Start, motion, sensors, nuisance states, robustness."""

    start_ns: Annotated[int, "ns", "time of the initial state", Bound(ge=0)] = 0
    r_BN_N: Annotated[Vec3, "m", "initial position"]
    v_BN_N: Annotated[Vec3, "m/s", "initial velocity"]
    sigma_BN: Annotated[Vec3, "-", "initial attitude, MRP"]
    omega_BN_B: Annotated[Vec3, "rad/s", "initial angular rate; matters only without gyro"] = zeros(3)
    P: Annotated[
        F64, Shape(CORE, CORE), "m, m/s, rad, rad/s", "initial covariance of r, v (N), attitude, gyro bias (B)"
    ]
    start_lost: Annotated[bool, "-", "the initial position and attitude are worthless: wait for a pose"] = False

    mu: Annotated[float, "m^3/s^2", "gravitational parameter of the planet", Bound(gt=0)] = MU_EARTH
    radius: Annotated[float, "m", "reference radius of its field", Bound(gt=0)] = RADIUS_EARTH
    zonals: Annotated[F64, Shape(5), "-", "J2 to J6 of its field, not normalised"] = _ZONALS
    accel_noise: Annotated[float, "m/s^1.5", "density of unmodelled acceleration, sigma", Bound(gt=0)] = 1e-7
    max_step: Annotated[float, "s", "longest step of the prediction", Bound(gt=0.001)] = 10.0
    max_delay: Annotated[float, "s", "delay of measurements that is remembered", Bound(gt=0.01)] = 10.0

    dcm_PB: Annotated[Mat3, "-", "gyro: maps body to case components"] = eye(3)
    gyro_white: Annotated[float, "rad/s^0.5", "angle random walk", Bound(gt=0)] = 2.9e-5
    gyro_walk: Annotated[float, "rad/s^1.5", "rate random walk", Bound(gt=0)] = 2e-8
    gyro_period: Annotated[float, "s", "interval of its messages", Bound(gt=0)] = 1.0
    gyro_timeout: Annotated[float, "s", "the rate is held after this silence; 0: there is no gyro", Bound(ge=0)] = 2.5
    rate_sigma: Annotated[float, "rad/s", "of the initial rate, without gyro", Bound(gt=0)] = 1e-4
    rate_noise: Annotated[float, "rad/s^1.5", "density of angular acceleration, without gyro", Bound(gt=0)] = 1e-5

    r_AB_B: Annotated[Vec3, "m", "antenna of the receiver relative to B"] = zeros(3)
    gps_sigma_r: Annotated[float, "m", "white noise of its positions", Bound(gt=0)] = 5.0
    gps_sigma_v: Annotated[float, "m/s", "white noise of its velocities", Bound(gt=0)] = 0.1
    dcm_SB: Annotated[Mat3, "-", "star tracker: maps body to case components"] = eye(3)
    star_sigma: Annotated[Vec3, "rad", "noise of its attitude about x, y, z of S", Bound(gt=0)] = _STAR
    r_CB_B: Annotated[Vec3, "m", "camera relative to B"] = zeros(3)
    row_time: Annotated[float, "s", "rolling shutter: from row to row", Bound(ge=-0.01, le=0.01)] = 0.0
    noise_scale: Annotated[float, "-", "factor of the standard deviation of matches", Bound(gt=0)] = 1.0
    map_noise: Annotated[float, "m", "error of each coordinate of each place of the map", Bound(ge=0)] = 0.0

    mount_mode: Annotated[int, "-", "turn of the camera: 0 off, 1 considered, 2 estimated", Bound(ge=0, le=2)] = 0
    mount_sigma: Annotated[float, "rad", "its standard deviation about each axis", Bound(gt=0)] = 2.9e-4
    focal_mode: Annotated[int, "-", "relative focal length: as above", Bound(ge=0, le=2)] = 0
    focal_sigma: Annotated[float, "-", "its standard deviation", Bound(gt=0)] = 1e-3
    center_mode: Annotated[int, "-", "principal point: as above", Bound(ge=0, le=2)] = 0
    center_sigma: Annotated[Vec2, "px", "of column and row", Bound(gt=0)] = ones(2)
    k1_mode: Annotated[int, "-", "distortion k1: as above", Bound(ge=0, le=2)] = 0
    k1_sigma: Annotated[float, "-", "its standard deviation", Bound(gt=0)] = 1e-2
    gps_mode: Annotated[int, "-", "Gauss-Markov bias of the receiver (E): as above", Bound(ge=0, le=2)] = 0
    gps_bias_sigma: Annotated[float, "m", "of each coordinate", Bound(gt=0)] = 3.0
    gps_bias_tau: Annotated[float, "s", "its time constant", Bound(gt=0)] = 300.0
    map_mode: Annotated[int, "-", "error that all places share (E): as above", Bound(ge=0, le=2)] = 0
    map_bias_P: Annotated[Mat3, "m^2", "its covariance"] = _MAP
    map_bias_tau: Annotated[float, "s", "its time constant; 0: it is constant", Bound(ge=0)] = 0.0
    time_mode: Annotated[int, "-", "exposure after its stamp: as above", Bound(ge=0, le=2)] = 0
    time_sigma: Annotated[float, "s", "its standard deviation", Bound(gt=0)] = 1e-3

    gate: Annotated[float, "-", "gates, as a quantile of the normal distribution (3.719: 0.9999); 0: none"] = 3.719
    huber: Annotated[float, "-", "residuals beyond this many sigma count less; 0: all the same", Bound(ge=0)] = 3.0
    iterations: Annotated[int, "-", "iterations of the update by an image", Bound(ge=2, le=10)] = 3
    min_landmarks: Annotated[int, "-", "fewest landmarks of an image", Bound(ge=1)] = 4
    min_share: Annotated[float, "-", "least share of its landmarks that agree", Bound(ge=0, le=1)] = 0.3
    patience: Annotated[int, "-", "contradicting images in a row that mean divergence", Bound(ge=1)] = 3
    lost_sigma: Annotated[Vec3, "m, m/s, rad", "of position, velocity, attitude once lost", Bound(gt=0)] = _LOST

    def __post_init__(self) -> None:
        """Check covariance and mountings too."""
        super().__post_init__()
        require_covariance(self, "P", definite=True)
        require_covariance(self, "map_bias_P", definite=False)
        require_rotation(self, "dcm_PB")
        require_rotation(self, "dcm_SB")
