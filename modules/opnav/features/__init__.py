"""Features of images: SIFT, SURF, ORB and, where OpenCV has it, AKAZE, with one interface; and their matching."""

from modules.opnav.features.detectors import DETECTORS, Features, detect
from modules.opnav.features.matching import mutual_matches

__all__ = ["DETECTORS", "Features", "detect", "mutual_matches"]
