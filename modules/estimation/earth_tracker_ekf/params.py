"""Parameters and state of the filter."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import F64, I64, Bound, Mat3, Record, Shape, Vec3, Vec4, eye, zeros
from fsw.math.checks import require_inertia, require_rotation
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH
from fsw.math.magnetic import COUNT, DEGREE
from modules.estimation.earth_tracker_ekf.status import SENSORS
from modules.estimation.relative_od_ukf.kernel import require_covariance

MAX_STARS = 5120
"""Capacity of the star catalogue."""
SEQUENTIAL, BATCH, FEDERATED = 0, 1, 2
"""Values of ``form``."""


def floats(values: object) -> F64:
    """A read-only array."""
    array = np.array(values, np.float64)
    array.setflags(write=False)
    return array


def integers(*values: int) -> I64:
    """A read-only array."""
    array = np.array(values, np.int64)
    array.setflags(write=False)
    return array


class EarthTrackerParams(Record):
    """Parameters; sensors are numbered landmarks, GPS, gyro, Sun sensors, magnetometer, star tracker, stars."""

    start_ns: Annotated[int, "ns", "time of the initial state", Bound(ge=0)] = 0
    r_BN_N: Annotated[Vec3, "m", "initial position of B relative to the centre of the planet, N"]
    v_BN_N: Annotated[Vec3, "m/s", "initial velocity, N"]
    beta_BO: Annotated[Vec4, "-", "initial attitude of B relative to the orbit frame, Euler parameters, scalar first"]
    omega_BO_B: Annotated[Vec3, "rad/s", "initial angular velocity of B relative to the orbit frame, B"] = zeros(3)
    P: Annotated[
        F64, Shape(12, 12), "products of m, m/s, rad, rad/s", "covariance of dr, dv (N), theta_BO, domega_BO (B)"
    ]
    mu: Annotated[float, "m^3/s^2", "gravitational parameter", Bound(gt=0)] = MU_EARTH
    radius: Annotated[float, "m", "reference radius of J2, and of the shadow", Bound(gt=0)] = RADIUS_EARTH
    j2: Annotated[float, "-", "zonal coefficient of degree 2"] = J2_EARTH
    inertia_B: Annotated[Mat3, "kg*m^2", "inertia about B"]
    gravity_gradient: Annotated[bool, "-", "whether the gradient of gravity turns the body"] = False
    accel_density: Annotated[float, "m^2/s^3", "white acceleration, each axis", Bound(ge=0)] = 1e-14
    torque_density: Annotated[float, "N^2*m^2*s", "white torque, each axis", Bound(ge=0)] = 1e-12
    max_step: Annotated[float, "s", "longest step of the prediction", Bound(gt=0)] = 5.0
    form: Annotated[int, "-", "update: 0 sequential, 1 batch, 2 federated", Bound(ge=0, le=2)] = SEQUENTIAL
    order: Annotated[
        I64, Shape(SENSORS), "-", "sensors in the order of their updates at one instant; the most accurate first"
    ] = integers(5, 6, 1, 0, 2, 4, 3)
    shares: Annotated[F64, Shape(SENSORS), "-", "information of the local filters; only ratios count", Bound(gt=0)] = (
        floats(np.ones(SENSORS))
    )
    iterations: Annotated[int, "-", "most linearisations of an update; the federated form has one", Bound(ge=1)] = 3
    gate: Annotated[float, "-", "factor of the gate, which at 1 refuses one good in 10,000; 0: none", Bound(ge=0)] = 1.0
    max_late: Annotated[float, "s", "oldest measurement that is still used", Bound(ge=0)] = 10.0
    unit_vectors: Annotated[bool, "-", "landmarks as unit vectors instead of pixels"] = False
    min_landmarks: Annotated[int, "-", "fewest landmarks of an image that is used", Bound(ge=1)] = 3
    r_CB_B: Annotated[Vec3, "m", "camera relative to B, B"] = zeros(3)
    sigma_map: Annotated[float, "m", "independent error of landmarks in the map, each axis", Bound(ge=0)] = 0.0
    r_AB_B: Annotated[Vec3, "m", "GPS antenna relative to B, B"] = zeros(3)
    sigma_gps_r: Annotated[float, "m", "error of a GPS position, each axis", Bound(gt=0)] = 5.0
    sigma_gps_v: Annotated[float, "m/s", "error of a GPS velocity, each axis", Bound(gt=0)] = 0.05
    dcm_PB: Annotated[Mat3, "-", "mounting of the gyro"] = eye(3)
    gyro_bias_P: Annotated[Vec3, "rad/s", "bias of the gyro; it is not estimated"] = zeros(3)
    sigma_gyro: Annotated[float, "rad/s", "error of a reading of the gyro, each axis", Bound(gt=0)] = 1e-4
    gyro_delay: Annotated[float, "s", "age of a reading, half the interval that it is the mean of", Bound(ge=0)] = 0.0
    normals_B: Annotated[F64, Shape(6, 3), "-", "normals of the Sun sensors' cells, any length, B"] = floats(
        [[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    )
    css_scale: Annotated[float, "-", "signal of a cell that faces the Sun at 1 au", Bound(gt=0)] = 1.0
    sigma_css: Annotated[float, "-", "error of a signal, earthshine included", Bound(gt=0)] = 0.1
    css_limit: Annotated[float, "-", "cosine that a cell must be expected to see", Bound(gt=0, lt=1)] = 0.3
    dcm_MB: Annotated[Mat3, "-", "mounting of the magnetometer"] = eye(3)
    magnetic_bias_M: Annotated[Vec3, "T", "bias of the magnetometer"] = zeros(3)
    sigma_magnetometer: Annotated[float, "T", "error of magnetometer and field model", Bound(gt=0)] = 2e-7
    field_degree: Annotated[int, "-", "degree of the field model; 0: there is none", Bound(ge=0, le=DEGREE)] = 0
    field_g: Annotated[F64, Shape(COUNT), "T", "cosine coefficients, scaled; of coefficients_at"] = zeros(COUNT)
    field_h: Annotated[F64, Shape(COUNT), "T", "sine coefficients, scaled"] = zeros(COUNT)
    dcm_SB: Annotated[Mat3, "-", "mounting of the star tracker"] = eye(3)
    sigma_tracker: Annotated[Vec3, "rad", "attitude error of the star tracker about its axes", Bound(gt=0)] = floats(
        [4.85e-5, 4.85e-5, 2.91e-4]
    )
    dcm_VB: Annotated[Mat3, "-", "mounting of the sensor that gives stars"] = eye(3)
    star_count: Annotated[int, "-", "stars in the catalogue", Bound(ge=0, le=MAX_STARS)] = 0
    star_N: Annotated[F64, Shape(MAX_STARS, 3), "-", "unit vectors to the stars, N"] = zeros(MAX_STARS, 3)
    aberration: Annotated[bool, "-", "whether stars are where a moving observer sees them"] = False

    def __post_init__(self) -> None:
        """Check what bounds cannot express."""
        super().__post_init__()
        require_covariance(self, "P", definite=True)
        require_inertia(self, "inertia_B")
        for field in ("dcm_PB", "dcm_MB", "dcm_SB", "dcm_VB"):
            require_rotation(self, field)
        where = type(self).__qualname__
        if not abs(float(self.beta_BO @ self.beta_BO) - 1.0) < 1e-6:
            raise ValueError(f"{where}.beta_BO: expected unit length, got {self.beta_BO.tolist()}; normalise it")
        if sorted(self.order.tolist()) != list(range(SENSORS)):
            raise ValueError(f"{where}.order: expected each of 0 to 6 once, got {self.order.tolist()}")
        if not np.all(np.linalg.norm(self.normals_B, axis=1) > 1e-6):
            raise ValueError(f"{where}.normals_B: expected six vectors longer than 1e-6, got {self.normals_B.tolist()}")
        h = np.linalg.norm(np.cross(self.r_BN_N, self.v_BN_N))
        if not h > 1e-9 * np.linalg.norm(self.r_BN_N) * np.linalg.norm(self.v_BN_N):
            raise ValueError(f"{where}.v_BN_N: expected an orbit; got {self.v_BN_N.tolist()}, parallel to r_BN_N or 0")


class EarthTrackerState(Record):
    """The estimate, and what was looked at."""

    started: Annotated[bool, "-", "the initial state was taken over"] = False
    time_ns: Annotated[int, "ns", "time of the estimate"] = 0
    x: Annotated[F64, Shape(13), "m, m/s, -, rad/s", "r_BN_N, v_BN_N, beta_BO, omega_BO_B"] = zeros(13)
    P: Annotated[F64, Shape(12, 12), "products of m, m/s, rad, rad/s", "covariance of the error"] = zeros(12, 12)
    seen: Annotated[I64, Shape(SENSORS), "-", "seq of each sensor's last message looked at"] = integers(*[0] * SENSORS)
    last_ns: Annotated[I64, Shape(SENSORS), "ns", "time of each sensor's last measurement used"] = integers(
        *[-1] * SENSORS
    )
    used: Annotated[I64, Shape(SENSORS), "-", "measurements used"] = integers(*[0] * SENSORS)
    refused: Annotated[I64, Shape(SENSORS), "-", "measurements refused"] = integers(*[0] * SENSORS)
