"""Sum of torques."""

from sim.actuators.torque_sum.module import TorqueSum

__all__ = ["TorqueSum"]
