"""Attitude control law."""

from modules.control.mrp_feedback.module import MrpFeedback

__all__ = ["MrpFeedback"]
