"""Magnetometer: measured flux density with bias, misalignment and noise."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Row, Vec3, eye, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.checks import require_rotation
from fsw.math.random import normal
from fsw.math.vectors import add, mat3, matvec, vec3
from messages.environment import MagneticFieldMsg
from messages.sensors import TAMSensorMsg
from messages.states import SCStatesMsg
from sim.sensors.faults import FRESH, NOTHING, FaultParams, FaultState, delivery
from sim.sensors.readout import digitised


class Magnetometer(KernelModule):
    """A three-axis magnetometer with the case S. See SPEC.md."""

    class Params(FaultParams):
        """Parameters."""

        dcm_SB: Annotated[Mat3, "-", "mounting: maps body to case components"] = eye(3)
        misalignment: Annotated[Mat3, "-", "scale factor errors (diagonal), misalignment and soft iron"] = zeros(3, 3)
        bias_S: Annotated[Vec3, "T", "bias: hard iron and residual dipole of the spacecraft, S components"] = zeros(3)
        sigma: Annotated[float, "T", "standard deviation of the noise of a sample, each axis", Bound(ge=0)] = 1e-07
        resolution: Annotated[float, "T", "step of the last digit; 0 for none", Bound(ge=0)] = 0.0
        max_field: Annotated[float, "T", "saturation of each axis; 0 for none", Bound(ge=0)] = 0.0

        def __post_init__(self) -> None:
            """Check the mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_SB")

    class State(FaultState):
        """Random streams."""

    in_state = In(SCStatesMsg)
    in_field = In(MagneticFieldMsg)
    out_field = Out(TAMSensorMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_field: Row, out_field: Row) -> None:
        """Measure the newest field in the newest attitude."""
        if in_state.seq == 0 or in_field.seq == 0:
            return
        noise = (normal(state.noise), normal(state.noise), normal(state.noise))
        what, gain = delivery(t_ns, params, state, out_field.seq)
        dcm_BN = mrp_to_dcm(vec3(in_state.sigma_BN))
        true_S = matvec(mat3(params.dcm_SB), matvec(dcm_BN, vec3(in_field.B_N)))
        if what == NOTHING or not math.isfinite(true_S[0] + true_S[1] + true_S[2]):
            return
        if what == FRESH:
            seen = add(true_S, matvec(mat3(params.misalignment), true_S))
            for i in range(3):
                value = seen[i] + params.bias_S[i] + gain * params.sigma * noise[i]
                out_field.B_S[i] = digitised(value, params.resolution, params.max_field)
        publish(out_field, t_ns)
