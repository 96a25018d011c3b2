"""Centred dipole."""

from sim.environment.dipole_field.module import DipoleField

__all__ = ["DipoleField"]
