"""Disks of planets and moons in images: what the finders of circles and of limbs share."""

from modules.opnav.disks.coarse import Light
from modules.opnav.disks.search import Disk, DiskStatus, Options, find_disks

__all__ = ["Disk", "DiskStatus", "Light", "Options", "find_disks"]
