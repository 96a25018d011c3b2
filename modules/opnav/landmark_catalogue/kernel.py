"""Places of the pixels of a chip, and which landmarks a camera sees, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fsw.math.camera import project_point
from fsw.math.compiled import compiled
from fsw.math.geodesy import ecef_from_geodetic, enu_dcm, geodetic_from_ecef

if TYPE_CHECKING:
    from messages.base import F64


@compiled
def plane_nodes(lat0: float, lon0: float, h0: float, gsd: float, middle: float, step: int, lat: F64, lon: F64) -> None:
    """Places of the pixels of a picture in the plane that touches the Earth at one place, north up.

    Each point of the plane stands for the ground vertically below it.

    Args:
        lat0: geodetic latitude of the place [rad].
        lon0: its longitude [rad].
        h0: its height [m].
        gsd: size of a pixel [m].
        middle: column and row of the place.
        step: pixels from node to node.
        lat: out, (rows, columns) of nodes [rad].
        lon: out, likewise [rad].
    """
    axes = np.empty((3, 3))
    enu_dcm(lat0, lon0, axes)
    x0, y0, z0 = ecef_from_geodetic(lat0, lon0, h0)
    for i in range(lat.shape[0]):
        north = (middle - step * i) * gsd
        for j in range(lat.shape[1]):
            east = (step * j - middle) * gsd
            lat[i, j], lon[i, j], _ = geodetic_from_ecef(
                x0 + east * axes[0, 0] + north * axes[1, 0],
                y0 + east * axes[0, 1] + north * axes[1, 1],
                z0 + east * axes[0, 2] + north * axes[1, 2],
            )


@compiled
def see(lens: F64, r_CE_E: F64, dcm_CE: F64, r_LE_E: F64, lat: F64, lon: F64, gsd: F64, out: F64) -> None:
    """Where landmarks appear, and how large a pixel of their chips does.

    Args:
        lens: lens vector of `fsw.math.camera` (11,).
        r_CE_E: position of the camera, Earth-fixed (3,) [m].
        dcm_CE: maps Earth-fixed to camera components (3, 3).
        r_LE_E: landmarks (n, 3) [m].
        lat: their geodetic latitude (n,) [rad].
        lon: their longitude (n,) [rad].
        gsd: size of a pixel of each chip (n,) [m].
        out: out, (n, 3): column, row [px], pixels of the image to one of the chip (square root of the area); NaN
            where the ground is turned away by more than 80 degrees or out of the lens's range.
    """
    for k in range(r_LE_E.shape[0]):
        dx, dy, dz = r_LE_E[k, 0] - r_CE_E[0], r_LE_E[k, 1] - r_CE_E[1], r_LE_E[k, 2] - r_CE_E[2]
        far = math.sqrt(dx * dx + dy * dy + dz * dz)
        cp = math.cos(lat[k])
        up = (cp * math.cos(lon[k]), cp * math.sin(lon[k]), math.sin(lat[k]))
        facing = -(up[0] * dx + up[1] * dy + up[2] * dz) / far
        out[k, 0], out[k, 1], out[k, 2] = math.nan, math.nan, math.nan
        if facing < 0.174:
            continue
        x = dcm_CE[0, 0] * dx + dcm_CE[0, 1] * dy + dcm_CE[0, 2] * dz
        y = dcm_CE[1, 0] * dx + dcm_CE[1, 1] * dy + dcm_CE[1, 2] * dz
        z = dcm_CE[2, 0] * dx + dcm_CE[2, 1] * dy + dcm_CE[2, 2] * dz
        if z <= 0.0:
            continue
        out[k, 0], out[k, 1] = project_point(lens, x, y, z)
        # an area across the ray is seen on f^2 far / z^3 pixels
        out[k, 2] = gsd[k] * math.sqrt(lens[0] * lens[1] * facing * far / z) / z
