"""Attitude from two directions that are known in two frames (TRIAD), and the direction to the Sun from photocells.

Of two sensors the more accurate one gives the anchor: its direction is met exactly, and the other only says how the
body is turned about it. With errors of sigma_a and sigma_o (rad, each axis) and the angle theta between the directions
the attitude is wrong by sigma_a about two axes and by ``sqrt(sigma_o^2 + sigma_a^2 cos^2 theta) / sin theta`` about the
anchor. Source: Shuster and Oh (1981), "Three-Axis Attitude Determination from Vector Observations", J. Guidance and
Control 4(1):70-77, eq. 9 to 13.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fsw.math.compiled import compiled, plain
from fsw.math.vectors import M3, V3, axpy, cross, matmul, norm, transpose, unit, vec3
from messages.base import F64

PARALLEL = 1e-3
"""Directions are parallel if the sine of their angle is below this: errors grow by more than a thousand."""


@compiled
def axes_of(anchor: V3, other: V3) -> M3:
    """Three unit vectors as rows: along ``anchor``, along ``anchor`` x ``other``, and what completes them.

    The lengths of the two do not matter. NaN if they are parallel, or one is zero or NaN.
    """
    nan = (math.nan, math.nan, math.nan)
    first = unit(anchor)
    normal = cross(first, unit(other))
    if not norm(normal) > PARALLEL:
        return nan, nan, nan
    second = unit(normal)
    return first, second, cross(first, second)


@compiled
def triad(anchor_B: V3, other_B: V3, anchor_N: V3, other_N: V3) -> M3:
    """dcm_BN from two directions measured in B and known in N; NaN if those of a pair are parallel."""
    return matmul(transpose(axes_of(anchor_B, other_B)), axes_of(anchor_N, other_N))


@compiled
def sun_direction(signal: F64, normals_B: F64, least: float) -> V3:
    """Unit vector to the Sun, B components, from cells in opposite pairs on three axes at right angles.

    Args:
        signal: (n,) readings, 1 faces the Sun at 1 au. normals_B: (n, 3) unit normals of the cells.
        least: shortest sum of readings times normals that is light, not noise; below it (eclipse) the answer is NaN.
    """
    total = (0.0, 0.0, 0.0)
    for i in range(len(signal)):
        total = axpy(signal[i], vec3(normals_B[i]), total)
    if not norm(total) >= least:
        return (math.nan, math.nan, math.nan)
    return unit(total)


def dcm_from_directions(
    anchor_B: Sequence[float] | F64,
    other_B: Sequence[float] | F64,
    anchor_N: Sequence[float] | F64,
    other_N: Sequence[float] | F64,
) -> F64:
    """`triad` for the set-up of a scenario: dcm_BN (3, 3), so that B's anchor lies along N's and the others near.

    To mount a sensor whose x and z axes are to look along two directions of the body, say.

    Raises:
        ValueError: if the two of a pair are parallel, or a vector is not three finite numbers or is zero.
    """
    named = {"anchor_B": anchor_B, "other_B": other_B, "anchor_N": anchor_N, "other_N": other_N}
    found: dict[str, V3] = {}
    for name, value in named.items():
        a = np.asarray(value, np.float64)
        if a.shape != (3,) or not np.all(np.isfinite(a)) or not a.any():
            raise ValueError(f"{name}: expected three finite numbers, not all zero, got {a.tolist()}")
        found[name] = (float(a[0]), float(a[1]), float(a[2]))
    for anchor, other in (("anchor_B", "other_B"), ("anchor_N", "other_N")):
        if math.isnan(plain(axes_of)(found[anchor], found[other])[0][0]):
            text = f"expected two directions at an angle, got parallel ones, {found[anchor]} and {found[other]}"
            raise ValueError(f"{anchor}, {other}: {text}; nothing says how to turn about them")
    return np.array(plain(triad)(**found))
