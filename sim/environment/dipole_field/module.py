"""Dipole field: the magnetic field of a dipole at the planet's centre."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Record, Row, publish
from fsw.math.magnetic import RADIUS, dipole_field
from fsw.math.vectors import mat3, mat_t_vec, store3, vec3
from messages.environment import MagneticFieldMsg, PlanetOrientationMsg
from messages.states import SCStatesMsg


class DipoleField(KernelModule):
    """The three Gauss coefficients of degree 1. See SPEC.md."""

    class Params(Record):
        """Parameters; the coefficients are those of IGRF-14 for 2025."""

        g10: Annotated[
            float, "T", "Gauss coefficient g of degree 1, order 0: minus the part along the north pole"
        ] = -2.935e-05
        g11: Annotated[float, "T", "Gauss coefficient g of degree 1, order 1"] = -1.4103e-06
        h11: Annotated[float, "T", "Gauss coefficient h of degree 1, order 1"] = 4.5455e-06
        radius: Annotated[float, "m", "reference radius of the coefficients", Bound(gt=0)] = RADIUS

    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_field = Out(MagneticFieldMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_orientation: Row, out_field: Row) -> None:
        """Field at the newest position and orientation."""
        if in_state.seq == 0 or in_orientation.seq == 0:
            return
        moment_N = mat_t_vec(mat3(in_orientation.dcm_EN), (params.g11, params.h11, params.g10))
        b = dipole_field(vec3(in_state.r_BN_N), params.radius, moment_N)
        if not math.isfinite(b[0] + b[1] + b[2]):
            raise ValueError(
                "in_state.r_BN_N, in_orientation.dcm_EN: expected finite numbers and a position that is not 0"
            )
        store3(out_field.B_N, b)
        publish(out_field, t_ns)
