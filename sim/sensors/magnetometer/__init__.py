"""Three-axis magnetometer."""

from sim.sensors.magnetometer.module import Magnetometer

__all__ = ["Magnetometer"]
