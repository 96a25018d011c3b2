"""StarTracker: measured attitude with errors across and about the boresight."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Record, Row, Stream, eye, publish, unseeded
from fsw.math.attitude import dcm_to_ep, ep_compose, mrp_to_ep, rotvec_to_ep
from fsw.math.checks import require_rotation
from fsw.math.random import normal
from fsw.math.vectors import mat3, norm, store4, vec3
from messages.sensors import STAttMsg
from messages.states import SCStatesMsg


class StarTracker(KernelModule):
    """A star tracker whose case S has its boresight along z. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        dcm_SB: Annotated[Mat3, "-", "mounting: maps body to case components"] = eye(3)
        sigma_cross: Annotated[float, "rad", "standard deviation about the x and y axes of the case", Bound(ge=0)] = (
            4.8e-05
        )
        sigma_roll: Annotated[float, "rad", "standard deviation about the boresight", Bound(ge=0)] = 0.00029
        max_rate: Annotated[float, "rad/s", "fastest body rate at which stars are still found", Bound(gt=0)] = 0.05

        def __post_init__(self) -> None:
            """Check the mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_SB")

    class State(Record):
        """The random stream."""

        noise: Stream = unseeded

    in_state = In(SCStatesMsg)
    out_attitude = Out(STAttMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, out_attitude: Row) -> None:
        """Measure the newest true attitude."""
        if in_state.seq == 0:
            return
        out_attitude.exposure_ns = in_state.t_ns
        sigma_BN = vec3(in_state.sigma_BN)
        slow = norm(vec3(in_state.omega_BN_B)) <= params.max_rate
        out_attitude.valid = slow and math.isfinite(sigma_BN[0] + sigma_BN[1] + sigma_BN[2])
        # drawn at each step, so that a lost measurement does not shift the noise of the later ones
        x, y = params.sigma_cross * normal(state.noise), params.sigma_cross * normal(state.noise)
        error = (x, y, params.sigma_roll * normal(state.noise))
        beta_SN = (math.nan, math.nan, math.nan, math.nan)
        if out_attitude.valid:
            beta_SN = ep_compose(dcm_to_ep(mat3(params.dcm_SB)), mrp_to_ep(sigma_BN))
            beta_SN = ep_compose(rotvec_to_ep(error), beta_SN)
        store4(out_attitude.beta_SN, beta_SN)
        publish(out_attitude, t_ns)
