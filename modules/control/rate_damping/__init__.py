"""Braking of a rotation."""

from modules.control.rate_damping.module import RateDamping

__all__ = ["RateDamping"]
