"""Three-axis rate-integrating gyro."""

from sim.sensors.gyro.module import Gyro

__all__ = ["Gyro"]
