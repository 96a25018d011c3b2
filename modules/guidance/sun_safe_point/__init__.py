"""Pointing at the Sun with coarse Sun sensors and a gyro."""

from modules.guidance.sun_safe_point.module import SunSafePoint

__all__ = ["SunSafePoint"]
