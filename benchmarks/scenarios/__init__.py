"""The scenarios of the mission, every filter against the bound: ``python -m benchmarks.scenarios``."""
