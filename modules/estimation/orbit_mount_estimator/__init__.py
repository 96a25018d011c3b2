"""Lens, mounting, shutter clock and track from landmarks: `OrbitMountEstimator`."""

from modules.estimation.orbit_mount_estimator.module import OrbitMountEstimator

__all__ = ["OrbitMountEstimator"]
