"""HeadingUkf: direction to a body and the body rates across it, from positions relative to the body."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, transpose_in_place
from fsw.math.unscented import Weights, measurement_update, residual, unscented_weights
from fsw.math.vectors import mat3, mat_t_vec, matvec, norm, scale, store3, unit, vec3
from messages.base import F64, Shape, Vec2
from messages.filters import HeadingFilterMsg
from messages.opnav import CameraConfigMsg, OpNavDirectionMsg, OpNavMsg
from modules.estimation.heading_ukf.basilisk import as_basilisk
from modules.estimation.heading_ukf.kernel import direction_noise, measure_direction, predict_heading
from modules.estimation.relative_od_ukf import status
from modules.estimation.relative_od_ukf.kernel import (
    begin,
    blank_measurement,
    copy_into,
    estimate_before,
    keep,
    outcome,
    require_covariance,
    write_estimate,
    write_innovation,
)


@compiled
def use_direction(t_ns: int, weights: Weights, params: Row, state: Row, measured: Row, out: Row) -> int:
    """Update the estimate by a new position; returns the status."""
    if not measured.valid:
        return status.INVALID
    far, R, noise = norm(vec3(measured.r_CP_B)), np.empty((3, 3)), np.empty((3, 3))
    if not (math.isfinite(far) and far > 0.0):
        return status.BAD_NUMBERS
    if cholesky(measured.P_rr_B, noise) != OK:
        return status.BAD_NUMBERS
    u = scale(-1.0, unit(vec3(measured.r_CP_B)))
    direction_noise(u, measured.P_rr_B, far / params.noise_scale, R)
    if cholesky(R, noise) != OK:
        return status.BAD_NUMBERS
    transpose_in_place(noise)
    x, S, innovation, observed = np.empty(5), np.empty((5, 5)), np.empty(3), np.empty(3)
    factor = np.empty((3, 3))
    store3(observed, u)
    when = measured.exposure_ns
    what, since_ns = estimate_before(state, when, t_ns, x, S)
    if what != status.UPDATED:
        return what
    helper = state.helper if when >= state.time_ns else state.anchor_helper
    code, helper = predict_heading(params.process_noise, weights, params.max_step, since_ns, when, helper, x, S)
    if code != OK:
        return status.FAILED_PREDICTION
    gate = params.gate if params.gate > 0.0 else math.inf
    code, nis = measurement_update(measure_direction, 0.0, weights, noise, observed, gate, x, S, innovation, factor)
    if not math.isnan(nis):
        write_innovation(out, innovation, factor, nis)
    if code == OK:
        residual(measure_direction, 0.0, observed, x, out.residual)
        keep(state, when, x, S)
        state.helper = state.anchor_helper = helper
    return outcome(code)


@compiled
def write_direction(out: Row, state: Row, camera: Row, body_id: int, basilisk: bool) -> None:
    """Unit vector in B and its covariance, and in C if there is a camera."""
    d = (state.x[0], state.x[1], state.x[2])
    u, size = unit(d), norm(d)
    out.exposure_ns, out.valid, out.status, out.body_id = state.time_ns, True, 0, body_id
    store3(out.u_PC_B, u)
    half = np.zeros((3, 5))
    for i in range(3):
        out.u_PC_N[i] = out.u_PC_C[i] = math.nan
        for j in range(5):
            for k in range(3):
                half[i, j] += ((1.0 if i == k else 0.0) - u[i] * u[k]) * state.S[k, j] / size
    for i in range(3):
        for j in range(3):
            out.P_uu_N[i, j] = out.P_uu_C[i, j] = math.nan
            out.P_uu_B[i, j] = 0.0
            for k in range(5):
                out.P_uu_B[i, j] += half[i, k] * half[j, k]
    if camera.seq != 0:
        dcm_CB = mat3(camera.dcm_CB)
        store3(out.u_PC_C, mat_t_vec(dcm_CB, u) if basilisk else matvec(dcm_CB, u))
        for i in range(3):
            for j in range(3):
                out.P_uu_C[i, j] = 0.0
                for k in range(3):
                    for m in range(3):
                        out.P_uu_C[i, j] += dcm_CB[i][k] * out.P_uu_B[k, m] * dcm_CB[j][m]


class HeadingUkf(KernelModule):
    """Square-root unscented filter of a direction and two rates. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        basilisk: Annotated[bool, "-", "reproduce Basilisk's headingSuKF, errors included"] = False
        body_id: Annotated[int, "-", "NAIF identifier of the body, for the output"]
        start_ns: Annotated[int, "ns", "time of the initial state", Bound(ge=0)] = 0
        u_PC_B: Annotated[Vec3, "-", "initial direction from the camera to the body, B"]
        rate_S: Annotated[Vec2, "rad/s", "initial rate of B relative to N about the second and third axis of S"]
        P: Annotated[F64, Shape(5, 5), "products of -, rad/s", "covariance of the initial state"]
        process_noise: Annotated[
            F64, Shape(5, 5), "products of -, rad/s, per s", "density of white process noise, for each second"
        ]
        alpha: Annotated[float, "-", "spread of the sigma points", Bound(gt=0, le=1)] = 1.0
        beta: Annotated[float, "-", "2 for a normal distribution", Bound(ge=0)] = 2.0
        kappa: Annotated[float, "-", "second spread; points lie alpha sqrt(5 + kappa) sigma out", Bound(gt=-5)] = 0.0
        noise_scale: Annotated[float, "-", "factor of the standard deviation of measurements", Bound(gt=0)] = 1.0
        gate: Annotated[float, "-", "largest normalised innovation squared; 0: none", Bound(ge=0)] = 21.1
        max_step: Annotated[float, "s", "longest step of the prediction", Bound(gt=0)] = 1.0

        def __post_init__(self) -> None:
            """Check covariances and the direction."""
            super().__post_init__()
            require_covariance(self, "P", definite=True)
            require_covariance(self, "process_noise", definite=False)
            if not np.linalg.norm(self.u_PC_B) > 0.0:
                raise ValueError("HeadingUkf.Params.u_PC_B: expected a direction, got zero; give the one expected")

    class State(Record):
        """The estimate now and after the last measurement used."""

        started: Annotated[bool, "-", "the initial state was taken over"] = False
        seen: Annotated[int, "-", "seq of the last measurement looked at"] = 0
        used: Annotated[int, "-", "measurements used"] = 0
        refused: Annotated[int, "-", "measurements refused"] = 0
        helper: Annotated[int, "-", "axis of B that helps to define S"] = 0
        time_ns: Annotated[int, "ns", "time of the estimate"] = 0
        x: Annotated[F64, Shape(5), "-, rad/s", "direction and rates"] = zeros(5)
        S: Annotated[F64, Shape(5, 5), "-, rad/s", "lower factor of the covariance"] = zeros(5, 5)
        anchor_helper: Annotated[int, "-", "helping axis at the last measurement used"] = 0
        anchor_ns: Annotated[int, "ns", "time of the last measurement used"] = 0
        anchor_x: Annotated[F64, Shape(5), "-, rad/s", "direction and rates then"] = zeros(5)
        anchor_S: Annotated[F64, Shape(5, 5), "-, rad/s", "lower factor of the covariance then"] = zeros(5, 5)
        time: Annotated[float, "s", "time of the estimate of Basilisk's filter"] = 0.0

    in_position = In(OpNavMsg)
    in_camera = In(CameraConfigMsg, optional=True)
    out_direction = Out(OpNavDirectionMsg)
    out_filter = Out(HeadingFilterMsg)

    @staticmethod
    def kernel(
        t_ns: int, params: Row, state: Row, in_position: Row, in_camera: Row, out_direction: Row, out_filter: Row
    ) -> None:
        """Use a new position, once, and give the direction at ``t_ns``."""
        if t_ns < params.start_ns:
            return
        blank_measurement(out_filter)
        what = status.NO_MEASUREMENT
        if params.basilisk:
            what = as_basilisk(t_ns, params, state, in_position, out_filter)
            state.time_ns = round(state.time * 1e9)
        else:
            if not state.started:
                store3(state.x, unit(vec3(params.u_PC_B)))
                state.x[3], state.x[4] = params.rate_S[0], params.rate_S[1]
                begin(state, params.P, params.start_ns)
            weights = unscented_weights(5, params.alpha, params.beta, params.kappa)
            if in_position.seq not in (0, state.seen):
                state.seen = in_position.seq
                what = use_direction(t_ns, weights, params, state, in_position, out_filter)
            x, S = np.empty(5), np.empty((5, 5))
            copy_into(state.x, state.S, x, S)
            code, helper = predict_heading(
                params.process_noise, weights, params.max_step, state.time_ns, t_ns, state.helper, x, S
            )
            if code == OK:
                copy_into(x, S, state.x, state.S)
                state.time_ns, state.helper = max(state.time_ns, t_ns), helper
            else:
                what = status.FAILED_PREDICTION
        write_estimate(out_filter, state, what)
        if params.basilisk:
            out_filter.x[3], out_filter.x[4] = -out_filter.x[3], -out_filter.x[4]
        publish(out_filter, t_ns)
        if what != status.FAILED_PREDICTION:
            write_direction(out_direction, state, in_camera, params.body_id, params.basilisk)
            publish(out_direction, t_ns)
