"""The shortest turn that brings an axis of the body to a direction. Compiled."""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.vectors import V3, angle_between, cross, norm, scale, unit


@compiled
def across(axis: V3) -> V3:
    """A unit vector across an axis of any length, by the body axis that is farthest from it."""
    x, y, z = math.fabs(axis[0]), math.fabs(axis[1]), math.fabs(axis[2])
    other = (1.0, 0.0, 0.0)
    if y <= x and y <= z:
        other = (0.0, 1.0, 0.0)
    elif z <= x and z <= y:
        other = (0.0, 0.0, 1.0)
    return unit(cross(axis, other))


@compiled
def alignment_error(axis_B: V3, heading_B: V3, small: float) -> V3:
    """sigma_BR of the reference in which ``axis_B`` points along ``heading_B``; both unit vectors in B components.

    Angles below ``small`` (rad) count as none. Within ``small`` of half a turn the way is chosen: about an axis across.
    """
    angle = angle_between(axis_B, heading_B)
    if angle < small:
        return (0.0, 0.0, 0.0)
    turn = cross(heading_B, axis_B)
    way = across(axis_B) if math.pi - angle < small else scale(1.0 / norm(turn), turn)
    return scale(math.tan(0.25 * angle), way)
