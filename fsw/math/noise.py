"""Noise models discretised exactly for any interval, so that results do not depend on the sampling. Compiled.

Times in s. Sources: Farrenkopf (1978), J. Guidance and Control 1(4); Crassidis and Junkins, "Optimal Estimation of
Dynamic Systems", 2nd ed., eq. 7.143; Gelb (ed.), "Applied Optimal Estimation", sec. 3.8.
"""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.random import normal
from messages.base import U64


@compiled
def gauss_markov_factors(dt: float, tau: float) -> tuple[float, float]:
    """Factors (keep, fresh) of a first-order Gauss-Markov process of unit variance, ``x = keep x + fresh n``.

    Args:
        dt: time since the last value [s]; negative if there is none, then x comes from the stationary distribution.
        tau: correlation time [s], > 0.
    """
    if dt < 0.0:
        return 0.0, 1.0
    return math.exp(-dt / tau), math.sqrt(-math.expm1(-2.0 * dt / tau))


@compiled
def random_walk(stream: U64, value: float, density: float, dt: float) -> float:
    """The value of a random walk after ``dt`` [s]; ``density`` in units of the value per s^0.5; dt < 0 leaves it."""
    return value + density * math.sqrt(max(dt, 0.0)) * normal(stream)


@compiled
def walk_spreads(white: float, walk: float, dt: float) -> tuple[float, float]:
    """What `mean_of_walk` multiplies its draws by; the same for all axes of a sample, so taken once.

    Args:
        white: density of the white noise, such as an angle random walk [rad/s^0.5].
        walk: density of the bias walk, such as a rate random walk [rad/s^1.5].
        dt: length of the interval [s], > 0.

    Returns:
        Standard deviations of the step of the bias, and of the mean about the mean of old and new bias.
    """
    return walk * math.sqrt(dt), math.sqrt(white * white / dt + walk * walk * dt / 12.0)


@compiled
def mean_of_walk(stream: U64, bias: float, step: float, spread: float) -> tuple[float, float]:
    """New bias, and mean over an interval of white noise plus a walking bias (Farrenkopf).

    Args:
        stream: random stream, two normal numbers are drawn.
        bias: at the start of the interval.
        step: first of the `walk_spreads` of the interval.
        spread: second of them.
    """
    new = bias + step * normal(stream)
    return new, 0.5 * (bias + new) + spread * normal(stream)
