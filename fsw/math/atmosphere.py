"""Density of the air: exponential bands, and the mean table of the Earth. Compiled."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from messages.base import F64

EARTH_BANDS: F64 = np.array([
    [0.0, 1.225, 7.249], [25.0, 3.899e-2, 6.349], [30.0, 1.774e-2, 6.682], [40.0, 3.972e-3, 7.554],
    [50.0, 1.057e-3, 8.382], [60.0, 3.206e-4, 7.714], [70.0, 8.770e-5, 6.549], [80.0, 1.905e-5, 5.799],
    [90.0, 3.396e-6, 5.382], [100.0, 5.297e-7, 5.877], [110.0, 9.661e-8, 7.263], [120.0, 2.438e-8, 9.473],
    [130.0, 8.484e-9, 12.636], [140.0, 3.845e-9, 16.149], [150.0, 2.070e-9, 22.523], [180.0, 5.464e-10, 29.740],
    [200.0, 2.789e-10, 37.105], [250.0, 7.248e-11, 45.546], [300.0, 2.418e-11, 53.628], [350.0, 9.518e-12, 53.298],
    [400.0, 3.725e-12, 58.515], [450.0, 1.585e-12, 60.828], [500.0, 6.967e-13, 63.822], [600.0, 1.454e-13, 71.835],
    [700.0, 3.614e-14, 88.667], [800.0, 1.170e-14, 124.64], [900.0, 5.245e-15, 181.05], [1000.0, 3.019e-15, 268.00],
])  # fmt: skip
"""Base height (km), density there (kg/m^3), scale height (km) of 28 bands: Vallado, "Fundamentals of Astrodynamics and
Applications", 4th ed., table 8-4 (US Standard Atmosphere 1976 to 25 km, CIRA-72 above, mean solar activity)."""
EARTH_BANDS.setflags(write=False)


@compiled
def band_of(height: float, base: F64, count: int, guess: int) -> int:
    """Which band a height (m) lies in; ``base`` (n,) m are the heights at which the ``count`` bands begin, ascending.

    The first band reaches down to any depth, the last one up to any height. A right ``guess`` saves the search; NaN
    gives the first band.
    """
    if 0 <= guess < count and base[guess] <= height and (guess + 1 == count or height < base[guess + 1]):
        return guess
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if height >= base[middle]:
            low = middle
        else:
            high = middle
    return low


@compiled
def exponential_density(height: float, base: F64, density: F64, band: int, steepness: float) -> float:
    """Density in a band: rho_i exp(-(h - h_i) / H_i).

    Args:
        height: m; below the first band its base density is returned.
        base: (n,) heights at which bands begin, m.
        density: (n,) densities there, kg/m^3.
        band: number of the band, of `band_of`.
        steepness: 1 / H_i of that band, 1/m.

    Returns:
        kg/m^3; NaN if the height is NaN.
    """
    if band == 0 and height < base[0]:
        return density[0]
    return density[band] * math.exp((base[band] - height) * steepness)


@compiled
def height_above_spheroid(square: float, z: float, radius: float, flattening: float) -> float:
    """Height along the radius above a flattened planet, m.

    It exceeds the geodetic height by h (f sin 2 lat)^2 / 2 at most: 3 m at 500 km above the Earth. NaN at the centre.

    Args:
        square: of the distance from the centre, m^2.
        z: distance from the equator's plane, m.
        radius: of the equator, m.
        flattening: of the spheroid.
    """
    if not square > 0.0:
        return math.nan
    polar = 1.0 - flattening
    ratio = square / (polar * polar * (square - z * z) + z * z)  # so that both roots can be taken at once
    return math.sqrt(square) - radius * polar * math.sqrt(ratio)
