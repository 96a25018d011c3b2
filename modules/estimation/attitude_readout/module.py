"""AttitudeReadout: attitude and rate from a star tracker and a gyro."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Record, Row, Vec3, Vec4, eye, publish, zeros
from fsw.math.attitude import dcm_to_ep, ep_compose, ep_inverse, ep_normalize, ep_to_mrp
from fsw.math.checks import require_rotation
from fsw.math.vectors import mat3, mat_t_vec, store3, store4, vec3, vec4
from messages.sensors import IMUSensorMsg, STAttMsg
from messages.states import NavAttMsg
from modules.estimation.attitude_readout.kernel import is_unit, turned, weighted


class AttitudeReadout(KernelModule):
    """Carries the star tracker's attitude forward with the gyro's rate. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        dcm_SB: Annotated[Mat3, "-", "mounting of the star tracker: maps body to case components"] = eye(3)
        dcm_PB: Annotated[Mat3, "-", "mounting of the gyro: maps body to case components"] = eye(3)
        gain: Annotated[float, "-", "share of the star tracker's correction that is taken", Bound(gt=0, le=1)] = 1.0
        max_age: Annotated[float, "s", "age beyond which measurements are not used", Bound(gt=0)] = 1.0

        def __post_init__(self) -> None:
            """Check the mountings too."""
            super().__post_init__()
            require_rotation(self, "dcm_SB")
            require_rotation(self, "dcm_PB")

    class State(Record):
        """Attitude and rate at the last gyro sample."""

        beta_BN: Annotated[Vec4, "-", "attitude at the last gyro sample, Euler parameters"] = zeros(4)
        omega_BN_B: Annotated[Vec3, "rad/s", "rate of the last gyro sample"] = zeros(3)
        gyro_ns: Annotated[int, "ns", "time of the last gyro sample, -1 before the first"] = -1
        exposure_ns: Annotated[int, "ns", "time of the last exposure used, -1 before the first"] = -1
        known: Annotated[bool, "-", "the attitude has been measured and not been lost since"] = False

    in_imu = In(IMUSensorMsg)
    in_star = In(STAttMsg)
    out_att = Out(NavAttMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_imu: Row, in_star: Row, out_att: Row) -> None:
        """Take in new measurements; publish if attitude and rate are both known now."""
        longest = int(params.max_age * 1e9)
        if in_imu.seq > 0 and in_imu.t_ns > state.gyro_ns:
            omega = mat_t_vec(mat3(params.dcm_PB), vec3(in_imu.omega_PN_P))
            if not math.isfinite(omega[0] + omega[1] + omega[2]):
                state.known = False  # the motion since the last sample is lost
                return
            interval_ns = in_imu.t_ns - state.gyro_ns
            state.known = state.known and interval_ns <= longest
            if state.known:
                store4(state.beta_BN, turned(vec4(state.beta_BN), omega, interval_ns / 1e9))
            store3(state.omega_BN_B, omega)
            state.gyro_ns = in_imu.t_ns
        if state.gyro_ns < 0 or t_ns - state.gyro_ns > longest:
            return
        rate = vec3(state.omega_BN_B)
        fresh = in_star.seq > 0 and in_star.valid and state.exposure_ns < in_star.exposure_ns <= t_ns
        if fresh and t_ns - in_star.exposure_ns <= longest and is_unit(vec4(in_star.beta_SN)):
            mounting = dcm_to_ep(mat3(params.dcm_SB))
            seen = ep_compose(ep_inverse(mounting), ep_normalize(vec4(in_star.beta_SN)))
            seen = turned(seen, rate, (state.gyro_ns - in_star.exposure_ns) / 1e9)
            store4(state.beta_BN, weighted(vec4(state.beta_BN), seen, params.gain) if state.known else seen)
            state.exposure_ns = in_star.exposure_ns
            state.known = True
        if state.known:
            store3(out_att.sigma_BN, ep_to_mrp(turned(vec4(state.beta_BN), rate, (t_ns - state.gyro_ns) / 1e9)))
            store3(out_att.omega_BN_B, rate)
            publish(out_att, t_ns)
