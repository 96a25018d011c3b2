"""Faults on any connection of a scenario: `inject` puts them between an output and an input."""

from sim.faults.inject import inject
from sim.faults.kinds import Fault, bias, bit_flip, delay, drop, duplicate, freeze, nan, noise, scale

__all__ = ["Fault", "bias", "bit_flip", "delay", "drop", "duplicate", "freeze", "inject", "nan", "noise", "scale"]
