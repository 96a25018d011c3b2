"""Pictures of Mars along an eccentric orbit. Run ``python -m sim.scenarios.mars_disk --help``."""

from sim.scenarios.mars_disk.graph import MarsDisk, build

__all__ = ["MarsDisk", "build"]
