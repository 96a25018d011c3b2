"""RelativeOdUkf: position and velocity relative to a body, from positions that images give."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, transpose_in_place
from fsw.math.two_body import gravity_parameter, two_body_motion
from fsw.math.unscented import Weights, measurement_update, residual, unscented_weights
from messages.base import F64, Mat6, Shape
from messages.filters import OpNavFilterMsg
from messages.opnav import OpNavMsg
from messages.states import NavTransMsg
from modules.estimation.relative_od_ukf import status
from modules.estimation.relative_od_ukf.basilisk import (
    basilisk_measurement_update,
    basilisk_orbit_update,
    factor_of,
    gravity_km,
    post_fit,
)
from modules.estimation.relative_od_ukf.kernel import (
    begin,
    blank_measurement,
    estimate_before,
    keep,
    outcome,
    predict,
    require_covariance,
    require_gravity,
    write_estimate,
    write_innovation,
)


@compiled
def measure_position(point: F64, seen: F64, _: float) -> int:
    """The position is what is measured."""
    for i in range(3):
        seen[i] = point[i]
    return OK


@compiled
def use_position(t_ns: int, mu: float, weights: Weights, params: Row, state: Row, measured: Row, out: Row) -> int:
    """Update the estimate by a new position, and predict it to ``t_ns``; returns the status."""
    if not measured.valid:
        return status.INVALID
    if measured.body_id != params.body_id:
        return status.OTHER_BODY
    R, noise, factor = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    total = 0.0
    for i in range(3):
        total += measured.r_CP_N[i]
        for j in range(3):
            R[i, j] = params.noise_scale * params.noise_scale * measured.P_rr_N[i, j]
            total += R[i, j]
    if not math.isfinite(total) or cholesky(R, noise) != OK:
        return status.BAD_NUMBERS
    transpose_in_place(noise)
    x, S, innovation = np.empty(6), np.empty((6, 6)), np.empty(3)
    what, since_ns = estimate_before(state, measured.exposure_ns, t_ns, x, S)
    if what != status.UPDATED:
        return what
    if (
        predict(
            two_body_motion, mu, params.process_noise, weights, params.max_step, since_ns, measured.exposure_ns, x, S
        )
        != OK
    ):
        return status.FAILED_PREDICTION
    gate = params.gate if params.gate > 0.0 else math.inf
    code, nis = measurement_update(
        measure_position, 0.0, weights, noise, measured.r_CP_N, gate, x, S, innovation, factor
    )
    if not math.isnan(nis):
        write_innovation(out, innovation, factor, nis)
    if code == OK:
        residual(measure_position, 0.0, measured.r_CP_N, x, out.residual)
        keep(state, measured.exposure_ns, x, S)
    return outcome(code)


@compiled
def as_basilisk(t_ns: int, params: Row, state: Row, measured: Row, out: Row) -> None:
    """One call of Basilisk's relativeODuKF; ``state.x`` and ``state.S`` are in km and km/s."""
    n, weights, noise = 6, unscented_weights(6, params.alpha, params.beta, params.kappa), np.empty((6, 6))
    if not state.started:
        P = np.empty((n, n))
        for i in range(n):
            state.x[i] = 1e-3 * (params.r_CP_N[i] if i < 3 else params.v_CP_N[i - 3])
            for j in range(n):
                P[i, j] = 1e-6 * params.P[i, j]
        cholesky(P, state.S)
        state.time, state.planet, state.started = params.start_ns * 1e-9, params.body_id, True
    factor_of(params.process_noise, noise)
    transpose_in_place(noise)
    points, middle, seen, observed = np.empty((2 * n + 1, n)), np.empty(n), np.empty((2 * n + 1, 3)), np.empty(3)
    t, t_measured, what = t_ns * 1e-9, measured.t_ns * 1e-9, status.NO_MEASUREMENT
    for i in range(3):
        out.residual[i] = 0.0
    if measured.seq != 0 and measured.valid and t_measured >= state.time:
        state.planet = measured.body_id
        code = basilisk_orbit_update(t_measured, gravity_km(state.planet), weights, noise, state, points, middle)
        what = status.UPDATED if code == OK else status.FAILED_PREDICTION
        R = np.empty((3, 3))
        for i in range(3):
            observed[i] = 1e-3 * measured.r_CP_N[i]
            for j in range(3):
                R[i, j] = 1e-6 * measured.P_rr_N[i, j]
        for p in range(2 * n + 1):
            measure_position(points[p], seen[p], 0.0)
        code = basilisk_measurement_update(weights, params.noise_scale, R, observed, seen, points, middle, state)
        what = what if code == OK else status.FAILED_UPDATE
    if t >= state.time:
        basilisk_orbit_update(t, gravity_km(state.planet), weights, noise, state, points, middle)
    if what != status.NO_MEASUREMENT:
        for p in range(2 * n + 1):
            measure_position(points[p], seen[p], 0.0)
        post_fit(weights, observed, seen, out.residual)
    write_estimate(out, state, what)
    out.estimate_ns = round(state.time * 1e9)
    for i in range(n):
        out.x[i] *= 1e3
        if i < 3:
            out.residual[i] *= 1e3
        for j in range(n):
            out.P[i, j] *= 1e6


