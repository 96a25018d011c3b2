"""Messages of control: what actuators are asked to do."""

from __future__ import annotations

from typing import Annotated

from messages.base import F64, Message, Shape, Vec3

MAX_WHEELS = 8
"""Capacity of messages and parameters of reaction wheels."""


class CmdTorqueBodyMsg(Message):
    """Commanded torque."""

    torque_B: Annotated[Vec3, "N*m", "torque on the spacecraft about its centre of mass, B components"]


class CmdForceBodyMsg(Message):
    """Commanded force."""

    force_B: Annotated[Vec3, "N", "force on the spacecraft through its centre of mass, B components"]


class RWSpeedMsg(Message):
    """Speeds of reaction wheels; places without a wheel hold 0."""

    omega: Annotated[F64, Shape(MAX_WHEELS), "rad/s", "speed of each wheel relative to the body, about its axis"]
