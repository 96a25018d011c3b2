"""Rigid spacecraft in orbit."""

from sim.dynamics.spacecraft.module import Spacecraft

__all__ = ["Spacecraft"]
