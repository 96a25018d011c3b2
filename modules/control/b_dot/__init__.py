"""Braking of a rotation by magnetic torquers."""

from modules.control.b_dot.module import BDot

__all__ = ["BDot"]
