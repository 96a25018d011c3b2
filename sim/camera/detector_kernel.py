"""The loops of `sim.camera.detector`, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from fsw.math.compiled import compiled
from fsw.math.random import next_word, normal, uniform
from messages.base import F64, U64

EXACT_BELOW = 30.0
"""Mean number of electrons below which the Poisson distribution is drawn exactly, and above which it is a Gaussian."""


def _quantiles() -> NDArray[np.float32]:
    """Means of the normal distribution over 2^16 intervals of equal chance, scaled to unit variance.

    A quarter of a random word is then a normal number at a tenth of the cost of an exact one; the largest is 4.4.
    """
    edges = ndtri(np.arange(65537) / 65536.0)
    density = np.exp(-0.5 * edges * edges)
    z = (density[:-1] - density[1:]) * 65536.0 / math.sqrt(2.0 * math.pi)
    return (z / math.sqrt(float(z @ z) / 65536.0)).astype(np.float32)


_NORMAL = _quantiles()
_INVERSE = np.concatenate([[0.0], 1.0 / np.arange(1.0, 200.0)])
_16, _LOW = np.uint64(16), np.uint64(65535)


@compiled
def normals(stream: U64, out: NDArray[np.float32]) -> None:
    """Normal numbers for the pixels of a row, ``out`` (n,), n a multiple of 4."""
    for i in range(0, out.shape[0], 4):
        word = next_word(stream)
        for k in range(4):
            out[i + k] = _NORMAL[word & _LOW]
            word >>= _16


@compiled
def split(stream: U64, out: U64) -> None:
    """Independent streams (n, 4) for the parts of an image, from the words of ``stream`` (4,), which advances."""
    for i in range(out.shape[0]):
        for k in range(4):
            out[i, k] = next_word(stream)


@compiled
def poisson(draw: float, mean: float) -> float:
    """A whole number from the Poisson distribution, by inversion; exact, for means of up to 30.

    Args:
        draw: a number drawn evenly from [0, 1).
        mean: of the distribution.

    Source: Devroye (1986), "Non-uniform random variate generation", sec. X.3.2.
    """
    left, chance, count = draw, math.exp(-mean), 0
    while left >= chance and count < 199:  # rounding can leave a rest that no count takes
        left -= chance
        count += 1
        chance *= mean * _INVERSE[count]
    return float(count)


@compiled
def cosmic_rays(stream: U64, rays: float, signal: float, channels: int, out: NDArray[np.float32]) -> None:
    """Add the electrons of cosmic rays to ``out`` (rows, columns * channels).

    Rays come at random places and angles of incidence (cosine law) and run straight on in the image for
    tan(incidence) pixels, 30 at most; the electrons of a pixel are exponentially distributed with the mean ``signal``.
    """
    rows, columns = out.shape[0], out.shape[1] // channels
    count = poisson(uniform(stream), rays % EXACT_BELOW)
    for _ in range(int(rays // EXACT_BELOW)):
        count += poisson(uniform(stream), EXACT_BELOW)
    for _ in range(int(count)):
        x, y = uniform(stream) * columns, uniform(stream) * rows
        angle = 2.0 * math.pi * uniform(stream)
        square = uniform(stream)  # of the sine of the incidence
        length = min(math.sqrt(square / (1.0 - square)), 30.0)
        for k in range(int(length) + 1):
            row, column = math.floor(y + k * math.sin(angle)), math.floor(x + k * math.cos(angle))
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
    rows, columns = light.shape
    noise = np.zeros(4 * ((columns + 3) // 4), np.float32)
    hits, bad, read2 = struck.shape == light.shape, 0, read * read
    for i in range(rows):
        if shot or read > 0.0:
            normals(stream, noise)
        for j in range(columns):
            value = light[i, j]
            if not 0.0 <= value < math.inf:
                bad += 1
                value = np.float32(0.0)
            mean = value * electrons * response[i, j] + dark[i, j] * exposure
            if hits:
                mean += struck[i, j]
            charge, deviation = mean, read
            if shot and mean > 0.0:
                spread = math.sqrt(mean)
                if mean < EXACT_BELOW:
                    charge = poisson(uniform(stream), mean)
                elif mean + 8.0 * spread < well:  # far from the full well, one draw stands for both noises
                    deviation = math.sqrt(mean + read2)
                elif mean - 8.0 * spread < well:
                    charge = mean + spread * normal(stream)
            charge = min(charge, well) + deviation * noise[j]
            out[i, j] = table[int(min(max(charge * levels + black, 0.0), top))]
    return bad
