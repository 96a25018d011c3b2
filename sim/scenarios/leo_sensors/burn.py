"""Burn: a thruster that fires once."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import KernelModule, Out, Record, Row, Vec3, minutes, publish
from fsw.math.vectors import scale, store3, vec3
from messages.control import CmdForceBodyMsg


class Burn(KernelModule):
    """A constant force for a while. It runs after the spacecraft; what it publishes acts until its next step."""

    class Params(Record):
        """Parameters."""

        force_B: Annotated[Vec3, "N", "force of the thruster, B components"] = np.array([0.02, 0.0, 0.0])
        start_ns: Annotated[int, "ns", "begin of the firing"] = minutes(30)
        stop_ns: Annotated[int, "ns", "end of the firing"] = minutes(35)

    out_push = Out(CmdForceBodyMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_push: Row) -> None:
        """Publish the force that acts from now on."""
        firing = params.start_ns <= t_ns < params.stop_ns
        store3(out_push.force_B, scale(1.0 if firing else 0.0, vec3(params.force_B)))
        publish(out_push, t_ns)
