"""Burn: a thruster that fires once, and what accelerometers feel of it and of the air."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, minutes, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.vectors import axpy, mat_t_vec, matvec, norm, scale, store3, sub, vec3
from messages.control import CmdForceBodyMsg
from messages.environment import AtmosphereMsg
from messages.sensors import SpecificForceMsg
from messages.states import SCStatesMsg


class Burn(KernelModule):
    """Runs after the spacecraft; the force that it publishes acts until its next step."""

    class Params(Record):
        """Parameters."""

        force_B: Annotated[Vec3, "N", "force of the thruster, B components"] = np.array([0.02, 0.0, 0.0])
        start_ns: Annotated[int, "ns", "begin of the firing"] = minutes(30)
        stop_ns: Annotated[int, "ns", "end of the firing"] = minutes(35)
        mass: Annotated[float, "kg", "mass of the spacecraft", Bound(gt=0)] = 12.0
        drag_area: Annotated[float, "m^2", "drag coefficient times area", Bound(ge=0)] = 0.1

    class State(Record):
        """The force since the last step, and the velocity gained."""

        push_B: Annotated[Vec3, "N", "force of the thruster since the last step"] = zeros(3)
        dv_BN_N: Annotated[Vec3, "m/s", "velocity gained, N components"] = zeros(3)
        time_ns: Annotated[int, "ns", "time of the last step"] = 0

    in_state = In(SCStatesMsg)
    in_atmosphere = In(AtmosphereMsg, optional=True)
    out_push = Out(CmdForceBodyMsg)
    out_force = Out(SpecificForceMsg)

    @staticmethod
    def kernel(
        t_ns: int, params: Row, state: Row, in_state: Row, in_atmosphere: Row, out_push: Row, out_force: Row
    ) -> None:
        """Add up what acted since the last step; set what acts from now on."""
        if in_state.seq == 0:
            return
        dcm_BN = mrp_to_dcm(vec3(in_state.sigma_BN))
        accel_N = mat_t_vec(dcm_BN, scale(1.0 / params.mass, vec3(state.push_B)))
        if in_atmosphere.seq > 0:
            wind_N = sub(vec3(in_state.v_BN_N), vec3(in_atmosphere.v_AN_N))
            drag = -0.5 * in_atmosphere.density * params.drag_area / params.mass * norm(wind_N)
            accel_N = axpy(drag, wind_N, accel_N)
        store3(state.dv_BN_N, axpy((t_ns - state.time_ns) / 1e9, accel_N, vec3(state.dv_BN_N)))
        state.time_ns = t_ns
        firing = params.start_ns <= t_ns < params.stop_ns
        store3(state.push_B, scale(1.0 if firing else 0.0, vec3(params.force_B)))

        store3(out_force.accel_BN_B, matvec(dcm_BN, accel_N))
        store3(out_force.dv_BN_N, vec3(state.dv_BN_N))
        publish(out_force, t_ns)
        store3(out_push.force_B, vec3(state.push_B))
        publish(out_push, t_ns)
