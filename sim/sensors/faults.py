"""Faults that every sensor can have: parameters, state and the one function that says what becomes of a sample."""

from __future__ import annotations

from typing import Annotated

from fsw import Bound, Record, Row, Stream, unseeded
from fsw.math.compiled import compiled
from fsw.math.random import uniform

NONE, DEAD, STUCK, NOISY, DROPPING = 0, 1, 2, 3, 4
"""Values of the parameter ``fault``."""
FRESH, HELD, NOTHING = 0, 1, 2
"""What becomes of a sample: it is published; the values published last are published again; nothing is published."""


class FaultParams(Record):
    """The fault of a sensor and when it has it; base of the parameters of all sensors."""

    fault: Annotated[int, "-", "0 none, 1 dead, 2 stuck, 3 noisy, 4 dropping samples", Bound(ge=0, le=4)] = 0
    fault_start_ns: Annotated[int, "ns", "first time of the fault"] = 0
    fault_stop_ns: Annotated[int, "ns", "time at which the fault is over; -1 for never"] = -1
    fault_noise: Annotated[float, "-", "factor on the white noise of a noisy sensor", Bound(ge=0)] = 10.0
    fault_drop: Annotated[float, "-", "probability that a dropping sensor loses a sample", Bound(ge=0, le=1)] = 0.5


class FaultState(Record):
    """Base of the states of all sensors."""

    noise: Stream = unseeded
    drops: Stream = unseeded


@compiled
def delivery(t_ns: int, params: Row, state: Row, seq: int) -> tuple[int, float]:
    """What becomes of the sample at ``t_ns``, and the factor on its white noise.

    Sensors draw their noise whatever this says, and losses are drawn from a stream of their own, so that a fault does
    not change what is measured after it.

    Args:
        t_ns: simulation time, ns.
        params: row of a `FaultParams`.
        state: row of a `FaultState`.
        seq: number of messages published so far; a sensor cannot hold what it never had.

    Returns:
        FRESH, HELD or NOTHING; factor.
    """
    fault = params.fault
    if fault == NONE or t_ns < params.fault_start_ns or 0 <= params.fault_stop_ns <= t_ns:
        return FRESH, 1.0
    if fault == NOISY:
        return FRESH, params.fault_noise
    if fault == STUCK and seq > 0:
        return HELD, 1.0
    if fault == DROPPING and uniform(state.drops) >= params.fault_drop:
        return FRESH, 1.0
    return NOTHING, 1.0
