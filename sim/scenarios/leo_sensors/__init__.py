"""One orbit with all sensors, each against the truth. Run ``python -m sim.scenarios.leo_sensors --help``."""

from sim.scenarios.leo_sensors.graph import LeoSensors, build

__all__ = ["LeoSensors", "build"]
