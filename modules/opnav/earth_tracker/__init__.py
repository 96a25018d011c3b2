"""Landmarks of a catalogue, found in an image, each with a covariance."""

from modules.opnav.earth_tracker.module import EarthTracker, TrackerStatus
from modules.opnav.earth_tracker.track import Params, Tracked, Tracker

__all__ = ["EarthTracker", "Params", "Tracked", "Tracker", "TrackerStatus"]
