"""Exponential atmosphere."""

from sim.environment.atmosphere.module import Atmosphere

__all__ = ["Atmosphere"]
