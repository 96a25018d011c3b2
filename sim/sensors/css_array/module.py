"""CssArray: six coarse Sun sensors in sunlight and earthshine."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Out, Row, Shape, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.forces import ASTRONOMICAL_UNIT
from fsw.math.random import normal
from fsw.math.vectors import add, cross, dot, matvec, norm, scale, sub, unit, vec3
from messages.environment import EclipseMsg, EphemerisMsg
from messages.sensors import CSSArraySensorMsg
from messages.states import SCStatesMsg
from sim.sensors.css_array.kernel import cell, earthshine
from sim.sensors.faults import FRESH, NOTHING, FaultParams, FaultState, delivery
from sim.sensors.readout import quantised

NORMALS_B = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
"""One cell on each face of a box."""
NORMALS_B.setflags(write=False)


class CssArray(KernelModule):
    """Six photocells whose current goes with the cosine of the angle to the Sun. See SPEC.md."""

    class Params(FaultParams):
        """Parameters."""

        normals_B: Annotated[F64, Shape(6, 3), "-", "normals of the cells, any length, B components"] = NORMALS_B
        misalignment_B: Annotated[F64, Shape(6, 3), "rad", "small turn of each cell, B components"] = zeros(6, 3)
        fov: Annotated[float, "rad", "half angle of the field of view", Bound(gt=0, le=3.141592653589793)] = (
            1.3962634015954636
        )
        kelly_power: Annotated[float, "-", "exponent of the fall at grazing light", Bound(gt=0)] = 2.0
        kelly_factor: Annotated[float, "-", "width of the fall at grazing light; 0 for none", Bound(ge=0)] = 0.0
        albedo: Annotated[float, "-", "part of the sunlight that the planet throws back", Bound(ge=0, le=1)] = 0.3
        radius: Annotated[float, "m", "radius of the planet", Bound(gt=0)] = 6371000.0
        scale_error: Annotated[F64, Shape(6), "-", "scale factor error of each cell"] = zeros(6)
        bias: Annotated[F64, Shape(6), "-", "dark current of each cell, before its scale factor"] = zeros(6)
        sigma: Annotated[float, "-", "standard deviation of the noise of a sample", Bound(ge=0)] = 0.02
        resolution: Annotated[float, "-", "step of the last digit; 0 for none", Bound(ge=0)] = 0.0
        low: Annotated[float, "-", "smallest reading"] = 0.0
        high: Annotated[float, "-", "greatest reading"] = 1.5

        def __post_init__(self) -> None:
            """Check normals and limits too."""
            super().__post_init__()
            if not np.all(np.linalg.norm(self.normals_B, axis=1) > 1e-6):
                text = f"expected six vectors longer than 1e-6, got {self.normals_B.tolist()}"
                raise ValueError(f"CssArray.Params.normals_B: {text}; give each cell a direction")
            if not self.high > self.low:
                raise ValueError(f"CssArray.Params.high: expected more than low = {self.low:g}, got {self.high:g}")

    class State(FaultState):
        """Random streams."""

    in_state = In(SCStatesMsg)
    in_sun = In(EphemerisMsg)
    in_eclipse = In(EclipseMsg, optional=True)
    out_css = Out(CSSArraySensorMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_sun: Row, in_eclipse: Row, out_css: Row) -> None:
        """Read the six cells."""
        if in_state.seq == 0 or in_sun.seq == 0:
            return
        what, gain = delivery(t_ns, params, state, out_css.seq)
        dcm_BN = mrp_to_dcm(vec3(in_state.sigma_BN))
        r_BN_N, r_SN_N = vec3(in_state.r_BN_N), vec3(in_sun.r_PN_N)
        r_SB_N = sub(r_SN_N, r_BN_N)
        distance = norm(r_SB_N)
        sun_B, nadir_B = matvec(dcm_BN, unit(r_SB_N)), matvec(dcm_BN, scale(-1.0, unit(r_BN_N)))
        light = (ASTRONOMICAL_UNIT / distance) ** 2
        shine = light * earthshine(r_BN_N, unit(r_SN_N), params.radius, params.albedo)
        if in_eclipse.seq > 0:
            light *= in_eclipse.illumination
        if not math.isfinite(light * dot(sun_B, nadir_B) + shine):
            what = NOTHING
        for i in range(6):
            noise = gain * params.sigma * normal(state.noise)
            n_B = unit(vec3(params.normals_B[i]))
            n_B = unit(add(n_B, cross(vec3(params.misalignment_B[i]), n_B)))
            current = cell(n_B, sun_B, light, nadir_B, shine, params)
            current = (current + params.bias[i]) * (1.0 + params.scale_error[i]) + noise
            if what == FRESH:
                out_css.signal[i] = min(max(quantised(current, params.resolution), params.low), params.high)
        if what != NOTHING:
            publish(out_css, t_ns)
