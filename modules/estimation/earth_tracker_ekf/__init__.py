"""Earth tracker EKF."""

from modules.estimation.earth_tracker_ekf.module import EarthTrackerEkf
from modules.estimation.earth_tracker_ekf.params import BATCH, FEDERATED, SEQUENTIAL
from modules.estimation.earth_tracker_ekf.start import initial_state

__all__ = ["BATCH", "FEDERATED", "SEQUENTIAL", "EarthTrackerEkf", "initial_state"]
