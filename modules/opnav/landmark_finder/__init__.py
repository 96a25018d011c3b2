"""Landmarks of a georeferenced map, found in an image."""

from modules.opnav.landmark_finder.module import FinderStatus, LandmarkFinder
from modules.opnav.landmark_finder.render import View, render_view

__all__ = ["FinderStatus", "LandmarkFinder", "View", "render_view"]
