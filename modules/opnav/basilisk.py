"""Basilisk's conventions of disk navigation, which ``basilisk=True`` of a module reproduces.

They are kept to compare with Basilisk 2.12 and not right: angles, not their tangents, are scaled by the aspect ratio,
optical centres come from integer division, and only three planets exist. Lengths are in m.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import mrp_to_dcm
from fsw.math.compiled import compiled
from messages.opnav import CameraConfigMsg

PLANETS = {1: 399, 2: 499, 3: 599}
"""NAIF identifiers of Basilisk's planets."""
RADII = np.array([[399.0, 6378136.6, 6356751.9], [499.0, 3396190.0, 3376200.0], [599.0, 71492000.0, 71492000.0]])
"""NAIF identifier, equatorial and polar radius."""


def body_of(planet_id: float) -> int:
    """NAIF identifier of a planet of Basilisk, whose messages hold it as a float that is cut off; 0 if unknown."""
    return PLANETS.get(int(planet_id), 0)


def camera_of(
    field_of_view: float, width_px: int, height_px: int, sigma_CB: tuple[float, float, float]
) -> CameraConfigMsg:
    """The camera that Basilisk makes of a field of view.

    Args:
        field_of_view: along the columns of the image, edge to edge [rad].
        width_px: columns.
        height_px: rows.
        sigma_CB: attitude of the camera relative to the body, MRP, of any length.

    Raises:
        ValueError: if the field of view times the aspect ratio is not below pi.
    """
    x = 2.0 * math.tan(field_of_view * width_px / height_px / 2.0) / width_px
    y = 2.0 * math.tan(field_of_view / 2.0) / height_px
    return CameraConfigMsg(
        width_px=width_px,
        height_px=height_px,
        focal_px=np.array([1.0 / x, 1.0 / y]),
        center_px=np.array([(width_px - 1) / 2, (height_px - 1) / 2]),
        dcm_CB=np.array(mrp_to_dcm(sigma_CB)),
    )


@compiled
def basilisk_radii(body_id: int) -> tuple[float, float]:
    """Equatorial and polar radius [m] of a NAIF identifier; NaN if Basilisk has none."""
    for i in range(3):
        if RADII[i, 0] == body_id:
            return RADII[i, 1], RADII[i, 2]
    return math.nan, math.nan
