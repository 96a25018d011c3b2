"""Three-axis accelerometer."""

from sim.sensors.accelerometer.module import Accelerometer

__all__ = ["Accelerometer"]
