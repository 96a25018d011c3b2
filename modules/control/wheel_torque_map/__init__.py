"""Torque on the body to torques of wheels."""

from modules.control.wheel_torque_map.module import WheelTorqueMap

__all__ = ["WheelTorqueMap"]
