"""How the Earth is turned."""

from sim.environment.earth_orientation.modes import aligned, earth_rotation, iau2006
from sim.environment.earth_orientation.module import EarthOrientation

__all__ = ["EarthOrientation", "aligned", "earth_rotation", "iau2006"]
