"""Sun, Moon and planets."""

from sim.environment.ephemeris.module import Ephemeris

__all__ = ["Ephemeris"]
