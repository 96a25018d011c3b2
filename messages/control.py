"""Messages of control: what actuators are asked to do, and what they do."""

from __future__ import annotations

from typing import Annotated

from messages.base import F64, Message, Shape, Vec3

MAX_WHEELS = 8
"""Capacity of messages and parameters of reaction wheels."""
MAX_TORQUERS = 8
"""Capacity of messages and parameters of magnetic torquers."""


class CmdTorqueBodyMsg(Message):
    """Commanded torque."""

    torque_B: Annotated[Vec3, "N*m", "torque on the spacecraft about its centre of mass, B components"]


class CmdForceBodyMsg(Message):
    """Commanded force."""

    force_B: Annotated[Vec3, "N", "force on the spacecraft through its centre of mass, B components"]


class RWSpeedMsg(Message):
    """Speeds of reaction wheels; places without a wheel hold 0."""

    omega: Annotated[F64, Shape(MAX_WHEELS), "rad/s", "speed of each wheel relative to the body, about its axis"]


class RWTorqueMsg(Message):
    """Torques of the motors of reaction wheels; places without a wheel hold 0."""

    torque: Annotated[F64, Shape(MAX_WHEELS), "N*m", "torque of each motor on its wheel, about its axis"]


class RWStateMsg(Message):
    """What reaction wheels do; places without a wheel hold 0."""

    motor_torque: Annotated[F64, Shape(MAX_WHEELS), "N*m", "torque of each motor on its wheel"]
    friction_torque: Annotated[F64, Shape(MAX_WHEELS), "N*m", "torque of friction on each wheel"]
    saturated: Annotated[int, "-", "wheels whose torque or speed is at its limit"]
    momentum_B: Annotated[Vec3, "N*m*s", "angular momentum of all wheels about their axes relative to N, B components"]


class MTBDipoleMsg(Message):
    """Dipoles of magnetic torquers; places without a torquer hold 0."""

    dipole: Annotated[F64, Shape(MAX_TORQUERS), "A*m^2", "dipole of each torquer along its axis"]
