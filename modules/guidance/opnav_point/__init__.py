"""Pointing of the camera at a body that it has seen."""

from modules.guidance.opnav_point.module import OpNavPoint

__all__ = ["OpNavPoint"]
