"""Geomagnetic reference field."""

from sim.environment.magnetic_field.models import Model, igrf14, read_cof, read_shc, wmm2025
from sim.environment.magnetic_field.module import MagneticField, of_model

__all__ = ["MagneticField", "Model", "igrf14", "of_model", "read_cof", "read_shc", "wmm2025"]
