"""A camera that draws the Earth from maps: `EarthCamera`, and its renderer alone."""

from sim.camera.earth_camera.module import EarthCamera
from sim.camera.earth_camera.params import EarthCameraParams
from sim.camera.earth_camera.pose import Motion, Pose
from sim.camera.earth_camera.renderer import EarthRenderer, Rendered

__all__ = ["EarthCamera", "EarthCameraParams", "EarthRenderer", "Motion", "Pose", "Rendered"]
