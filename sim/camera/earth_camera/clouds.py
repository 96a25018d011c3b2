"""Procedural clouds: fractal noise fixed to the Earth, so that they stay when the camera moves. Compiled."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.geodesy import A, ecef_from_geodetic, ray_to_spheroid
from fsw.math.vectors import V3
from messages.base import F64
from sim.camera.earth_camera.kernel import F32, FULL, SCALE_HEIGHT, U8, U16

LATTICE = 64
"""Random numbers in each direction; a power of two, so that they repeat by masking."""
LONGEST = 500e3
"""Wavelength of the coarsest noise [m]."""
OCTAVES = 11
KEPT = 0.62
"""Strength of each octave, of the one before."""
SPREAD = 0.092
"""Standard deviation of the noise."""
SOFT = 0.1
"""Noise from clear sky to thick cloud."""
BRIGHTNESS = 0.8
"""Reflectance of a thick cloud."""
SHADE = 0.65
"""Part of the light that a thick cloud keeps from the ground."""


def noise_lattice(seed: int) -> F32:
    """Numbers between 0 and 1, (LATTICE, LATTICE, LATTICE), of a seed."""
    return np.random.default_rng(seed).random((LATTICE, LATTICE, LATTICE), np.float32)


def threshold(cover: float) -> float:
    """Level of the noise above which there is cloud, for a part of the sky; the noise is nearly normal."""
    from scipy.stats import norm

    return float(0.5 - SPREAD * norm.ppf(min(max(cover, 1e-6), 1.0 - 1e-6)) - 0.5 * SOFT)


@compiled
def _ease(t: float) -> float:
    return t * t * (3.0 - 2.0 * t)


@compiled
def noise(lattice: F32, x: float, y: float, z: float) -> float:
    """Smooth noise between 0 and 1; one wave is one unit (Perlin 1985, with values for gradients)."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    x, y, z = _ease(x - i), _ease(y - j), _ease(z - k)
    mask = LATTICE - 1
    i, j, k = int(i) & mask, int(j) & mask, int(k) & mask
    a, b, c = (i + 1) & mask, (j + 1) & mask, (k + 1) & mask
    low = (1.0 - y) * ((1.0 - x) * lattice[i, j, k] + x * lattice[a, j, k])
    low += y * ((1.0 - x) * lattice[i, b, k] + x * lattice[a, b, k])
    high = (1.0 - y) * ((1.0 - x) * lattice[i, j, c] + x * lattice[a, j, c])
    high += y * ((1.0 - x) * lattice[i, b, c] + x * lattice[a, b, c])
    return (1.0 - z) * low + z * high


@compiled
def density(lattice: F32, r: V3, least: float, size: float) -> float:
    """Opacity of the clouds at an Earth-fixed place, 0 to 1.

    Args:
        lattice: as of `noise_lattice`.
        r: the place [m].
        least: as of `threshold`.
        size: of a pixel there [m]; shorter waves are left out.
    """
    total, weight, wave = 0.0, 1.0 - KEPT, LONGEST
    bend = noise(lattice, r[2] / 500e3 + 7.3, r[0] / 500e3, r[1] / 500e3) - 0.5
    x, y, z = r[0] + 250e3 * bend, r[1] - 250e3 * bend, r[2] + 120e3 * bend
    left = 1.0
    for k in range(OCTAVES):
        if wave < 2.0 * size:
            break
        shift = 17.17 * k
        total += weight * noise(lattice, x / wave + shift, y / wave - shift, z / wave + 0.5 * shift)
        left -= weight
        weight *= KEPT
        wave *= 0.45
    thick = (total + 0.5 * left - least) / SOFT
    return _ease(min(max(thick, 0.0), 1.0))


@compiled
def cloud_band(
    x_tan: F64, y_tan: F64, first: int, r_E: F64, dcm_CE: F64, sun_E: F64, lat: F64, lon: F64,
    lattice: F32, least: float, height: float, focal: float, seen: U16, mass: F32, want: U8,
) -> None:  # fmt: skip
    """Put clouds, and their shadows on the ground, over the reflectance of a band.

    Args:
        x_tan: as of `kernel.ground_band`; y_tan, first, r_E, dcm_CE, sun_E, lat, lon: likewise.
        y_tan: see there.
        first: see there.
        r_E: see there.
        dcm_CE: see there.
        sun_E: see there.
        lat: see there.
        lon: see there.
        lattice: as of `density`.
        least: likewise.
        height: of the clouds [m].
        focal: length [px].
        seen: in and out, reflectance (rows, columns, 4), 0 to FULL.
        mass: in and out, air masses; there is less air above a cloud.
        want: pixels that are 1 have no map; what is seen of them is no ground.
    """
    below = 1.0 - math.exp(-height / SCALE_HEIGHT)
    for i in range(x_tan.shape[0]):
        k = min(first + i, r_E.shape[0] - 1)
        r = (r_E[k, 0], r_E[k, 1], r_E[k, 2])
        for j in range(x_tan.shape[1]):
            if math.isnan(lat[i, j]):
                continue
            u, v = x_tan[i, j], y_tan[i, j]
            per = 1.0 / math.sqrt(u * u + v * v + 1.0)
            d = (
                per * (dcm_CE[k, 0, 0] * u + dcm_CE[k, 1, 0] * v + dcm_CE[k, 2, 0]),
                per * (dcm_CE[k, 0, 1] * u + dcm_CE[k, 1, 1] * v + dcm_CE[k, 2, 1]),
                per * (dcm_CE[k, 0, 2] * u + dcm_CE[k, 1, 2] * v + dcm_CE[k, 2, 2]),
            )
            t = ray_to_spheroid(r[0], r[1], r[2], d[0], d[1], d[2], height)
            cover, size = 0.0, 100.0
            if t >= 0.0:
                size = t / focal
                cover = density(lattice, (r[0] + t * d[0], r[1] + t * d[1], r[2] + t * d[2]), least, size)
            dark = 0.0
            if want[i, j] == 0 and cover < 0.999:
                ground = ecef_from_geodetic(lat[i, j], lon[i, j], 0.0)
                up = (ground[0] * sun_E[0] + ground[1] * sun_E[1] + ground[2] * sun_E[2]) / A
                if up > 0.05:
                    t = height / up
                    there = (ground[0] + t * sun_E[0], ground[1] + t * sun_E[1], ground[2] + t * sun_E[2])
                    dark = SHADE * density(lattice, there, least, size)
            mass[i, j] *= 1.0 - cover * below
            for c in range(3):
                value = (1.0 - cover) * (1.0 - dark) * seen[i, j, c] + cover * BRIGHTNESS * FULL
                seen[i, j, c] = np.uint16(value + 0.5)
