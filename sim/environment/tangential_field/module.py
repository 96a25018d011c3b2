"""Tangential field: a plain field towards geographic north with a constant dip."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Record, Row, publish
from fsw.math.magnetic import tangential_field
from fsw.math.vectors import store3, vec3
from messages.environment import MagneticFieldMsg, PlanetOrientationMsg
from messages.states import SCStatesMsg


class TangentialField(KernelModule):
    """Constant strength, towards geographic north, tilted down by a constant dip. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        strength: Annotated[float, "T", "magnitude of the field", Bound(gt=0)] = 3e-05
        dip: Annotated[float, "rad", "angle below the local horizontal", Bound(ge=-math.pi / 2, le=math.pi / 2)] = 0.0

    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_field = Out(MagneticFieldMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_orientation: Row, out_field: Row) -> None:
        """Field at the newest position and orientation."""
        if in_state.seq == 0 or in_orientation.seq == 0:
            return
        pole_N = vec3(in_orientation.dcm_EN[2])
        b = tangential_field(vec3(in_state.r_BN_N), pole_N, params.strength, params.dip)
        if not math.isfinite(b[0] + b[1] + b[2]):
            raise ValueError(
                "in_state.r_BN_N, in_orientation.dcm_EN: expected finite numbers and a position that is not above a "
                "pole, where north is not defined; take MagneticField or DipoleField for polar orbits"
            )
        store3(out_field.B_N, b)
        publish(out_field, t_ns)
