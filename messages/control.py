"""Messages of control: what actuators are asked to do."""

from __future__ import annotations

from typing import Annotated

from messages.base import Message, Vec3


class CmdTorqueBodyMsg(Message):
    """Commanded torque."""

    torque_B: Annotated[Vec3, "N*m", "torque on the spacecraft about its centre of mass, B components"]


class CmdForceBodyMsg(Message):
    """Commanded force."""

    force_B: Annotated[Vec3, "N", "force on the spacecraft through its centre of mass, B components"]
