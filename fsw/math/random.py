"""Random numbers inside kernels: xoshiro256++ with a ziggurat for the normal distribution, about 5 ns a draw.

A stream is four 64-bit words in a module's state (a `Stream` field), seeded by the simulation. Sources: Blackman and
Vigna (2021), "Scrambled linear pseudorandom number generators", ACM Trans. Math. Softw. 47(4); Marsaglia and Tsang
(2000), "The ziggurat method for generating random variables", J. Stat. Softw. 5(8), with layer and value from
different bits as Doornik (2005) advises.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from messages.base import F64, U64

LAYERS = 256
_EDGE = 3.6541528853610088
"""Where the tail begins, for 256 layers of equal area."""


def _layers() -> tuple[F64, F64]:
    """Right edges x of the layers, from the base to the top, and exp(-x^2 / 2) there; (LAYERS + 1,) each."""
    area = _EDGE * math.exp(-0.5 * _EDGE * _EDGE) + math.sqrt(0.5 * math.pi) * math.erfc(_EDGE / math.sqrt(2.0))
    x = np.zeros(LAYERS + 1)
    x[0], x[1] = area / math.exp(-0.5 * _EDGE * _EDGE), _EDGE
    for i in range(2, LAYERS):
        x[i] = math.sqrt(-2.0 * math.log(area / x[i - 1] + math.exp(-0.5 * x[i - 1] * x[i - 1])))
    return x, np.exp(-0.5 * x * x)


_X, _F = _layers()

_17, _19, _23 = np.uint64(17), np.uint64(19), np.uint64(23)
_41, _45, _11 = np.uint64(41), np.uint64(45), np.uint64(11)
_1, _255 = np.uint64(1), np.uint64(255)
_UNIT = 2.0**-53


@compiled
def next_word(stream: U64) -> np.uint64:
    """The next 64 random bits; ``stream`` (4,) uint64, not all zero, advances."""
    s0, s1, s2, s3 = stream[0], stream[1], stream[2], stream[3]
    a = s0 + s3
    result = ((a << _23) | (a >> _41)) + s0
    t = s1 << _17
    s2 ^= s0
    s3 ^= s1
    stream[1] = s1 ^ s2
    stream[0] = s0 ^ s3
    stream[2] = s2 ^ t
    stream[3] = (s3 << _45) | (s3 >> _19)
    return result


@compiled
def uniform(stream: U64) -> float:
    """A number in [0, 1), a multiple of 2^-53."""
    return float(next_word(stream) >> _11) * _UNIT


@compiled
def normal(stream: U64) -> float:
    """A number from the normal distribution with mean 0 and standard deviation 1."""
    while True:
        word = next_word(stream)
        i = word & _255  # unsigned, so that numba need not look for negative indices
        u = 2.0 * (float(word >> _11) * _UNIT) - 1.0
        z = u * _X[i]
        if abs(z) < _X[i + _1]:
            return z
        if i == 0:
            return math.copysign(_tail(stream), u)
        if _F[i] + (_F[i + _1] - _F[i]) * uniform(stream) < math.exp(-0.5 * z * z):
            return z


@compiled
def _tail(stream: U64) -> float:
    """A normal number beyond the edge, by Marsaglia's exponential rejection (1964)."""
    while True:
        a = -math.log(1.0 - uniform(stream)) / _EDGE
        b = -math.log(1.0 - uniform(stream))
        if b + b >= a * a:
            return _EDGE + a
