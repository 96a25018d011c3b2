"""Reaction wheels."""

from sim.actuators.reaction_wheels.module import ReactionWheels

__all__ = ["ReactionWheels"]
