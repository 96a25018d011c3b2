"""A star catalogue in the form in which the sensor's parameters hold it."""

from __future__ import annotations

from typing import Any

import numpy as np

from messages.base import F64

CAPACITY = 5120
"""Most stars that the parameters hold."""


def catalogue(s_N: F64, magnitude: F64, faintest: float = 99.0) -> dict[str, Any]:
    """Parameters of the stars, ``StarVectors.Params(**catalogue(s_N, magnitude), fov=...)``.

    Args:
        s_N: directions to the stars, N components, (n, 3), any length.
        magnitude: visual magnitudes, (n,).
        faintest: stars of greater magnitude are left out.

    Returns:
        The parameters ``stars``, ``star``, ``magnitude`` and ``s_N``, the brightest star first.

    Raises:
        ValueError: if shapes disagree, a direction is zero or not finite, or more than `CAPACITY` stars are left.
    """
    length = np.linalg.norm(s_N, axis=-1)
    if s_N.shape != (*magnitude.shape, 3) or not np.all(length > 0.0) or not np.isfinite(length.sum()):
        text = f"directions (n, 3) other than 0 and magnitudes (n,), got {s_N.shape} and {magnitude.shape}"
        raise ValueError(f"star catalogue: expected {text}; look at its file")
    chosen = np.flatnonzero(magnitude <= faintest)
    if len(chosen) > CAPACITY:
        raise ValueError(f"star catalogue: expected up to {CAPACITY} stars, got {len(chosen)}; choose a lower faintest")
    chosen = chosen[np.argsort(magnitude[chosen], kind="stable")]
    n = len(chosen)
    star, sorted_magnitude, directions = np.full(CAPACITY, -1), np.zeros(CAPACITY), np.zeros((CAPACITY, 3))
    star[:n], sorted_magnitude[:n] = chosen, magnitude[chosen]
    directions[:n] = s_N[chosen] / length[chosen, None]
    return {"stars": n, "star": star, "magnitude": sorted_magnitude, "s_N": directions}
