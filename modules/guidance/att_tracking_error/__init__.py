"""Attitude and rate errors relative to a reference."""

from modules.guidance.att_tracking_error.module import AttTrackingError

__all__ = ["AttTrackingError"]
