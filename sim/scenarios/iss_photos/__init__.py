"""The space station located from photos taken through its window. Run ``python -m sim.scenarios.iss_photos``."""
