"""WheelTorqueMap: what torque each wheel's motor gives for a torque on the body."""

from __future__ import annotations

from typing import Annotated

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, eye, publish, zeros
from fsw.math.vectors import mat3, matvec, scale, vec3
from messages.control import MAX_WHEELS, CmdTorqueBodyMsg, RWSpeedMsg, RWTorqueMsg
from modules.control.allocation import projector, require_axes, share, within


class WheelTorqueMap(KernelModule):
    """Shares a torque among up to eight wheels. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        wheel_axes_B: Annotated[F64, Shape(MAX_WHEELS, 3), "-", "axes of the wheels, unit vectors"]
        max_torque: Annotated[
            F64, Shape(MAX_WHEELS), "N*m", "largest torque of each motor; 0 for no wheel", Bound(ge=0)
        ]
        control_axes_B: Annotated[Mat3, "-", "rows are axes to control, unit vectors; zeros for none"] = eye(3)
        null_gain: Annotated[float, "N*m*s", "torque for each rad/s towards `null_speed`; 0 for none", Bound(ge=0)] = (
            0.0
        )
        null_speed: Annotated[F64, Shape(MAX_WHEELS), "rad/s", "wanted speeds, as far as the torque allows"] = zeros(
            MAX_WHEELS
        )

        def __post_init__(self) -> None:
            """Check the axes too."""
            super().__post_init__()
            require_axes("WheelTorqueMap.Params.wheel_axes_B", self.wheel_axes_B, self.max_torque, self.control_axes_B)

    class State(Record):
        """Room for the torques."""

        null: Annotated[F64, Shape(MAX_WHEELS), "N*m", "torques that leave the body alone"] = zeros(MAX_WHEELS)
        none: Annotated[F64, Shape(MAX_WHEELS), "N*m", "zeros"] = zeros(MAX_WHEELS)

    in_torque = In(CmdTorqueBodyMsg)
    in_speeds = In(RWSpeedMsg, optional=True)
    out_motor = Out(RWTorqueMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_torque: Row, in_speeds: Row, out_motor: Row) -> None:
        """Share the newest torque."""
        if in_torque.seq == 0:
            return
        axes, limit, control, motor, null = (
            params.wheel_axes_B,
            params.max_torque,
            mat3(params.control_axes_B),
            out_motor.torque,
            state.null,
        )
        share(scale(-1.0, vec3(in_torque.torque_B)), axes, limit, control, motor)
        factor = within(motor, limit, state.none)
        for i in range(MAX_WHEELS):
            motor[i] *= factor
        if params.null_gain > 0.0 and in_speeds.seq > 0:
            total = (0.0, 0.0, 0.0)
            for i in range(MAX_WHEELS):
                null[i] = params.null_gain * (params.null_speed[i] - in_speeds.omega[i]) if limit[i] > 0.0 else 0.0
                m = matvec(control, vec3(axes[i]))
                total = (total[0] + null[i] * m[0], total[1] + null[i] * m[1], total[2] + null[i] * m[2])
            taken = matvec(projector(axes, limit, control), total)
            for i in range(MAX_WHEELS):
                m = matvec(control, vec3(axes[i]))
                null[i] -= (m[0] * taken[0] + m[1] * taken[1] + m[2] * taken[2]) if limit[i] > 0.0 else 0.0
            factor = within(null, limit, motor)
            for i in range(MAX_WHEELS):
                motor[i] += factor * null[i]
        publish(out_motor, t_ns)
