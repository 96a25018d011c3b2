"""Triad: attitude from two directions, anchored on the better one."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Record, Row, publish
from fsw.math.attitude import dcm_to_ep
from fsw.math.triad import triad
from fsw.math.vectors import angle_between, vec3
from messages.filters import AttitudeFixMsg, DirectionsMsg
from modules.estimation.q_method import status
from modules.estimation.q_method.kernel import checked
from modules.estimation.q_method.module import write_fix
from modules.estimation.triad.kernel import triad_covariance


class Triad(KernelModule):
    """Attitude from the first two directions. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        gate: Annotated[float, "-", "largest squared error of the angle by its variance; 0: none", Bound(ge=0)] = 25.0

    class State(Record):
        """What the next call needs."""

        seen: Annotated[int, "-", "seq of the last directions looked at"] = 0

    in_directions = In(DirectionsMsg)
    out_attitude = Out(AttitudeFixMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_directions: Row, out_attitude: Row) -> None:
        """Give an attitude, or the reason why there is none, for each new pair of directions."""
        if in_directions.seq in (0, state.seen):
            return
        state.seen = in_directions.seq
        nothing = (math.nan, math.nan, math.nan)
        beta, P, loss = (math.nan, math.nan, math.nan, math.nan), (nothing, nothing, nothing), math.nan
        what = checked(in_directions)
        if what == status.VALID:
            first = 0 if in_directions.sigma[0] <= in_directions.sigma[1] else 1
            a_B, o_B = vec3(in_directions.measured_B[first]), vec3(in_directions.measured_B[1 - first])
            a_N, o_N = vec3(in_directions.known_N[first]), vec3(in_directions.known_N[1 - first])
            dcm_BN = triad(a_B, o_B, a_N, o_N)
            sa, so = in_directions.sigma[first], in_directions.sigma[1 - first]
            if math.isnan(dcm_BN[0][0]):
                what = status.PARALLEL
            else:
                beta, P = dcm_to_ep(dcm_BN), triad_covariance(a_B, o_B, sa, so)
                loss = (angle_between(a_B, o_B) - angle_between(a_N, o_N)) ** 2 / (sa * sa + so * so)
                if params.gate > 0.0 and not loss <= params.gate:
                    what = status.DISAGREE
        write_fix(out_attitude, in_directions.exposure_ns, what, beta, P, loss)
        publish(out_attitude, t_ns)
