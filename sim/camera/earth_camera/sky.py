"""Stars in the picture, beyond the Earth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import project
from fsw.math.stars import StarCatalogue
from messages.base import F64
from sim.camera.earth_camera.kernel import F32

SUN_MAGNITUDE = -26.74
"""Visual magnitude of the Sun (Willmer 2018)."""
SUN_B_V = 0.65
"""Its colour; a star of the same is white."""


def star_light(stars: StarCatalogue, focal_px: float) -> F32:
    """Light of each star in each channel (n, 3), summed over pixels, where white ground below the Sun is 1 in each.

    White ground of Lambert's kind has the radiance E / pi under the irradiance E of the Sun, and a pixel covers the
    solid angle 1 / focal^2; so a star of irradiance S is worth pi S focal^2 / E.
    """
    green = math.pi * focal_px**2 * 10.0 ** (-0.4 * (stars.magnitude - SUN_MAGNITUDE))
    redder = np.nan_to_num(stars.b_v, nan=SUN_B_V) - SUN_B_V
    factors = 10.0 ** (0.4 * redder[:, None] * np.array([0.6, 0.0, -1.0]))
    return (green[:, None] * factors).astype(np.float32)


def add_stars(
    image: F32, sky: NDArray[np.bool_], channels: tuple[int, ...], lens: F64, dcm_CN: F64, u_N: F64, light: F32
) -> None:
    """Add stars to a picture, each shared by four pixels such that its centre is right.

    Args:
        image: in and out (rows, columns, 3).
        sky: where nothing hides them (rows, columns).
        channels: into which to draw.
        lens: lens vector of `fsw.math.camera`.
        dcm_CN: attitude at each row (n, 3, 3); the last one stands for all further rows.
        u_N: directions (n, 3).
        light: as of `star_light`.
    """
    rows, columns = sky.shape
    pixel = np.empty((len(u_N), 2))
    middle = min(rows // 2, len(dcm_CN) - 1)
    project(lens, np.ascontiguousarray(u_N @ dcm_CN[middle].T), pixel)
    if len(dcm_CN) > 1:  # at the time of the row that they fall on
        row = np.clip(np.nan_to_num(pixel[:, 1], nan=0.0), 0, len(dcm_CN) - 1).astype(int)
        project(lens, np.ascontiguousarray(np.einsum("nij,nj->ni", dcm_CN[row], u_N)), pixel)
    x, y = pixel[:, 0], pixel[:, 1]
    kept = (x >= 0.0) & (x < columns - 1.0) & (y >= 0.0) & (y < rows - 1.0)  # false where NaN
    x, y, light = x[kept], y[kept], light[kept]
    j, i = x.astype(int), y.astype(int)
    x, y = x - j, y - i
    for di, dj, w in ((0, 0, (1 - x) * (1 - y)), (0, 1, x * (1 - y)), (1, 0, (1 - x) * y), (1, 1, x * y)):
        seen = w * sky[i + di, j + dj]
        for c in channels:
            np.add.at(image[..., c], (i + di, j + dj), (seen * light[:, c]).astype(np.float32))
