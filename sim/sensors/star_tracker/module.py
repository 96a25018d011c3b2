"""StarTracker: measured attitude with errors across and about the boresight."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Row, publish
from fsw.math.attitude import ep_compose, ep_normalize, ep_to_dcm, rotvec_to_ep
from fsw.math.random import normal
from fsw.math.vectors import add, matvec, store4
from messages.environment import EphemerisMsg
from messages.sensors import STAttMsg
from messages.states import SCStatesMsg
from sim.sensors.faults import FRESH, NOTHING, FaultState, delivery
from sim.sensors.readout import quantised
from sim.sensors.starlight import StarParams, true_attitude, usable, velocity_over_c


class StarTracker(KernelModule):
    """A star tracker whose case S has its boresight along z. See SPEC.md."""

    class Params(StarParams):
        """Parameters."""

        sigma_cross: Annotated[float, "rad", "standard deviation about the x and y axes of the case", Bound(ge=0)] = (
            4.8e-05
        )
        sigma_roll: Annotated[float, "rad", "standard deviation about the boresight", Bound(ge=0)] = 0.00029
        resolution: Annotated[float, "-", "step of the Euler parameters; 0 for none", Bound(ge=0, le=0.01)] = 0.0

    class State(FaultState):
        """Random streams."""

    in_state = In(SCStatesMsg)
    in_sun = In(EphemerisMsg, optional=True)
    in_moon = In(EphemerisMsg, optional=True)
    out_attitude = Out(STAttMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_sun: Row, in_moon: Row, out_attitude: Row) -> None:
        """Measure the newest true attitude."""
        if in_state.seq == 0:
            return
        # drawn at each step, so that a lost measurement does not shift the noise of the later ones
        what, gain = delivery(t_ns, params, state, out_attitude.seq)
        x, y = params.sigma_cross * normal(state.noise), params.sigma_cross * normal(state.noise)
        error = (gain * x, gain * y, gain * params.sigma_roll * normal(state.noise))
        if what == NOTHING:
            return
        out_attitude.exposure_ns = in_state.t_ns
        if what == FRESH:
            beta_SN = true_attitude(params, in_state)
            dcm_SN = ep_to_dcm(beta_SN)
            valid = math.isfinite(beta_SN[0]) and usable(dcm_SN[2], params, in_state, in_sun, in_moon)
            if params.aberration:
                towards = matvec(dcm_SN, velocity_over_c(in_state, in_sun))
                error = add(error, (towards[1], -towards[0], 0.0))
                valid = valid and math.isfinite(error[0] + error[1])
            beta_SN = ep_compose(rotvec_to_ep(error), beta_SN)
            if params.resolution > 0.0:
                step = params.resolution
                w, i, j, k = beta_SN
                rounded = (quantised(w, step), quantised(i, step), quantised(j, step), quantised(k, step))
                beta_SN = ep_normalize(rounded)
            if not valid:
                beta_SN = (math.nan, math.nan, math.nan, math.nan)
            out_attitude.valid = valid
            store4(out_attitude.beta_SN, beta_SN)
        publish(out_attitude, t_ns)
