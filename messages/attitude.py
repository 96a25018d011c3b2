"""Messages of attitude guidance: where to point, and how far the spacecraft is from there."""

from __future__ import annotations

from typing import Annotated

from messages.base import Message, NanOk, Vec3


class AttRefMsg(Message):
    """Reference attitude and its motion."""

    sigma_RN: Annotated[Vec3, "-", "attitude of the reference R relative to N, MRP of the inner set"]
    omega_RN_N: Annotated[Vec3, "rad/s", "angular velocity of R relative to N, N components"]
    domega_RN_N: Annotated[Vec3, "rad/s^2", "inertial derivative of the angular velocity, N components"]


class AttGuidMsg(Message):
    """Tracking error relative to the reference."""

    sigma_BR: Annotated[Vec3, "-", "attitude of B relative to R, MRP of the inner set"]
    omega_BR_B: Annotated[Vec3, "rad/s", "angular velocity of B relative to R, B components"]
    omega_RN_B: Annotated[Vec3, "rad/s", "angular velocity of R relative to N, B components"]
    domega_RN_B: Annotated[Vec3, "rad/s^2", "inertial derivative of the angular velocity of R, B components"]


class SunDirectionMsg(Message):
    """Direction of the Sun. If not ``valid``, it is NaN."""

    valid: Annotated[bool, "-", "the Sun was seen"]
    u_SB_B: Annotated[Vec3, "-", "unit vector to the Sun, B components", NanOk()]


class TargetViewMsg(Message):
    """How a spacecraft sees a place on the ground."""

    visible: Annotated[bool, "-", "the place is above the least elevation"]
    elevation: Annotated[float, "rad", "of the spacecraft above the horizon of the place, ellipsoidal"]
    range: Annotated[float, "m", "distance from the spacecraft to the place"]
    off_nadir: Annotated[float, "rad", "angle between the line of sight and the centre of the Earth"]
