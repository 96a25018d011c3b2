"""Navigation solution made from the truth."""

from sim.sensors.simple_nav.module import SimpleNav

__all__ = ["SimpleNav"]
