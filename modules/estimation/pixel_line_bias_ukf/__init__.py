"""Orbit about a body and pixel bias, from circles through its limb."""

from modules.estimation.pixel_line_bias_ukf.module import PixelLineBiasUkf

__all__ = ["PixelLineBiasUkf"]
