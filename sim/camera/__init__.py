"""Cameras: what takes or plays images."""
