"""Orbit about a body from positions relative to it."""

from modules.estimation.relative_od_ukf.module import RelativeOdUkf

__all__ = ["RelativeOdUkf"]
