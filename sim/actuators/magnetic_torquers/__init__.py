"""Magnetic torquers."""

from sim.actuators.magnetic_torquers.module import MagneticTorquers

__all__ = ["MagneticTorquers"]
