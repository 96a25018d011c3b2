"""Star tracker that gives directions to single stars."""

from sim.sensors.star_vectors.catalogue import CAPACITY, catalogue
from sim.sensors.star_vectors.module import StarVectors

__all__ = ["CAPACITY", "StarVectors", "catalogue"]
