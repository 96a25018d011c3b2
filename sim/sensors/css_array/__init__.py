"""Array of six coarse Sun sensors."""

from sim.sensors.css_array.module import CssArray

__all__ = ["CssArray"]
