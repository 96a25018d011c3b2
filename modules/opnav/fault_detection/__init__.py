"""Comparison of two positions from one image."""

from modules.opnav.fault_detection.module import FaultDetection

__all__ = ["FaultDetection"]
