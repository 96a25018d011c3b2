"""Star tracker."""

from sim.sensors.star_tracker.module import StarTracker

__all__ = ["StarTracker"]
