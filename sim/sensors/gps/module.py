"""Gps: Earth-fixed and geodetic position, and velocity, with white and correlated errors."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Row, Vec3, publish, zeros
from fsw.math.attitude import mrp_to_dcm, rotvec_to_dcm
from fsw.math.geodesy import geodetic_from_ecef
from fsw.math.noise import gauss_markov_factors, random_walk
from fsw.math.random import normal
from fsw.math.vectors import add, cross, dot, mat3, mat_t_vec, matmul, matvec, norm, scale, sub, vec3
from messages.environment import PlanetOrientationMsg
from messages.sensors import GPSSensorMsg
from messages.states import SCStatesMsg
from sim.sensors.faults import FRESH, NOTHING, FaultParams, FaultState, delivery
from sim.sensors.readout import quantised


class Gps(KernelModule):
    """A receiver with one antenna A. See SPEC.md."""

    class Params(FaultParams):
        """Parameters."""

        r_AB_B: Annotated[Vec3, "m", "position of the antenna relative to B, B components"] = zeros(3)
        sigma_r: Annotated[float, "m", "white position noise of a fix, each axis", Bound(ge=0)] = 5.0
        sigma_v: Annotated[float, "m/s", "white velocity noise of a fix, each axis", Bound(ge=0)] = 0.05
        sigma_slow: Annotated[float, "m", "standard deviation of the Gauss-Markov position error", Bound(ge=0)] = 3.0
        tau: Annotated[float, "s", "correlation time of the Gauss-Markov error", Bound(gt=0)] = 300.0
        walk: Annotated[float, "m/s^0.5", "random walk of the position; grows without limit", Bound(ge=0)] = 0.0
        bias_E: Annotated[Vec3, "m", "constant position error, E components"] = zeros(3)
        resolution_r: Annotated[float, "m", "step of the position; 0 for none", Bound(ge=0)] = 0.0
        resolution_v: Annotated[float, "m/s", "step of the velocity; 0 for none", Bound(ge=0)] = 0.0
        max_speed: Annotated[float, "m/s", "no fix when faster relative to the Earth; 0 for no limit", Bound(ge=0)] = (
            0.0
        )
        max_height: Annotated[float, "m", "no fix when higher; 0 for no limit", Bound(ge=0)] = 0.0

    class State(FaultState):
        """Slow errors."""

        slow: Annotated[Vec3, "-", "Gauss-Markov error in units of its standard deviation, E components"] = zeros(3)
        walked_E: Annotated[Vec3, "m", "random walk, E components"] = zeros(3)
        sample_ns: Annotated[int, "ns", "time of the last fix, -1 before the first"] = -1

    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_fix = Out(GPSSensorMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_orientation: Row, out_fix: Row) -> None:
        """Make a fix of the newest true state."""
        if in_state.seq == 0 or in_orientation.seq == 0:
            return
        what, gain = delivery(t_ns, params, state, out_fix.seq)
        elapsed = (t_ns - state.sample_ns) / 1e9 if state.sample_ns >= 0 else -1.0
        keep, fresh = gauss_markov_factors(elapsed, params.tau)
        state.sample_ns = t_ns
        white_r, white_v = gain * params.sigma_r, gain * params.sigma_v

        omega_EN_N = vec3(in_orientation.omega_EN_N)
        dcm_BN, dcm_EN = mrp_to_dcm(vec3(in_state.sigma_BN)), mat3(in_orientation.dcm_EN)
        age = (in_state.t_ns - in_orientation.t_ns) / 1e9
        if age != 0.0:  # the ground moves by 465 m in a second
            dcm_EN = matmul(dcm_EN, rotvec_to_dcm(scale(age, omega_EN_N)))
        arm_N = mat_t_vec(dcm_BN, vec3(params.r_AB_B))
        swing_N = mat_t_vec(dcm_BN, cross(vec3(in_state.omega_BN_B), vec3(params.r_AB_B)))
        r_AN_N = add(vec3(in_state.r_BN_N), arm_N)
        carried_N = cross(omega_EN_N, r_AN_N)
        v_AE_N = sub(add(vec3(in_state.v_BN_N), swing_N), carried_N)
        r_AE_E, v_AE_E = matvec(dcm_EN, r_AN_N), matvec(dcm_EN, v_AE_N)
        if not math.isfinite(dot(r_AE_E, v_AE_E)):
            what = NOTHING
        if params.max_speed > 0.0 and norm(v_AE_E) > params.max_speed:
            what = NOTHING
        if params.max_height > 0.0 and geodetic_from_ecef(r_AE_E[0], r_AE_E[1], r_AE_E[2])[2] > params.max_height:
            what = NOTHING
        # errors go on at every step, so that a lost fix does not change the later ones
        for i in range(3):
            state.slow[i] = keep * state.slow[i] + fresh * normal(state.noise)
            state.walked_E[i] = random_walk(state.noise, state.walked_E[i], params.walk, elapsed)
            error = params.bias_E[i] + params.sigma_slow * state.slow[i] + state.walked_E[i]
            r = r_AE_E[i] + error + white_r * normal(state.noise)
            v = v_AE_E[i] + white_v * normal(state.noise)
            if what == FRESH:
                out_fix.r_AE_E[i] = quantised(r, params.resolution_r)
                out_fix.v_AE_E[i] = quantised(v, params.resolution_v)
        if what == NOTHING:
            return
        out_fix.fix_ns = in_state.t_ns
        measured = out_fix.r_AE_E
        out_fix.lat, out_fix.lon, out_fix.h = geodetic_from_ecef(measured[0], measured[1], measured[2])
        publish(out_fix, t_ns)
