"""What electronics do to a measured number: steps of the last digit, limits of the range. Compiled."""

from __future__ import annotations

import math

from fsw.math.compiled import compiled


@compiled
def saturated(x: float, limit: float) -> float:
    """x limited to +-limit; a limit of 0 is none."""
    if limit > 0.0 and math.fabs(x) > limit:
        return math.copysign(limit, x)
    return x


@compiled
def quantised(x: float, step: float) -> float:
    """x rounded to the nearest multiple of ``step``, halves upwards; a step of 0 is none."""
    if step > 0.0:
        return step * math.floor(x / step + 0.5)
    return x


@compiled
def digitised(x: float, step: float, limit: float) -> float:
    """x rounded to multiples of ``step``, then limited to +-limit."""
    return saturated(quantised(x, step), limit)
