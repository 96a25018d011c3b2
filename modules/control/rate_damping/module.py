"""RateDamping: a torque against the measured rate; it needs no attitude."""

from __future__ import annotations

from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Record, Row, Vec3, eye, publish, zeros
from fsw.math.checks import require_rotation
from fsw.math.vectors import mat3, mat_t_vec, norm, scale, store3, sub, vec3
from messages.control import CmdTorqueBodyMsg
from messages.sensors import IMUSensorMsg


class RateDamping(KernelModule):
    """Brakes a rotation, or brings it to a wanted rate. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        P: Annotated[float, "N*m*s", "rate gain", Bound(gt=0)] = 30.0
        max_torque: Annotated[float, "N*m", "longest torque; 0 for any", Bound(ge=0)] = 0.0
        omega_RN_B: Annotated[Vec3, "rad/s", "wanted rate, B components"] = zeros(3)
        dcm_PB: Annotated[Mat3, "-", "mounting of the gyro: maps body to case components"] = eye(3)

        def __post_init__(self) -> None:
            """Check the mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_PB")

    in_imu = In(IMUSensorMsg)
    out_torque = Out(CmdTorqueBodyMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_imu: Row, out_torque: Row) -> None:
        """Command a torque against the newest rate."""
        if in_imu.seq == 0:
            return
        omega = mat_t_vec(mat3(params.dcm_PB), vec3(in_imu.omega_PN_P))
        torque = scale(-params.P, sub(omega, vec3(params.omega_RN_B)))
        size = norm(torque)
        if params.max_torque > 0.0 and size > params.max_torque:
            torque = scale(params.max_torque / size, torque)
        store3(out_torque.torque_B, torque)
        publish(out_torque, t_ns)
