"""Accelerometer: measured non-gravitational acceleration with velocity random walk and a walking bias."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Row, Vec3, eye, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.checks import require_rotation
from fsw.math.noise import mean_of_walk, walk_spreads
from fsw.math.vectors import add, cross, mat3, mat_t_vec, matvec, scale, store3, sub, vec3
from messages.sensors import AccelSensorMsg, SpecificForceMsg
from messages.states import SCStatesMsg
from sim.sensors.faults import FRESH, NOTHING, FaultParams, FaultState, delivery
from sim.sensors.readout import quantised, saturated


class Accelerometer(KernelModule):
    """Three accelerometers that measure the mean specific force between their samples. See SPEC.md."""

    class Params(FaultParams):
        """Parameters."""

        dcm_PB: Annotated[Mat3, "-", "mounting: maps body to case components"] = eye(3)
        r_PB_B: Annotated[Vec3, "m", "position of the case relative to B, B components"] = zeros(3)
        misalignment: Annotated[Mat3, "-", "scale factor errors (diagonal) and misalignment of the axes"] = zeros(3, 3)
        vrw: Annotated[float, "m/s^1.5", "velocity random walk", Bound(ge=0)] = 1e-05
        brw: Annotated[float, "m/s^2.5", "random walk of the bias", Bound(ge=0)] = 1e-08
        resolution: Annotated[float, "m/s", "velocity of one count; 0 for none", Bound(ge=0)] = 0.0
        max_accel: Annotated[float, "m/s^2", "saturation of each axis; 0 for none", Bound(ge=0)] = 0.0

        def __post_init__(self) -> None:
            """Check the mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_PB")

    class State(FaultState):
        """Bias, the true velocity gained up to the last sample, and the velocity not yet counted."""

        bias_P: Annotated[Vec3, "m/s^2", "bias, P components"] = zeros(3)
        dv_PN_N: Annotated[Vec3, "m/s", "true velocity gained at the last sample, N components"] = zeros(3)
        sample_ns: Annotated[int, "ns", "time of the last sample, -1 before the first"] = -1
        rest_P: Annotated[Vec3, "m/s", "velocity left over by the count of the last sample"] = zeros(3)

    in_state = In(SCStatesMsg)
    in_force = In(SpecificForceMsg)
    out_accel = Out(AccelSensorMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_force: Row, out_accel: Row) -> None:
        """Take a sample of the newest true motion; the first only starts the interval."""
        if in_state.seq == 0 or in_force.seq == 0 or in_force.t_ns <= state.sample_ns:
            return
        dcm_BN = mrp_to_dcm(vec3(in_state.sigma_BN))
        by_turning = mat_t_vec(dcm_BN, cross(vec3(in_state.omega_BN_B), vec3(params.r_PB_B)))
        dv_PN_N = add(vec3(in_force.dv_BN_N), by_turning)
        if not math.isfinite(dv_PN_N[0] + dv_PN_N[1] + dv_PN_N[2]):
            return
        started, last, last_ns = state.sample_ns >= 0, vec3(state.dv_PN_N), state.sample_ns
        store3(state.dv_PN_N, dv_PN_N)
        state.sample_ns = in_force.t_ns
        if not started:
            return
        dt = (in_force.t_ns - last_ns) / 1e9
        accel = matvec(mat3(params.dcm_PB), matvec(dcm_BN, scale(1.0 / dt, sub(dv_PN_N, last))))
        wrong = matvec(mat3(params.misalignment), accel)
        what, gain = delivery(t_ns, params, state, out_accel.seq)
        step, spread = walk_spreads(gain * params.vrw, params.brw, dt)
        for i in range(3):
            state.bias_P[i], error = mean_of_walk(state.noise, state.bias_P[i], step, spread)
            gained = dt * saturated(accel[i] + wrong[i] + error, params.max_accel) + state.rest_P[i]
            counted = quantised(gained, params.resolution)
            state.rest_P[i] = gained - counted
            if what == FRESH:
                out_accel.accel_P[i] = counted / dt
        if what != NOTHING:
            publish(out_accel, t_ns)
