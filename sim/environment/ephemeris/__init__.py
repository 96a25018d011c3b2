"""Sun, Moon and planets."""

from sim.environment.ephemeris.module import Ephemeris, of_positions

__all__ = ["Ephemeris", "of_positions"]
