"""Plain field towards geographic north."""

from sim.environment.tangential_field.module import TangentialField

__all__ = ["TangentialField"]
