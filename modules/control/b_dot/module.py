"""BDot: dipoles against the change of the measured field; it needs nothing but a magnetometer."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, Vec3, eye, publish, zeros
from fsw.math.checks import require_rotation
from fsw.math.vectors import add, mat3, mat_t_vec, norm, scale, store3, sub, vec3
from messages.control import MAX_TORQUERS, MTBDipoleMsg
from messages.sensors import TAMSensorMsg
from modules.control.allocation import IDENTITY, require_axes, share, within


class BDot(KernelModule):
    """Brakes a tumbling spacecraft in a magnetic field. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        torquer_axes_B: Annotated[F64, Shape(MAX_TORQUERS, 3), "-", "axes of the torquers, unit vectors"]
        max_dipole: Annotated[
            F64, Shape(MAX_TORQUERS), "A*m^2", "largest dipole of each torquer; 0 for no torquer", Bound(ge=0)
        ]
        gain: Annotated[float, "A*m^2*s", "dipole for each rad/s at which the field turns", Bound(gt=0)] = 100.0
        time_constant: Annotated[float, "s", "of the filter of the field's change; 0 for none", Bound(ge=0)] = 0.0
        dcm_SB: Annotated[Mat3, "-", "mounting of the magnetometer: maps body to case components"] = eye(3)

        def __post_init__(self) -> None:
            """Check axes and mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_SB")
            require_axes("BDot.Params.torquer_axes_B", self.torquer_axes_B, self.max_dipole, np.eye(3))

    class State(Record):
        """The last sample."""

        B_S: Annotated[Vec3, "T", "the last field"] = zeros(3)
        rate_S: Annotated[Vec3, "T/s", "its change, filtered"] = zeros(3)
        sample_ns: Annotated[int, "ns", "time of the last field; -1 before the first"] = -1
        none: Annotated[F64, Shape(MAX_TORQUERS), "A*m^2", "zeros"] = zeros(MAX_TORQUERS)

    in_field = In(TAMSensorMsg)
    out_dipole = Out(MTBDipoleMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_field: Row, out_dipole: Row) -> None:
        """Command dipoles against the change between the last two samples."""
        if in_field.seq == 0 or in_field.t_ns <= state.sample_ns:
            return
        field = vec3(in_field.B_S)
        if not math.isfinite(norm(field)):
            return
        first = state.sample_ns < 0
        dt = (in_field.t_ns - state.sample_ns) / 1e9
        change = scale(1.0 / dt, sub(field, vec3(state.B_S)))
        state.sample_ns = in_field.t_ns
        store3(state.B_S, field)
        if first or not norm(field) > 0.0:
            return
        if params.time_constant > 0.0:
            old = vec3(state.rate_S)
            change = add(old, scale(-math.expm1(-dt / params.time_constant), sub(change, old)))
        store3(state.rate_S, change)
        dipole = scale(-params.gain / norm(field), mat_t_vec(mat3(params.dcm_SB), change))
        share(dipole, params.torquer_axes_B, params.max_dipole, IDENTITY, out_dipole.dipole)
        factor = within(out_dipole.dipole, params.max_dipole, state.none)
        for i in range(MAX_TORQUERS):
            out_dipole.dipole[i] *= factor
        publish(out_dipole, t_ns)
