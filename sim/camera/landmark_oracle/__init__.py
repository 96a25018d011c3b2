"""Landmarks from the true pose, for studies of filters."""

from sim.camera.landmark_oracle.module import LandmarkOracle, of_camera

__all__ = ["LandmarkOracle", "of_camera"]
