"""Motion about a point mass for filters: Runge-Kutta steps of a state in place, and its process noise.

The state is an array that begins with position and velocity; what follows them does not move. Units are the caller's.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fsw.math.bodies import bodies
from fsw.math.compiled import compiled
from fsw.math.square_root import NOT_FINITE, OK
from fsw.math.vectors import V3, axpy, dot, scale
from messages.base import F64

GRAVITY = np.array([[float(b.naif), b.mu] for b in bodies()])
"""NAIF identifier and gravitational parameter [m^3/s^2], a row for each body."""


@compiled
def gravity_parameter(body_id: int, given: float) -> float:
    """Gravitational parameter [m^3/s^2]: the given one if positive, else that of the table; NaN if it is not there."""
    if given > 0.0:
        return given
    for i in range(GRAVITY.shape[0]):
        if GRAVITY[i, 0] == body_id:
            return GRAVITY[i, 1]
    return math.nan


@compiled
def pull(r: V3, mu: float) -> V3:
    """Acceleration -mu r / |r|^3; NaN in the middle."""
    far = math.sqrt(dot(r, r))
    if far == 0.0:
        return (math.nan, math.nan, math.nan)
    return scale(-mu / (far * far * far), r)


@compiled
def orbit_step(field: Callable[[V3, float], V3], state: F64, dt: float, mu: float) -> int:
    """One classical Runge-Kutta step of a state (6 or more,) by dt, which may be negative, in place.

    Args:
        field: acceleration at a position, as `pull`.
        state: position, velocity, and what does not move.
        dt: step.
        mu: gravitational parameter.

    Returns:
        `OK`, or `NOT_FINITE`, when it has run into the middle of the body or was not finite before.
    """
    r, v = (state[0], state[1], state[2]), (state[3], state[4], state[5])
    h, third, sixth = 0.5 * dt, 1.0 / 3.0, 1.0 / 6.0
    a1 = field(r, mu)
    v2 = axpy(h, a1, v)
    a2 = field(axpy(h, v, r), mu)
    v3 = axpy(h, a2, v)
    a3 = field(axpy(h, v2, r), mu)
    v4 = axpy(dt, a3, v)
    a4 = field(axpy(dt, v3, r), mu)
    total = 0.0
    for i in range(3):
        # products and sums in this order give the bits of Basilisk
        state[i] = r[i] + h * v[i] * third + h * v2[i] * (2.0 * third) + dt * v3[i] * third + dt * v4[i] * sixth
        state[3 + i] = v[i] + h * a1[i] * third + h * a2[i] * (2.0 * third) + dt * a3[i] * third + dt * a4[i] * sixth
        total += state[i] + state[3 + i]
    return OK if math.isfinite(total) else NOT_FINITE


@compiled
def two_body_motion(state: F64, dt: float, mu: float) -> int:
    """`orbit_step` about a point mass."""
    return orbit_step(pull, state, dt, mu)


@compiled
def noise_of_interval(Q: F64, dt: float, out: F64) -> None:
    """Covariance out (n, n) that white noise of density Q (n, n) leaves after dt [s], if velocity moves the position.

    Exact without gravity: Q dt + (F Q + Q F') dt^2/2 + F Q F' dt^3/3, where F says that position follows velocity. So
    it does not depend on how an interval is cut into steps, to first order in its share of an orbit.
    """
    n = Q.shape[0]
    for i in range(n):
        for j in range(n):
            total = Q[i, j] * dt
            if i < 3:
                total += Q[3 + i, j] * dt * dt / 2.0
            if j < 3:
                total += Q[i, 3 + j] * dt * dt / 2.0
            if i < 3 and j < 3:
                total += Q[3 + i, 3 + j] * dt * dt * dt / 3.0
            out[i, j] = total
