"""Light and shadow."""

from sim.environment.eclipse.module import Eclipse

__all__ = ["Eclipse"]
