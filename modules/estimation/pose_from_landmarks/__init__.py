"""Position and attitude of a camera from landmarks."""

from modules.estimation.pose_from_landmarks.module import PoseFromLandmarks
from modules.estimation.pose_from_landmarks.status import STATUS_TEXT, FixStatus

__all__ = ["STATUS_TEXT", "FixStatus", "PoseFromLandmarks"]
