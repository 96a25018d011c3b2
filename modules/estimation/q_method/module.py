"""QMethod: attitude from any number of directions, with its covariance."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Record, Row, publish
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V4, store4, store33
from messages.filters import AttitudeFixMsg, DirectionsMsg
from modules.estimation.q_method import status
from modules.estimation.q_method.kernel import checked, q_attitude


@compiled
def write_fix(out: Row, exposure_ns: int, what: int, beta: V4, P: M3, loss: float) -> None:
    """Fill an attitude message; without success its numbers are NaN."""
    out.exposure_ns, out.valid, out.status = exposure_ns, what == status.VALID, what
    if what != status.VALID:
        nothing = (math.nan, math.nan, math.nan)
        beta, P, loss = (math.nan, math.nan, math.nan, math.nan), (nothing, nothing, nothing), math.nan
    store4(out.beta_BN, beta)
    store33(out.P_att, P)
    out.loss = loss


class QMethod(KernelModule):
    """Best attitude from directions. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        gate: Annotated[float, "-", "largest loss by degree of freedom; 0: none", Bound(ge=0)] = 10.0

    class State(Record):
        """What the next call needs."""

        seen: Annotated[int, "-", "seq of the last directions looked at"] = 0

    in_directions = In(DirectionsMsg)
    out_attitude = Out(AttitudeFixMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_directions: Row, out_attitude: Row) -> None:
        """Give an attitude, or the reason why there is none, for each new set of directions."""
        if in_directions.seq in (0, state.seen):
            return
        state.seen = in_directions.seq
        nothing = (math.nan, math.nan, math.nan)
        beta, P, loss = (math.nan, math.nan, math.nan, math.nan), (nothing, nothing, nothing), math.nan
        what = checked(in_directions)
        if what == status.VALID:
            what, beta, P, loss = q_attitude(in_directions)
            if what == status.VALID and params.gate > 0.0 and not loss <= params.gate:
                what = status.DISAGREE
        write_fix(out_attitude, in_directions.exposure_ns, what, beta, P, loss)
        publish(out_attitude, t_ns)
