"""Baselines: what the sources describe, as they describe it, to compare with."""
