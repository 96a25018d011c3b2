"""MagneticTorquers: coils that turn the spacecraft against the magnetic field."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Out, Record, Row, Shape, Vec3, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.vectors import axpy, cross, dot, matvec, store3, vec3
from messages.control import MAX_TORQUERS, CmdTorqueBodyMsg, MTBDipoleMsg
from messages.environment import MagneticFieldMsg
from messages.states import SCStatesMsg


class MagneticTorquers(KernelModule):
    """Up to eight coils with limits. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        axes_B: Annotated[F64, Shape(MAX_TORQUERS, 3), "-", "axes of the torquers, unit vectors, B components"] = zeros(
            MAX_TORQUERS, 3
        )
        max_dipole: Annotated[
            F64, Shape(MAX_TORQUERS), "A*m^2", "largest dipole of a torquer; 0 for no torquer", Bound(ge=0)
        ] = zeros(MAX_TORQUERS)
        time_constant: Annotated[float, "s", "of the current behind its command; 0 for none", Bound(ge=0)] = 0.0
        residual_B: Annotated[Vec3, "A*m^2", "dipole that stays, whatever is commanded, B components"] = zeros(3)

        def __post_init__(self) -> None:
            """Check the axes too."""
            super().__post_init__()
            length = np.linalg.norm(self.axes_B[self.max_dipole > 0.0], axis=1)
            if np.any(np.abs(length - 1.0) > 1e-9):
                text = "expected unit vectors for the torquers with a dipole, got lengths"
                raise ValueError(f"MagneticTorquers.Params.axes_B: {text} {length.tolist()}; divide by them")

    class State(Record):
        """The dipoles."""

        dipole: Annotated[F64, Shape(MAX_TORQUERS), "A*m^2", "dipole of each torquer"] = zeros(MAX_TORQUERS)
        step_ns: Annotated[int, "ns", "time of the last step; -1 before the first"] = -1

    in_state = In(SCStatesMsg)
    in_field = In(MagneticFieldMsg)
    in_dipole = In(MTBDipoleMsg, optional=True)
    out_torque = Out(CmdTorqueBodyMsg)
    out_dipole = Out(MTBDipoleMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_state: Row,
        in_field: Row,
        in_dipole: Row,
        out_torque: Row,
        out_dipole: Row,
    ) -> None:
        """Follow the command, and turn against the newest field in the newest attitude."""
        if in_state.seq == 0 or in_field.seq == 0:
            return
        field_B = matvec(mrp_to_dcm(vec3(in_state.sigma_BN)), vec3(in_field.B_N))
        if not math.isfinite(dot(field_B, field_B)):
            raise ValueError("in_field.B_N, in_state.sigma_BN: expected finite numbers, got NaN; look at their writers")
        follow = 1.0
        if params.time_constant > 0.0:
            past = (t_ns - state.step_ns) / 1e9 if state.step_ns >= 0 else 0.0
            follow = -math.expm1(-past / params.time_constant)
        total = vec3(params.residual_B)
        for i in range(MAX_TORQUERS):
            limit = params.max_dipole[i]
            command = in_dipole.dipole[i] if in_dipole.seq > 0 and limit > 0.0 else 0.0
            if not math.isfinite(command):
                raise ValueError("in_dipole.dipole: expected finite numbers (A m^2), got NaN; look at its writer")
            state.dipole[i] += follow * (max(-limit, min(limit, command)) - state.dipole[i])
            out_dipole.dipole[i] = state.dipole[i]
            total = axpy(state.dipole[i], vec3(params.axes_B[i]), total)
        state.step_ns = t_ns
        store3(out_torque.torque_B, cross(total, field_B))
        publish(out_torque, t_ns)
        publish(out_dipole, t_ns)