class RelativeOdUkf(KernelModule):
    """Square-root unscented filter of a two-body orbit. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        basilisk: Annotated[bool, "-", "reproduce Basilisk's relativeODuKF, errors included"] = False
        body_id: Annotated[int, "-", "NAIF identifier of the body P"]
        mu: Annotated[float, "m^3/s^2", "gravitational parameter of the body; 0: as tabled", Bound(ge=0)] = 0.0
        start_ns: Annotated[int, "ns", "time of the initial state", Bound(ge=0)] = 0
        r_CP_N: Annotated[Vec3, "m", "initial position of the camera relative to the body, N"]
        v_CP_N: Annotated[Vec3, "m/s", "initial velocity relative to the body, N"]
        P: Annotated[Mat6, "m^2, m^2/s, m^2/s^2", "covariance of the initial state"]
        process_noise: Annotated[Mat6, "m^2/s, m^2/s^2, m^2/s^3", "density of white process noise, for each second"]
        alpha: Annotated[float, "-", "spread of the sigma points", Bound(gt=0, le=1)] = 1.0
        beta: Annotated[float, "-", "2 for a normal distribution", Bound(ge=0)] = 2.0
        kappa: Annotated[float, "-", "second spread; points lie alpha sqrt(6 + kappa) sigma out", Bound(gt=-6)] = 0.0
        noise_scale: Annotated[float, "-", "factor of the standard deviation of measurements", Bound(gt=0)] = 1.0
        gate: Annotated[float, "-", "largest normalised innovation squared; 0: none", Bound(ge=0)] = 21.1
        max_step: Annotated[float, "s", "longest step of the prediction", Bound(gt=0)] = 60.0

        def __post_init__(self) -> None:
            """Check covariances and the body."""
            super().__post_init__()
            require_covariance(self, "P", definite=True)
            require_covariance(self, "process_noise", definite=False)
            require_gravity(self)

    class State(Record):
        """The estimate now and after the last measurement used; with ``basilisk`` in km and km/s."""

        started: Annotated[bool, "-", "the initial state was taken over"] = False
        seen: Annotated[int, "-", "seq of the last measurement looked at"] = 0
        used: Annotated[int, "-", "measurements used"] = 0
        refused: Annotated[int, "-", "measurements refused"] = 0
        time_ns: Annotated[int, "ns", "time of the estimate"] = 0
        x: Annotated[F64, Shape(6), "m, m/s", "position and velocity"] = zeros(6)
        S: Annotated[Mat6, "m, m/s", "lower factor of the covariance"] = zeros(6, 6)
        anchor_ns: Annotated[int, "ns", "time of the last measurement used"] = 0
        anchor_x: Annotated[F64, Shape(6), "m, m/s", "position and velocity then"] = zeros(6)
        anchor_S: Annotated[Mat6, "m, m/s", "lower factor of the covariance then"] = zeros(6, 6)
        time: Annotated[float, "s", "time of the estimate of Basilisk's filter"] = 0.0
        planet: Annotated[int, "-", "body of Basilisk's filter"] = 0

    in_position = In(OpNavMsg)
    out_nav = Out(NavTransMsg)
    out_filter = Out(OpNavFilterMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_position: Row, out_nav: Row, out_filter: Row) -> None:
        """Use a new measurement, once, and give the estimate at ``t_ns``."""
        if t_ns < params.start_ns:
            return
        blank_measurement(out_filter)
        what = status.NO_MEASUREMENT
        if params.basilisk:
            as_basilisk(t_ns, params, state, in_position, out_filter)
        else:
            if not state.started:
                for i in range(3):
                    state.x[i], state.x[3 + i] = params.r_CP_N[i], params.v_CP_N[i]
                begin(state, params.P, params.start_ns)
            mu = gravity_parameter(params.body_id, params.mu)
            weights = unscented_weights(6, params.alpha, params.beta, params.kappa)
            if in_position.seq not in (0, state.seen):
                state.seen = in_position.seq
                what = use_position(t_ns, mu, weights, params, state, in_position, out_filter)
            code = predict(
                two_body_motion,
                mu,
                params.process_noise,
                weights,
                params.max_step,
                state.time_ns,
                t_ns,
                state.x,
                state.S,
            )
            if code == OK:
                state.time_ns = max(state.time_ns, t_ns)
            else:
                what = status.FAILED_PREDICTION
            write_estimate(out_filter, state, what)
        publish(out_filter, t_ns)
        if what == status.FAILED_PREDICTION:
            return
        for i in range(3):
            out_nav.r_BN_N[i], out_nav.v_BN_N[i] = out_filter.x[i], out_filter.x[3 + i]
        publish(out_nav, t_ns)
