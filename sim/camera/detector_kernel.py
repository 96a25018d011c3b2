"""The loops of `sim.camera.detector`, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from fsw.math.random import next_word, normal, uniform
from messages.base import F64, U64

EXACT_BELOW = 30.0
"""Mean number of electrons below which the Poisson distribution is drawn exactly, and above which it is a Gaussian."""


@compiled
def split(stream: U64, out: U64) -> None:
    """Independent streams (n, 4) for the parts of an image, from the words of ``stream`` (4,), which advances."""
    for i in range(out.shape[0]):
        for k in range(4):
            out[i, k] = next_word(stream)


@compiled
def poisson(stream: U64, mean: float) -> float:
    """A whole number from the Poisson distribution, by inversion; exact, and made for small means.

    Source: Devroye (1986), "Non-uniform random variate generation", sec. X.3.2.
    """
    left, chance, count = uniform(stream), math.exp(-mean), 0.0
    while left >= chance and count < 1000.0:  # rounding can leave a rest that no count takes
        left -= chance
        count += 1.0
        chance *= mean / count
    return count


@compiled
def cosmic_rays(stream: U64, rays: float, signal: float, channels: int, out: NDArray[np.float32]) -> None:
    """Add the electrons of cosmic rays to ``out`` (rows, columns * channels).

    Rays come at random places and angles of incidence (cosine law) and run straight on in the image for
    tan(incidence) pixels, 30 at most; the electrons of a pixel are exponentially distributed with the mean ``signal``.
    """
    rows, columns = out.shape[0], out.shape[1] // channels
    count = poisson(stream, rays % EXACT_BELOW)
    for _ in range(int(rays // EXACT_BELOW)):
        count += poisson(stream, EXACT_BELOW)
    for _ in range(int(count)):
        x, y = uniform(stream) * columns, uniform(stream) * rows
        angle = 2.0 * math.pi * uniform(stream)
        square = uniform(stream)  # of the sine of the incidence
        length = min(math.sqrt(square / (1.0 - square)), 30.0)
        for k in range(int(length) + 1):
            row, column = int(math.floor(y + k * math.sin(angle))), int(math.floor(x + k * math.cos(angle)))
            if 0 <= row < rows and 0 <= column < columns:
                for c in range(channels):
                    out[row, column * channels + c] += -signal * math.log(1.0 - uniform(stream))


@compiled
def expose_band(
    light: NDArray[np.float32],
    response: NDArray[np.float32],
    dark: NDArray[np.float32],
    struck: NDArray[np.float32],
    numbers: F64,
    table: NDArray[np.uint8],
    stream: U64,
    out: NDArray[np.uint8],
) -> int:
    """Electrons, noise and grey levels of a few rows.

    Args:
        light: (rows, n) linear.
        response: the same: factor on the light.
        dark: the same: electrons at nominal exposure.
        struck: the same: electrons of cosmic rays; or (1, 1) for none.
        numbers: (7,): electrons for light 1, exposure factor, full well [electrons], shot noise (0 or 1), read noise
            [electrons], levels per electron, level of black.
        table: grey level of eight bits for each level of the converter.
        stream: of these rows; it advances.
        out: (rows, n), grey levels.

    Returns:
        How many values of the light are negative, NaN or infinite.
    """
    electrons, exposure, well, shot, read = numbers[0], numbers[1], numbers[2], numbers[3] > 0.0, numbers[4]
    levels, black, top = numbers[5], numbers[6] + 0.5, float(table.shape[0] - 1)
    hits, bad = struck.shape == light.shape, 0
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            value = light[i, j]
            if not 0.0 <= value < math.inf:
                bad += 1
                continue
            mean = value * electrons * response[i, j] + dark[i, j] * exposure
            if hits:
                mean += struck[i, j]
            charge = mean
            joined = False
            if shot:
                if mean < EXACT_BELOW:
                    charge = poisson(stream, mean)
                else:
                    spread = math.sqrt(mean)
                    if mean + 8.0 * spread < well:  # far from the full well, one draw stands for both noises
                        charge = mean + math.sqrt(mean + read * read) * normal(stream)
                        joined = True
                    elif mean - 8.0 * spread < well:
                        charge = mean + spread * normal(stream)
            if not joined:
                charge = min(charge, well)
                if read > 0.0:
                    charge += read * normal(stream)
            level = min(max(math.floor(charge * levels + black), 0.0), top)
            out[i, j] = table[int(level)]
    return bad
