"""Basilisk's headingSuKF as it is in release 2.12.1, with its faults, to compare with."""

from __future__ import annotations

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, transpose_in_place
from fsw.math.unscented import unscented_weights
from fsw.math.vectors import add, cross, dot, norm, scale, vec3
from fsw.module import Row
from messages.base import F64
from modules.estimation.heading_ukf.kernel import frame_of, help_axis, measure_direction, too_close
from modules.estimation.relative_od_ukf import status
from modules.estimation.relative_od_ukf.basilisk import (
    basilisk_measurement_update,
    basilisk_time_update,
    factor_of,
    post_fit,
)


@compiled
def euler_step(point: F64, dt: float, number: int) -> int:
    """One Euler step of the direction; rates are the negative of those of B and stay as they are."""
    d = (point[0], point[1], point[2])
    axes = frame_of(d, help_axis(number))
    turn = cross(add(scale(point[3], axes[1]), scale(point[4], axes[2])), d)
    for i in range(3):
        point[i] += dt * turn[i]
    return OK


@compiled
def as_basilisk(t_ns: int, params: Row, state: Row, measured: Row, out: Row) -> int:
    """One call of Basilisk's headingSuKF; rates in ``state.x`` have its sign. Returns the status."""
    n, weights, noise = 5, unscented_weights(5, params.alpha, params.beta, params.kappa), np.empty((5, 5))
    if not state.started:
        for i in range(3):
            state.x[i] = params.u_PC_B[i]
        state.x[3], state.x[4] = -params.rate_S[0], -params.rate_S[1]
        cholesky(params.P, state.S)
        state.time, state.started = params.start_ns * 1e-9, True
    factor_of(params.process_noise, noise)
    transpose_in_place(noise)
    points, middle, seen, observed = np.empty((11, n)), np.empty(n), np.empty((11, 3)), np.zeros(3)
    t, t_measured, what = t_ns * 1e-9, measured.t_ns * 1e-9, status.NO_MEASUREMENT
    for i in range(3):
        out.residual[i] = 0.0
    if too_close(state.x, state.helper):  # the factor is left in the old frame
        d = (state.x[0], state.x[1], state.x[2])
        old, new = frame_of(d, help_axis(state.helper)), frame_of(d, help_axis(1 - state.helper))
        omega = add(scale(state.x[3], old[1]), scale(state.x[4], old[2]))
        state.x[3], state.x[4] = dot(new[1], omega), dot(new[2], omega)
        state.helper = 1 - state.helper
    if measured.seq != 0 and measured.valid and t_measured >= state.time:
        code = basilisk_time_update(euler_step, t_measured, state.helper, weights, noise, state, points, middle)
        what = status.UPDATED if code == OK else status.FAILED_PREDICTION
        far, R = norm(vec3(measured.r_CP_B)), np.empty((3, 3))
        for i in range(3):
            observed[i] = -measured.r_CP_B[i] / far
            for j in range(3):
                R[i, j] = measured.P_rr_B[i, j] / (far * far)
        for p in range(11):
            measure_direction(points[p], seen[p], 0.0)
        code = basilisk_measurement_update(weights, params.noise_scale, R, observed, seen, points, middle, state)
        what = what if code == OK else status.FAILED_UPDATE
    if t > state.time:
        basilisk_time_update(euler_step, t, state.helper, weights, noise, state, points, middle)
    if what != status.NO_MEASUREMENT:
        for p in range(11):
            measure_direction(points[p], seen[p], 0.0)
        post_fit(weights, observed, seen, out.residual)
    return what
