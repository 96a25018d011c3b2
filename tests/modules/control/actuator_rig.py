"""Sources for the modules that command actuators."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fsw import Module, Out
from messages.base import F64
from messages.control import CmdTorqueBodyMsg, RWSpeedMsg
from messages.sensors import IMUSensorMsg, TAMSensorMsg


def padded(a: Any) -> F64:
    """Eight places."""
    a = np.asarray(a, float)
    return np.concatenate([a, np.zeros((8 - len(a), *a.shape[1:]))])


def unit_rows(rng: np.random.Generator, n: int) -> F64:
    """Random unit vectors, (n, 3)."""
    a = rng.normal(size=(n, 3))
    return a / np.linalg.norm(a, axis=1)[:, None]


def basilisk(what: str) -> list[dict[str, Any]]:
    """Cases of `tests/data/basilisk_actuator_control.json`."""
    path = Path(__file__).parents[2] / "data" / "basilisk_actuator_control.json"
    return json.loads(path.read_text())[what]


class Feed(Module):
    """Holds what a test writes."""

    out_torque = Out(CmdTorqueBodyMsg)
    out_speeds = Out(RWSpeedMsg)
    out_field = Out(TAMSensorMsg)
    out_imu = Out(IMUSensorMsg)
