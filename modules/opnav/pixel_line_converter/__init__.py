"""Position relative to a body from the circle that its disk looks like."""

from modules.opnav.pixel_line_converter.module import PixelLineConverter

__all__ = ["PixelLineConverter"]
