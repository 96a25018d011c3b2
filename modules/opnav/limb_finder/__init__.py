"""The lit limb of a planet or moon, found in an image."""

from modules.opnav.limb_finder.module import LimbFinder

__all__ = ["LimbFinder"]
