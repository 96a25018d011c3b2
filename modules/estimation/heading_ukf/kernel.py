"""Motion of a direction in B under the rates across it, the frame S of these rates, and prediction."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.square_root import NOT_FINITE, OK, semidefinite_factor, transpose_in_place
from fsw.math.unscented import Weights, time_update
from fsw.math.vectors import M3, V3, add, cross, dot, norm, scale, unit
from messages.base import F64
from modules.estimation.relative_od_ukf.kernel import copy_into

CLOSE = 0.866
"""Cosine of the angle between direction and helping vector above which another helping vector is taken."""


@compiled
def help_axis(number: int) -> V3:
    """Helping vector of the frame S: the first or the second axis of B."""
    return (1.0, 0.0, 0.0) if number == 0 else (0.0, 1.0, 0.0)


@compiled
def frame_of(d: V3, helper: V3) -> M3:
    """Axes of S in B components, as rows: d, d x helper, d x (d x helper), all of length 1."""
    s1, s2 = unit(d), unit(cross(d, helper))
    return (s1, s2, unit(cross(s1, s2)))


@compiled
def turning(state: F64, dt: float, number: int) -> int:
    """Direction and rates (5,) after dt [s] of a constant rate across the direction, in place."""
    d, helper = (state[0], state[1], state[2]), help_axis(number)
    axes = frame_of(d, helper)
    omega = add(scale(state[3], axes[1]), scale(state[4], axes[2]))
    rate = norm(omega)
    if rate > 0.0:
        angle = rate * dt
        d = add(scale(math.cos(angle), d), scale(math.sin(angle) / rate, cross(d, omega)))
        axes = frame_of(d, helper)
        state[0], state[1], state[2] = d
        state[3], state[4] = dot(axes[1], omega), dot(axes[2], omega)
    return OK if math.isfinite(d[0] + d[1] + d[2] + state[3] + state[4]) else NOT_FINITE


@compiled
def reframed(state: F64, _: float, number: int) -> int:
    """The same rate (5,) in the frame of the other helping vector, in place."""
    d = (state[0], state[1], state[2])
    old, new = frame_of(d, help_axis(number)), frame_of(d, help_axis(1 - number))
    omega = add(scale(state[3], old[1]), scale(state[4], old[2]))
    state[3], state[4] = dot(new[1], omega), dot(new[2], omega)
    return OK if math.isfinite(state[3] + state[4]) else NOT_FINITE


@compiled
def too_close(x: F64, number: int) -> bool:
    """Whether the direction is so near to the helping vector that S is ill defined."""
    d = unit((x[0], x[1], x[2]))
    return math.fabs(dot(d, help_axis(number))) > CLOSE


@compiled
def predict_heading(
    Q: F64, weights: Weights, max_step: float, from_ns: int, to_ns: int, number: int, x: F64, S: F64
) -> tuple[int, int]:
    """Move an estimate (5,), (5, 5) on in steps of ``max_step`` [s] at most; unchanged on failure.

    Returns:
        `OK` or why not, and the number of the helping vector.
    """
    dt = (to_ns - from_ns) * 1e-9
    if not dt > 0.0:
        return OK, number
    count = max(1, math.ceil(dt / max_step - 1e-9))
    noise, before, S_before, start = np.empty((5, 5)), np.empty(5), np.empty((5, 5)), number
    for i in range(5):
        for j in range(5):
            S_before[i, j] = Q[i, j] * dt / count
    code = semidefinite_factor(S_before, noise)
    transpose_in_place(noise)
    copy_into(x, S, before, S_before)
    silent = np.zeros((5, 5))
    for _ in range(count):
        if code == OK and too_close(x, number):
            # as a motion without time: S depends on the direction, so its error goes to the rates
            code = time_update(reframed, 0.0, number, weights, silent, x, S)
            number = 1 - number
        if code == OK:
            code = time_update(turning, dt / count, number, weights, noise, x, S)
    if code != OK:
        copy_into(before, S_before, x, S)
        number = start
    return code, number


@compiled
def measure_direction(point: F64, seen: F64, _: float) -> int:
    """The direction is what is measured."""
    for i in range(3):
        seen[i] = point[i]
    return OK


@compiled
def direction_noise(u: V3, P: F64, far: float, R: F64) -> None:
    """Covariance R (3, 3) of a direction u from that of a position (3, 3) [m^2] at ``far`` [m].

    Across u it is what it is; along u, where a unit vector has no error and the state no meaning, the mean of that.
    """
    total = 0.0
    for i in range(3):
        for j in range(3):
            R[i, j] = 0.0
            for k in range(3):
                for m in range(3):
                    left = (1.0 if i == k else 0.0) - u[i] * u[k]
                    right = (1.0 if m == j else 0.0) - u[m] * u[j]
                    R[i, j] += left * P[k, m] * right / (far * far)
        total += R[i, i]
    for i in range(3):
        for j in range(3):
            R[i, j] += 0.5 * total * u[i] * u[j]
