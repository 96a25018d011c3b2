"""Gyro: measured angular rate with angle random walk and rate random walk."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Row, Vec3, eye, publish, zeros
from fsw.math.attitude import ep_relative, ep_to_rotvec, mrp_to_ep
from fsw.math.checks import require_rotation
from fsw.math.noise import mean_of_walk, walk_spreads
from fsw.math.vectors import mat3, matvec, scale, store3, vec3
from messages.sensors import IMUSensorMsg
from messages.states import SCStatesMsg
from sim.sensors.faults import FRESH, NOTHING, FaultParams, FaultState, delivery
from sim.sensors.readout import quantised, saturated


class Gyro(KernelModule):
    """A three-axis gyro that measures the mean rate between its samples. See SPEC.md."""

    class Params(FaultParams):
        """Parameters."""

        dcm_PB: Annotated[Mat3, "-", "mounting: maps body to case components"] = eye(3)
        misalignment: Annotated[Mat3, "-", "scale factor errors (diagonal) and misalignment of the axes"] = zeros(3, 3)
        arw: Annotated[float, "rad/s^0.5", "angle random walk", Bound(ge=0)] = 2.9e-05
        rrw: Annotated[float, "rad/s^1.5", "rate random walk", Bound(ge=0)] = 2e-08
        resolution: Annotated[float, "rad", "angle of one count of the integrated rate; 0 for none", Bound(ge=0)] = 0.0
        max_rate: Annotated[float, "rad/s", "saturation of each axis; 0 for none", Bound(ge=0)] = 0.0

        def __post_init__(self) -> None:
            """Check the mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_PB")

    class State(FaultState):
        """Bias, the last true attitude, and the angle not yet counted."""

        bias_P: Annotated[Vec3, "rad/s", "bias, P components"] = zeros(3)
        sigma_BN: Annotated[Vec3, "-", "true attitude at the last sample, MRP"] = zeros(3)
        sample_ns: Annotated[int, "ns", "time of the last sample, -1 before the first"] = -1
        rest_P: Annotated[Vec3, "rad", "angle left over by the count of the last sample"] = zeros(3)

    in_state = In(SCStatesMsg)
    out_imu = Out(IMUSensorMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, out_imu: Row) -> None:
        """Take a sample of the newest true state; the first only starts the interval."""
        if in_state.seq == 0 or in_state.t_ns <= state.sample_ns:
            return
        sigma = vec3(in_state.sigma_BN)
        if not math.isfinite(sigma[0] + sigma[1] + sigma[2]):
            return
        started, last, last_ns = state.sample_ns >= 0, vec3(state.sigma_BN), state.sample_ns
        store3(state.sigma_BN, sigma)
        state.sample_ns = in_state.t_ns
        if not started:
            return
        dt = (in_state.t_ns - last_ns) / 1e9
        turn = ep_to_rotvec(ep_relative(mrp_to_ep(sigma), mrp_to_ep(last)))
        rate = matvec(mat3(params.dcm_PB), scale(1.0 / dt, turn))
        wrong = matvec(mat3(params.misalignment), rate)
        what, gain = delivery(t_ns, params, state, out_imu.seq)
        step, spread = walk_spreads(gain * params.arw, params.rrw, dt)
        for i in range(3):
            state.bias_P[i], error = mean_of_walk(state.noise, state.bias_P[i], step, spread)
            angle = dt * saturated(rate[i] + wrong[i] + error, params.max_rate) + state.rest_P[i]
            counted = quantised(angle, params.resolution)
            state.rest_P[i] = angle - counted
            if what == FRESH:
                out_imu.omega_PN_P[i] = counted / dt
        if what != NOTHING:
            publish(out_imu, t_ns)
