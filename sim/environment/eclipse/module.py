"""Eclipse: how much of the Sun the spacecraft sees past the planet and one more body."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Record, Row, publish
from fsw.math.eclipse import visible_fraction
from fsw.math.geodesy import A
from fsw.math.vectors import scale, sub, vec3
from messages.environment import EclipseMsg, EphemerisMsg
from messages.states import SCStatesMsg


class Eclipse(KernelModule):
    """Conical shadow of the central body, and of a moon if one is connected. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        radius: Annotated[float, "m", "radius of the central body that casts the shadow", Bound(gt=0)] = A

    in_state = In(SCStatesMsg)
    in_sun = In(EphemerisMsg)
    in_moon = In(EphemerisMsg, optional=True)
    out_eclipse = Out(EclipseMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_sun: Row, in_moon: Row, out_eclipse: Row) -> None:
        """Visible part of the Sun's disk at the newest position."""
        if in_state.seq == 0 or in_sun.seq == 0:
            return
        r_BN_N = vec3(in_state.r_BN_N)
        r_SB_N = sub(vec3(in_sun.r_PN_N), r_BN_N)
        light = visible_fraction(r_SB_N, in_sun.radius, scale(-1.0, r_BN_N), params.radius)
        if in_moon.seq > 0:
            r_MB_N = sub(vec3(in_moon.r_PN_N), r_BN_N)
            other = visible_fraction(r_SB_N, in_sun.radius, r_MB_N, in_moon.radius)
            if not other >= light:  # also where it is NaN
                light = other
        if not math.isfinite(light):
            raise ValueError(
                "in_state.r_BN_N, in_sun or in_moon r_PN_N: expected finite positions (m), got NaN; look at the writer"
            )
        out_eclipse.illumination = light
        publish(out_eclipse, t_ns)
