"""The space station located from photos taken through its window. Run ``python -m sim.scenarios.iss_photos``."""

from __future__ import annotations

from fsw import Simulation


def build() -> Simulation:
    """The graph on the shipped photos, for ``fsw graph`` and ``fsw check``; rounds of photos are up to `run.main`."""
    from sim.scenarios.iss_photos.graph import build as build_graph
    from sim.scenarios.iss_photos.inputs import read_inputs
    from sim.scenarios.iss_photos.options import parse

    return build_graph(read_inputs(parse([]))).simulation
