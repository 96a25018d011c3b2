"""PixelLineBiasUkf: position and velocity relative to a body, and pixel bias, from circles through its limb."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.camera import LENS_SIZE
from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, transpose_in_place
from fsw.math.two_body import gravity_parameter
from fsw.math.unscented import Weights, measurement_update, residual, unscented_weights
from fsw.math.vectors import mat3, matmul, norm, transpose, vec3
from messages.base import F64, Shape
from messages.environment import PlanetOrientationMsg
from messages.filters import PixelLineFilterMsg
from messages.opnav import CameraConfigMsg, OpNavCirclesMsg
from messages.states import NavAttMsg, NavTransMsg
from modules.estimation.pixel_line_bias_ukf.basilisk import as_basilisk
from modules.estimation.pixel_line_bias_ukf.kernel import add_attitude_noise, measure_circle, orbit_and_bias
from modules.estimation.pixel_line_bias_ukf.limb import POINTS, WORK
from modules.estimation.relative_od_ukf import status
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
from modules.opnav import relative


@compiled
def use_circle(
    t_ns: int,
    mu: float,
    weights: Weights,
    params: Row,
    state: Row,
    circles: Row,
    camera: Row,
    attitude: Row,
    orientation: Row,
    out: Row,
) -> int:
    """Update the estimate by a new circle; returns the status."""
    when = circles.exposure_ns
    if not circles.valid or circles.count < 1:
        return status.INVALID
    if circles.body_id != params.body_id:
        return status.OTHER_BODY
    if camera.seq == 0 or attitude.seq == 0:
        return status.NO_INPUT
    if relative.too_old(attitude, when, params.max_age):
        return status.OLD_ATTITUDE
    lens, circle, R, noise = np.empty(LENS_SIZE), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    relative.lens_of(camera, lens)
    total = 0.0
    for i in range(3):
        circle[i] = circles.radius_px[0] if i == 2 else circles.center_px[0, i]
        total += circle[i]
        for j in range(3):
            R[i, j] = params.noise_scale * params.noise_scale * circles.P_px[0, i, j]
    if params.sigma_att > 0.0:
        add_attitude_noise(lens, circle[0], circle[1], params.sigma_att, R)
    if not math.isfinite(total) or not circle[2] > 0.0 or cholesky(R, noise) != OK:
        return status.BAD_NUMBERS
    transpose_in_place(noise)
    dcm_CN = matmul(mat3(camera.dcm_CB), relative.attitude_at(attitude, when))
    axes = relative.semi_axes(params.body_id, vec3(params.axes))
    if axes[0] == axes[1] and axes[1] == axes[2]:
        dcm_EC = transpose(dcm_CN)
    elif orientation.seq != 0:
        dcm_EC = matmul(relative.orientation_at(orientation, when), transpose(dcm_CN))
    elif axes[0] == axes[1] and norm(vec3(params.pole_N)) > 0.0:
        dcm_EC = matmul(relative.pole_frame(vec3(params.pole_N)), transpose(dcm_CN))
    else:
        return status.NO_ORIENTATION
    x, S, innovation, factor = np.empty(9), np.empty((9, 9)), np.empty(3), np.empty((3, 3))
    what, since_ns = estimate_before(state, when, t_ns, x, S)
    if what != status.UPDATED:
        return what
    if (
        predict(
            orbit_and_bias, (mu, np.zeros(13)), params.process_noise, weights, params.max_step, since_ns, when, x, S
        )
        != OK
    ):
        return status.FAILED_PREDICTION
    gate = params.gate if params.gate > 0.0 else math.inf
    scene = (lens, axes, dcm_CN, dcm_EC, np.empty((WORK, POINTS)), np.zeros(9))
    code, nis = measurement_update(measure_circle, scene, weights, noise, circle, gate, x, S, innovation, factor)
    if not math.isnan(nis):
        write_innovation(out, innovation, factor, nis)
    if code == OK:
        residual(measure_circle, scene, circle, x, out.residual)
        keep(state, when, x, S)
    return outcome(code)


class PixelLineBiasUkf(KernelModule):
    """Square-root unscented filter of a two-body orbit and a pixel bias. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        basilisk: Annotated[bool, "-", "reproduce Basilisk's pixelLineBiasUKF, errors included"] = False
        body_id: Annotated[int, "-", "NAIF identifier of the body P"]
        mu: Annotated[float, "m^3/s^2", "gravitational parameter of the body; 0: as tabled", Bound(ge=0)] = 0.0
        axes: Annotated[Vec3, "m", "semi-axes of the body along its x, y, z; zeros: as tabled", Bound(ge=0)] = zeros(3)
        pole_N: Annotated[Vec3, "-", "pole of a spheroid, N; used without in_orientation"] = zeros(3)
        start_ns: Annotated[int, "ns", "time of the initial state", Bound(ge=0)] = 0
        r_CP_N: Annotated[Vec3, "m", "initial position of the camera relative to the body, N"]
        v_CP_N: Annotated[Vec3, "m/s", "initial velocity relative to the body, N"]
        bias_px: Annotated[Vec3, "px", "initial bias: what is to be added to column, row and radius"] = zeros(3)
        P: Annotated[F64, Shape(9, 9), "products of m, m/s, px", "covariance of the initial state"]
        process_noise: Annotated[
            F64, Shape(9, 9), "products of m, m/s, px, per s", "density of white process noise, for each second"
        ]
        alpha: Annotated[float, "-", "spread of the sigma points", Bound(gt=0, le=1)] = 1.0
        beta: Annotated[float, "-", "2 for a normal distribution", Bound(ge=0)] = 2.0
        kappa: Annotated[float, "-", "second spread; points lie alpha sqrt(9 + kappa) sigma out", Bound(gt=-9)] = 0.0
        noise_scale: Annotated[float, "-", "factor of the standard deviation of circles", Bound(gt=0)] = 1.0
        sigma_att: Annotated[float, "rad", "attitude error about each axis, added to the circle's", Bound(ge=0)] = 0.0
        gate: Annotated[float, "-", "largest normalised innovation squared; 0: none", Bound(ge=0)] = 21.1
        max_age: Annotated[float, "s", "largest time between attitude and exposure", Bound(ge=0)] = 10.0
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
        seen: Annotated[int, "-", "seq of the last circles looked at"] = 0
        used: Annotated[int, "-", "measurements used"] = 0
        refused: Annotated[int, "-", "measurements refused"] = 0
        time_ns: Annotated[int, "ns", "time of the estimate"] = 0
        x: Annotated[F64, Shape(9), "m, m/s, px", "position, velocity, bias"] = zeros(9)
        S: Annotated[F64, Shape(9, 9), "m, m/s, px", "lower factor of the covariance"] = zeros(9, 9)
        anchor_ns: Annotated[int, "ns", "time of the last measurement used"] = 0
        anchor_x: Annotated[F64, Shape(9), "m, m/s, px", "position, velocity, bias then"] = zeros(9)
        anchor_S: Annotated[F64, Shape(9, 9), "m, m/s, px", "lower factor of the covariance then"] = zeros(9, 9)
        time: Annotated[float, "s", "time of the estimate of Basilisk's filter"] = 0.0
        planet: Annotated[int, "-", "body of Basilisk's filter"] = 0

    in_circles = In(OpNavCirclesMsg)
    in_camera = In(CameraConfigMsg)
    in_attitude = In(NavAttMsg)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    out_nav = Out(NavTransMsg)
    out_filter = Out(PixelLineFilterMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_circles: Row,
        in_camera: Row,
        in_attitude: Row,
        in_orientation: Row,
        out_nav: Row,
        out_filter: Row,
    ) -> None:
        """Use a new circle, once, and give the estimate at ``t_ns``."""
        if t_ns < params.start_ns:
            return
        blank_measurement(out_filter)
        what, length = status.NO_MEASUREMENT, 1.0
        if params.basilisk:
            what, length = as_basilisk(t_ns, params, state, in_circles, in_camera, in_attitude, out_filter), 1e3
            state.time_ns = round(state.time * 1e9)
        else:
            if not state.started:
                for i in range(3):
                    state.x[i], state.x[3 + i], state.x[6 + i] = params.r_CP_N[i], params.v_CP_N[i], params.bias_px[i]
                begin(state, params.P, params.start_ns)
            mu = gravity_parameter(params.body_id, params.mu)
            weights = unscented_weights(9, params.alpha, params.beta, params.kappa)
            if in_circles.seq not in (0, state.seen):
                state.seen = in_circles.seq
                what = use_circle(
                    t_ns,
                    mu,
                    weights,
                    params,
                    state,
                    in_circles,
                    in_camera,
                    in_attitude,
                    in_orientation,
                    out_filter,
                )
            flight = (mu, np.zeros(13))
            code = predict(
                orbit_and_bias,
                flight,
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
        if params.basilisk:
            for i in range(9):
                out_filter.x[i] *= length if i < 6 else 1.0
                for j in range(9):  # 60 numbers, where 54 would be whole rows
                    out_filter.P[i, j] *= 1e6 if 9 * i + j < 60 else 1.0
        publish(out_filter, t_ns)
        if what == status.FAILED_PREDICTION:
            return
        for i in range(3):
            out_nav.r_BN_N[i], out_nav.v_BN_N[i] = out_filter.x[i], out_filter.x[3 + i]
        publish(out_nav, t_ns)
