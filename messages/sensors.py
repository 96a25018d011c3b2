"""Messages of sensors, each in the frame of its own case."""

from __future__ import annotations

from typing import Annotated

from messages.base import Message, NanOk, Vec3, Vec4


class STAttMsg(Message):
    """Attitude measured by a star tracker. If not ``valid``, the numbers are NaN."""

    exposure_ns: Annotated[int, "ns", "middle of the exposure, simulation time"]
    valid: Annotated[bool, "-", "stars were found and identified"]
    beta_SN: Annotated[Vec4, "-", "attitude of the case S relative to N, Euler parameters, scalar first", NanOk()]


class IMUSensorMsg(Message):
    """Angular rate and non-gravitational acceleration measured by an inertial unit, means since its last message."""

    omega_PN_P: Annotated[Vec3, "rad/s", "angular velocity of the case P relative to N, P components"]
    accel_P: Annotated[
        Vec3, "m/s^2", "non-gravitational acceleration, P components; NaN without accelerometers", NanOk()
    ]
