"""Messages of sensors, each in the frame of its own case."""

from __future__ import annotations

from typing import Annotated

from messages.base import F64, I64, Bound, Message, NanOk, Shape, Vec3, Vec4


class STAttMsg(Message):
    """Attitude measured by a star tracker. If not ``valid``, the numbers are NaN."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "stars were found and identified"]
    beta_SN: Annotated[Vec4, "-", "attitude of the case S relative to N, Euler parameters, scalar first", NanOk()]


class StarVectorsMsg(Message):
    """Directions to identified stars, the brightest first. If not ``valid``, there are none."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "the sensor is neither blinded nor turning too fast"]
    count: Annotated[int, "-", "number of stars", Bound(ge=0, le=16)]
    sigma: Annotated[float, "rad", "standard deviation of each direction about the x and y axes of S", NanOk()]
    star: Annotated[I64, Shape(16), "-", "row of each star in the catalogue, -1 beyond count"]
    s_S: Annotated[F64, Shape(16, 3), "-", "unit vectors to the stars, S components, NaN beyond count", NanOk()]


class IMUSensorMsg(Message):
    """Angular rate and non-gravitational acceleration measured by an inertial unit, means since its last message."""

    omega_PN_P: Annotated[Vec3, "rad/s", "angular velocity of the case P relative to N, P components"]
    accel_P: Annotated[
        Vec3, "m/s^2", "non-gravitational acceleration, P components; NaN without accelerometers", NanOk()
    ]


class SpecificForceMsg(Message):
    """What accelerometers feel: the true acceleration of B by everything but gravity."""

    accel_BN_B: Annotated[Vec3, "m/s^2", "non-gravitational acceleration of B now, B components"]
    dv_BN_N: Annotated[Vec3, "m/s", "its integral over time since the start, in N components"]


class AccelSensorMsg(Message):
    """Non-gravitational acceleration measured by accelerometers, mean since the last sample."""

    accel_P: Annotated[Vec3, "m/s^2", "non-gravitational acceleration of the case P, P components"]


class GPSSensorMsg(Message):
    """Position and velocity of an antenna A by a navigation receiver, Earth-fixed (ITRF, WGS84)."""

    fix_ns: Annotated[int, "ns", "time of the fix, simulation time"]
    r_AE_E: Annotated[Vec3, "m", "position of A relative to the centre of the Earth, E components"]
    v_AE_E: Annotated[Vec3, "m/s", "velocity of A relative to E, E components"]
    lat: Annotated[
        float, "rad", "geodetic latitude of the position", Bound(ge=-1.5707963267948968, le=1.5707963267948968)
    ]
    lon: Annotated[float, "rad", "longitude of the position, east positive, from -pi to pi"]
    h: Annotated[float, "m", "height of the position above the ellipsoid"]


class CSSArraySensorMsg(Message):
    """Readings of six coarse Sun sensors."""

    signal: Annotated[F64, Shape(6), "-", "current of each cell; 1 faces the Sun at 1 au"]


class TAMSensorMsg(Message):
    """Magnetic flux density measured by a three-axis magnetometer."""

    B_S: Annotated[Vec3, "T", "flux density, components of the case S"]
