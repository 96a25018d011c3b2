"""The geomagnetic models that come with the simulation."""

from __future__ import annotations

from pathlib import Path

from fsw.math.geomagnetic import YEARS, Model, read_cof, read_shc, year_start, yearly_table

__all__ = ["DATA", "YEARS", "Model", "igrf14", "read_cof", "read_shc", "wmm2025", "year_start", "yearly_table"]
DATA = Path(__file__).parents[2] / "data" / "magnetic"


def igrf14() -> Model:
    """The International Geomagnetic Reference Field, 14th generation, 1900 to 2030."""
    return read_shc(DATA / "IGRF14.shc")


def wmm2025() -> Model:
    """The World Magnetic Model 2025, 2025 to 2030."""
    return read_cof(DATA / "WMM_2025.COF")
