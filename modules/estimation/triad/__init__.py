"""Attitude from two directions."""

from modules.estimation.triad.module import Triad

__all__ = ["Triad"]
