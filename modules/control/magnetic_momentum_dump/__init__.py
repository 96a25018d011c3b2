"""Momentum of wheels given to the magnetic field."""

from modules.control.magnetic_momentum_dump.module import MagneticMomentumDump

__all__ = ["MagneticMomentumDump"]
