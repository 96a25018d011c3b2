"""MrpFeedback: control torque from the attitude error."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, Vec3, publish, zeros
from fsw.math.checks import require_inertia
from fsw.math.vectors import add, axpy, mat3, matvec, store3, sub, vec3
from messages.attitude import AttGuidMsg
from messages.control import MAX_WHEELS, CmdTorqueBodyMsg, RWSpeedMsg
from modules.control.mrp_feedback.kernel import clip, feedback_torque, wheel_momentum


class MrpFeedback(KernelModule):
    """Nonlinear attitude feedback with optional integral action. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        inertia_B: Annotated[Mat3, "kg*m^2", "inertia about the centre of mass, B components"]
        K: Annotated[float, "N*m", "attitude gain", Bound(gt=0)] = 3.5
        P: Annotated[float, "N*m*s", "rate gain", Bound(gt=0)] = 30.0
        Ki: Annotated[float, "1/(kg*m^2)", "integral gain; 0 switches the integral off", Bound(ge=0)] = 0.0
        integral_limit: Annotated[float, "N*m*s", "bound of each component of the integral", Bound(ge=0)] = 0.1
        whole_rate: Annotated[bool, "-", "gyroscopic term with the body's rate, not the reference's"] = False
        known_torque_B: Annotated[Vec3, "N*m", "known external torque, which the command cancels"] = zeros(3)
        wheel_axes_B: Annotated[F64, Shape(MAX_WHEELS, 3), "-", "axes of reaction wheels, unit vectors"] = zeros(
            MAX_WHEELS, 3
        )
        wheel_inertia: Annotated[F64, Shape(MAX_WHEELS), "kg*m^2", "about the axes; 0 for no wheel", Bound(ge=0)] = (
            zeros(MAX_WHEELS)
        )

        def __post_init__(self) -> None:
            """Check the inertia too."""
            super().__post_init__()
            require_inertia(self, "inertia_B")
            length = np.linalg.norm(self.wheel_axes_B[self.wheel_inertia > 0.0], axis=1)
            if np.any(np.abs(length - 1.0) > 1e-9):
                text = "expected unit vectors for the wheels with an inertia, got lengths"
                raise ValueError(f"MrpFeedback.Params.wheel_axes_B: {text} {length.tolist()}; divide by them")

    class State(Record):
        """The integral."""

        integral: Annotated[Vec3, "N*m*s", "integral of K sigma_BR, limited"] = zeros(3)
        guid_ns: Annotated[int, "ns", "time of the last guidance message, -1 before the first"] = -1

    in_guid = In(AttGuidMsg)
    in_wheels = In(RWSpeedMsg, optional=True)
    out_torque = Out(CmdTorqueBodyMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_guid: Row, in_wheels: Row, out_torque: Row) -> None:
        """Command the torque for the newest error."""
        if in_guid.seq == 0:
            return
        sigma_BR, omega_BR = vec3(in_guid.sigma_BR), vec3(in_guid.omega_BR_B)
        inertia = mat3(params.inertia_B)
        z = (0.0, 0.0, 0.0)
        if params.Ki > 0.0:
            dt = (in_guid.t_ns - state.guid_ns) / 1e9 if state.guid_ns >= 0 else 0.0
            total = axpy(params.K * dt, sigma_BR, vec3(state.integral))
            limit = params.integral_limit
            total = (clip(total[0], limit), clip(total[1], limit), clip(total[2], limit))
            if math.isfinite(total[0] + total[1] + total[2]):  # a bad error must not stay in the integral
                store3(state.integral, total)
                state.guid_ns = in_guid.t_ns
            z = axpy(1.0, matvec(inertia, omega_BR), total)
        gains = (params.K, params.Ki, params.P)
        omega_RN, domega_RN = vec3(in_guid.omega_RN_B), vec3(in_guid.domega_RN_B)
        wheels = (0.0, 0.0, 0.0)
        if in_wheels.seq > 0:
            rate = add(omega_BR, omega_RN)
            wheels = wheel_momentum(rate, in_wheels.omega, params.wheel_axes_B, params.wheel_inertia)
        torque = feedback_torque(sigma_BR, omega_BR, omega_RN, domega_RN, z, gains, inertia, wheels, params.whole_rate)
        store3(out_torque.torque_B, sub(torque, vec3(params.known_torque_B)))
        publish(out_torque, t_ns)
