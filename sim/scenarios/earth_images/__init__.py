"""Pictures of the Earth with every effect of the camera. Run ``python -m sim.scenarios.earth_images --help``."""

from sim.scenarios.earth_images.graph import EarthImages, build

__all__ = ["EarthImages", "build"]
