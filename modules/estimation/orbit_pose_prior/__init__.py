"""Predicted pose of a camera from an approximate orbit: `OrbitPosePrior`, `TleOrbit`."""

from modules.estimation.orbit_pose_prior.kernel import corrected_time_s
from modules.estimation.orbit_pose_prior.module import OrbitPosePrior
from modules.estimation.orbit_pose_prior.orbit import OrbitError, TleOrbit, require_fresh

__all__ = ["OrbitError", "OrbitPosePrior", "TleOrbit", "corrected_time_s", "require_fresh"]
