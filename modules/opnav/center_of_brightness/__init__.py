"""Centre of brightness of a lit body in an image."""

from modules.opnav.center_of_brightness.module import CenterOfBrightness

__all__ = ["CenterOfBrightness"]
