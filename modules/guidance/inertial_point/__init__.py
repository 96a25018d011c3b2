"""Reference attitude that stands still."""

from modules.guidance.inertial_point.module import InertialPoint

__all__ = ["InertialPoint"]
