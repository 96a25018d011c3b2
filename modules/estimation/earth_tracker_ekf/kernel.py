"""A step of the filter: each new measurement at its own time, in the order of the times, and the prediction to now."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.extended import covariance_time
from fsw.math.square_root import NOT_FINITE, OK
from fsw.math.vectors import inverse, mat3, vec3
from fsw.module import Row
from messages.base import F64, I64
from messages.opnav import MAX_LANDMARKS
from modules.estimation.earth_tracker_ekf import status
from modules.estimation.earth_tracker_ekf.dynamics import Body, moved, noise
from modules.estimation.earth_tracker_ekf.error import BETA, RATE, STATES, carry_over, corrected
from modules.estimation.earth_tracker_ekf.fuse import batch, federated, gate_of, outcome, white_update
from modules.estimation.earth_tracker_ekf.linearise import Feeds, linearised, measured_at, sequence_of
from modules.estimation.earth_tracker_ekf.params import BATCH, FEDERATED, SEQUENTIAL
from modules.estimation.earth_tracker_ekf.status import SENSORS
from modules.estimation.pose_models.pose import OMEGA, SIZE, THETA
from modules.opnav.relative import orientation_at


@compiled
def body_of(t_ns: int, params: Row, torque: Row, orientation: Row) -> Body:
    """What moves, under the torque that is commanded, about the pole of the day."""
    pole, T = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0)
    inertia = mat3(params.inertia_B)
    if torque.seq != 0:
        T = vec3(torque.torque_B)
    if orientation.seq != 0:
        pole = orientation_at(orientation, t_ns)
    gravity = params.mu, params.radius, params.j2, pole
    return gravity, inertia, inverse(inertia), T, params.gravity_gradient, params.max_step


@compiled
def begin(params: Row, state: Row) -> None:
    """The initial state."""
    state.started, state.time_ns = True, params.start_ns
    size = 0.0
    for i in range(4):
        size += params.beta_BO[i] * params.beta_BO[i]
    for i in range(4):
        state.x[BETA + i] = params.beta_BO[i] / math.sqrt(size)
    for i in range(3):
        state.x[i], state.x[3 + i], state.x[RATE + i] = params.r_BN_N[i], params.v_BN_N[i], params.omega_BO_B[i]
    for i in range(SIZE):
        for j in range(SIZE):
            state.P[i, j] = params.P[i, j]


@compiled
def predict(to_ns: int, body: Body, params: Row, state: Row) -> int:
    """Move the estimate on to a time; unchanged if that fails."""
    dt = 1e-9 * (to_ns - state.time_ns)
    if not dt > 0.0:
        return OK
    x, P, Phi, Q = state.x.copy(), state.P.copy(), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    code = moved(x, dt, body, Phi)
    if code == OK:
        noise(x, dt, body, params.accel_density, params.torque_density, Q)
        code = covariance_time(Phi, Q, P)
    if code == OK:
        take(x, P, state)
        state.time_ns = to_ns
    return code


@compiled
def take(x: F64, P: F64, state: Row) -> None:
    """Take over an estimate (13,), (12, 12)."""
    for i in range(STATES):
        state.x[i] = x[i]
    for i in range(SIZE):
        for j in range(SIZE):
            state.P[i, j] = P[i, j]


@compiled
def nearly_linear(x: F64, dx: F64) -> bool:
    """Whether a correction (12,) of a state (13,) is too small for another linearisation to matter."""
    far = abs(x[0]) + abs(x[1]) + abs(x[2])
    moved_by = abs(dx[0]) + abs(dx[1]) + abs(dx[2])
    return moved_by < 1e-5 * far and abs(dx[THETA]) + abs(dx[THETA + 1]) + abs(dx[THETA + 2]) < 1e-4


@compiled
def use_together(
    chosen: I64, when: int, body: Body, params: Row, state: Row, feeds: Feeds, what: I64, nis: F64, rows: I64
) -> int:
    """Update by sensors that measured at the same instant; the estimate stays as it is if that fails.

    Args:
        chosen: (7,) 1 for each sensor; in the sequential form one only. Those that say nothing become 0.
        when: time of the measurements [ns], not after that of the estimate.
        body: what moves.
        params: of the module.
        state: of the module.
        feeds: inputs.
        what: out (7,), status of the chosen ones.
        nis: out (7,).
        rows: out (7,), degrees of freedom of nis.

    Returns:
        How many landmarks were used.
    """
    H, residual, m = np.empty((SENSORS, SIZE, SIZE)), np.empty((SENSORS, SIZE)), np.zeros(SENSORS, np.int64)
    keep, P, dx = np.zeros(MAX_LANDMARKS, np.int64), state.P, np.zeros(SIZE)
    x, trial, code = state.x.copy(), state.P.copy(), OK
    count = params.iterations if params.form != FEDERATED else 1
    for turn in range(count):
        for s in range(SENSORS):
            m[s] = 0
            if chosen[s] == 0:
                continue
            what[s], m[s] = linearised(
                s, when, state.time_ns, x, P, body, params, feeds, turn == 0, keep, H[s], residual[s]
            )
            if what[s] != status.UPDATED:
                chosen[s] = 0
                continue
            if turn == 0:
                rows[s] = m[s]
            for i in range(m[s]):
                for j in range(SIZE):
                    residual[s, i] += H[s, i, j] * dx[j]
        for i in range(SIZE):
            for j in range(SIZE):
                trial[i, j] = P[i, j]
        factor = params.gate if turn == 0 else 0.0
        if params.form == SEQUENTIAL:
            for s in range(SENSORS):
                if chosen[s] != 0:
                    code, value = white_update(trial, H[s], residual[s], m[s], gate_of(m[s], factor), dx)
                    what[s] = outcome(code)
                    if turn == 0:
                        nis[s] = value
        else:
            values = np.full(SENSORS, math.nan)
            if params.form == BATCH:
                code = batch(trial, H, residual, m, factor, what, values, dx)
            else:
                code = federated(trial, H, residual, m, factor, params.shares, what, values, dx)
            for s in range(SENSORS):
                if chosen[s] != 0:
                    if turn == 0:
                        nis[s] = values[s]
                    if code != OK:
                        what[s] = status.FAILED_UPDATE
                    if what[s] != status.UPDATED:
                        chosen[s] = 0
        if code != OK:
            return 0
        if not corrected(state.x, dx, x):
            code = NOT_FINITE
        if code != OK or nearly_linear(state.x, dx):
            break
    if code != OK:
        for s in range(SENSORS):
            if chosen[s] != 0:
                what[s] = status.FAILED_UPDATE
        return 0
    carry_over(vec3(dx[THETA:OMEGA]), trial)
    take(x, trial, state)
    used = 0
    if chosen[status.LANDMARKS] != 0:
        for k in range(feeds[0].count):
            used += keep[k]
    return used


@compiled
def new_measurements(t_ns: int, params: Row, state: Row, feeds: Feeds, what: I64, times: I64) -> None:
    """Times (7,) of what is new and of the right age, else -1, with the reason in ``what`` (7,)."""
    for s in range(SENSORS):
        what[s], times[s] = status.NO_MEASUREMENT, -1
        count = sequence_of(s, feeds)
        if count == 0 or count == state.seen[s]:
            continue
        state.seen[s] = count
        when = measured_at(s, params, feeds)
        if when > t_ns:
            what[s] = status.FROM_FUTURE
        elif when <= state.last_ns[s] or when < params.start_ns or 1e-9 * (t_ns - when) > params.max_late:
            what[s] = status.TOO_LATE
        else:
            times[s] = when


@compiled
def first_of(times: I64, order: I64) -> int:
    """The sensor of the earliest time (7,), at the same time that of the first place in the order; -1: none."""
    best = -1
    for k in range(SENSORS):
        s = order[k]
        if times[s] >= 0 and (best < 0 or times[s] < times[best]):
            best = s
    return best


@compiled
def step(t_ns: int, params: Row, state: Row, feeds: Feeds, torque: Row, out: Row) -> int:
    """Use what is new, predict to ``t_ns``, and write the filter's message; `OK` or why there is no prediction."""
    body = body_of(t_ns, params, torque, feeds[9])
    what, times, chosen = np.empty(SENSORS, np.int64), np.empty(SENSORS, np.int64), np.zeros(SENSORS, np.int64)
    new_measurements(t_ns, params, state, feeds, what, times)
    for s in range(SENSORS):
        out.nis[s], out.rows[s] = math.nan, 0
    out.landmarks, code = 0, OK
    while True:
        next_one = first_of(times, params.order)
        if next_one < 0:
            break
        when = times[next_one]
        if code == OK:
            code = predict(when, body, params, state)
        for s in range(SENSORS):
            chosen[s] = 1 if s == next_one or (params.form != SEQUENTIAL and times[s] == when) else 0
            if chosen[s] == 1:
                times[s] = -1
                if code != OK:
                    what[s] = status.FAILED_PREDICTION
        if code == OK:
            out.landmarks += use_together(chosen, when, body, params, state, feeds, what, out.nis, out.rows)
            for s in range(SENSORS):
                if chosen[s] == 1 and what[s] == status.UPDATED:
                    state.last_ns[s] = when
    if code == OK:
        code = predict(t_ns, body, params, state)
    for s in range(SENSORS):
        if what[s] == status.UPDATED:
            state.used[s] += 1
        elif what[s] != status.NO_MEASUREMENT:
            state.refused[s] += 1
        out.sensor_status[s], out.used[s], out.refused[s] = what[s], state.used[s], state.refused[s]
    out.estimate_ns = state.time_ns
    out.status = status.UPDATED if code == OK else status.FAILED_PREDICTION
    for i in range(STATES):
        out.x[i] = state.x[i]
    for i in range(SIZE):
        for j in range(SIZE):
            out.P[i, j] = state.P[i, j]
    return code
