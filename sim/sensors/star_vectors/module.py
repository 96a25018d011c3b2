"""StarVectors: directions to the brightest stars in the field of view."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, I64, Bound, In, KernelModule, Out, Row, Shape, publish, zeros
from fsw.math.attitude import ep_to_dcm
from fsw.math.random import normal
from fsw.math.vectors import store3, unit, vec3
from messages.environment import EphemerisMsg
from messages.sensors import StarVectorsMsg
from messages.states import SCStatesMsg
from sim.sensors.faults import FRESH, NOTHING, FaultState, delivery
from sim.sensors.readout import quantised
from sim.sensors.star_vectors.catalogue import CAPACITY
from sim.sensors.star_vectors.kernel import SLOTS, find_stars
from sim.sensors.starlight import StarParams, true_attitude, usable, velocity_over_c

NO_STARS = np.zeros(CAPACITY, np.int64)
NO_STARS.setflags(write=False)


class StarVectors(KernelModule):
    """A star tracker with boresight z that gives single stars. See SPEC.md."""

    class Params(StarParams):
        """Parameters; `catalogue` makes the last four."""

        fov: Annotated[float, "rad", "half angle of the field of view, a cone", Bound(gt=0, lt=1.4)] = 0.17
        limit: Annotated[float, "-", "magnitude of the faintest star that is seen"] = 6.0
        sigma: Annotated[float, "rad", "standard deviation of the image coordinates x/z, y/z", Bound(ge=0)] = 4.8e-05
        resolution: Annotated[float, "rad", "step of the image coordinates; 0 for none", Bound(ge=0)] = 0.0
        stars: Annotated[int, "-", "number of stars in the catalogue", Bound(ge=0, le=CAPACITY)] = 0
        star: Annotated[I64, Shape(CAPACITY), "-", "row of each star in the catalogue"] = NO_STARS
        magnitude: Annotated[F64, Shape(CAPACITY), "-", "magnitudes, ascending"] = zeros(CAPACITY)
        s_N: Annotated[F64, Shape(CAPACITY, 3), "-", "unit vectors to the stars, N components"] = zeros(CAPACITY, 3)

        def __post_init__(self) -> None:
            """Check the catalogue too."""
            super().__post_init__()
            length = np.linalg.norm(self.s_N[: self.stars], axis=1)
            if np.any(np.abs(length - 1.0) > 1e-12) or np.any(np.diff(self.magnitude[: self.stars]) < 0.0):
                text = "expected unit vectors with ascending magnitudes; make them with catalogue(...)"
                raise ValueError(f"StarVectors.Params.s_N: {text}")

    class State(FaultState):
        """Random streams."""

    in_state = In(SCStatesMsg)
    in_sun = In(EphemerisMsg, optional=True)
    in_moon = In(EphemerisMsg, optional=True)
    out_stars = Out(StarVectorsMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_sun: Row, in_moon: Row, out_stars: Row) -> None:
        """Look for stars with the newest true attitude."""
        if in_state.seq == 0:
            return
        what, gain = delivery(t_ns, params, state, out_stars.seq)
        count = 0
        if what == FRESH:
            dcm_SN = ep_to_dcm(true_attitude(params, in_state))
            valid = math.isfinite(dcm_SN[2][2]) and usable(dcm_SN[2], params, in_state, in_sun, in_moon)
            beta_N = (0.0, 0.0, 0.0)
            if params.aberration:
                beta_N = velocity_over_c(in_state, in_sun)
                valid = valid and math.isfinite(beta_N[0] + beta_N[1] + beta_N[2])
            if valid:
                count = find_stars(dcm_SN, beta_N, vec3(in_state.r_BN_N), params, out_stars.star, out_stars.s_S)
            out_stars.valid, out_stars.count = valid, count
            out_stars.sigma = gain * params.sigma if valid else math.nan
        # all numbers are drawn at each step, so that a lost star does not shift the noise of the later ones
        for k in range(SLOTS):
            x, y = gain * params.sigma * normal(state.noise), gain * params.sigma * normal(state.noise)
            if k < count:
                s = vec3(out_stars.s_S[k])
                x, y = quantised(s[0] / s[2] + x, params.resolution), quantised(s[1] / s[2] + y, params.resolution)
                store3(out_stars.s_S[k], unit((x, y, 1.0)))
            elif what == FRESH:
                out_stars.star[k] = -1
                store3(out_stars.s_S[k], (math.nan, math.nan, math.nan))
        if what != NOTHING:
            out_stars.exposure_ns = in_state.t_ns
            publish(out_stars, t_ns)
