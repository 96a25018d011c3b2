"""Disks of planets and moons, found in an image."""

from modules.opnav.circle_finder.module import CircleFinder

__all__ = ["CircleFinder"]
