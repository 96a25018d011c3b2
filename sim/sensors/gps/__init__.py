"""Receiver of a satellite navigation system."""

from sim.sensors.gps.module import Gps

__all__ = ["Gps"]
