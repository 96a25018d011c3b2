"""Camera that sees planets and moons as disks."""

from sim.camera.disk_camera.module import DiskCamera
from sim.camera.disk_camera.scene import DiskBody, DiskTruth, disk_body
from sim.camera.disk_camera.texture import invented

__all__ = ["DiskBody", "DiskCamera", "DiskTruth", "disk_body", "invented"]
