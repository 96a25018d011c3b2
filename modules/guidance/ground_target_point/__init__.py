"""Pointing at a place on the ground."""

from modules.guidance.ground_target_point.module import GroundTargetPoint

__all__ = ["GroundTargetPoint"]
