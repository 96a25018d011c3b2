"""MagneticMomentumDump: dipoles of torquers that take momentum from the wheels."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, Vec3, eye, publish, zeros
from fsw.math.checks import require_rotation
from fsw.math.vectors import axpy, cross, dot, mat3, mat_t_vec, scale, vec3
from messages.control import MAX_TORQUERS, MAX_WHEELS, MTBDipoleMsg, RWSpeedMsg
from messages.sensors import TAMSensorMsg
from modules.control.allocation import IDENTITY, require_axes, share, within


class MagneticMomentumDump(KernelModule):
    """Cross-product law for the momentum of wheels. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        wheel_axes_B: Annotated[F64, Shape(MAX_WHEELS, 3), "-", "axes of the wheels, unit vectors"]
        wheel_inertia: Annotated[F64, Shape(MAX_WHEELS), "kg*m^2", "about the axes; 0 for no wheel", Bound(ge=0)]
        torquer_axes_B: Annotated[F64, Shape(MAX_TORQUERS, 3), "-", "axes of the torquers, unit vectors"]
        max_dipole: Annotated[
            F64, Shape(MAX_TORQUERS), "A*m^2", "largest dipole of each torquer; 0 for no torquer", Bound(ge=0)
        ]
        gain: Annotated[float, "1/s", "part of the momentum to take in a second", Bound(gt=0)] = 1e-3
        target_B: Annotated[Vec3, "N*m*s", "momentum to keep, B components"] = zeros(3)
        dcm_SB: Annotated[Mat3, "-", "mounting of the magnetometer: maps body to case components"] = eye(3)
        least_field: Annotated[float, "T", "field below which nothing is commanded", Bound(gt=0)] = 1e-6

        def __post_init__(self) -> None:
            """Check axes and mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_SB")
            where = "MagneticMomentumDump.Params."
            require_axes(f"{where}torquer_axes_B", self.torquer_axes_B, self.max_dipole, np.eye(3))
            require_axes(f"{where}wheel_axes_B", self.wheel_axes_B, self.wheel_inertia, np.zeros((0, 3)))

    class State(Record):
        """Room for the allocation."""

        none: Annotated[F64, Shape(MAX_TORQUERS), "A*m^2", "zeros"] = zeros(MAX_TORQUERS)

    in_speeds = In(RWSpeedMsg)
    in_field = In(TAMSensorMsg)
    out_dipole = Out(MTBDipoleMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_speeds: Row, in_field: Row, out_dipole: Row) -> None:
        """Command the dipoles for the newest speeds and field."""
        if in_speeds.seq == 0 or in_field.seq == 0:
            return
        h = scale(-1.0, vec3(params.target_B))
        for i in range(MAX_WHEELS):
            if params.wheel_inertia[i] > 0.0:
                h = axpy(params.wheel_inertia[i] * in_speeds.omega[i], vec3(params.wheel_axes_B[i]), h)
        field = mat_t_vec(mat3(params.dcm_SB), vec3(in_field.B_S))
        square, dipole = dot(field, field), (0.0, 0.0, 0.0)
        if not square < params.least_field * params.least_field:
            dipole = scale(-params.gain / square, cross(field, h))
        share(dipole, params.torquer_axes_B, params.max_dipole, IDENTITY, out_dipole.dipole)
        factor = within(out_dipole.dipole, params.max_dipole, state.none)
        for i in range(MAX_TORQUERS):
            out_dipole.dipole[i] *= factor
        publish(out_dipole, t_ns)
