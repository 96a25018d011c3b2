"""Earth tracker EKF."""

from modules.estimation.earth_tracker_ekf.module import EarthTrackerEkf
from modules.estimation.earth_tracker_ekf.params import BATCH, FEDERATED, SEQUENTIAL

__all__ = ["BATCH", "FEDERATED", "SEQUENTIAL", "EarthTrackerEkf"]
