"""Ephemeris: where the Sun, the Moon or a planet is."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np

from fsw import F64, Bound, KernelModule, Out, Record, Row, Shape, publish, zeros
from fsw.math.ephemeris import (
    ORDER,
    SEGMENT_NS,
    Position,
    chebyshev_fit,
    chebyshev_state,
    chebyshev_table,
    known_body,
)
from fsw.math.vectors import store3
from messages.environment import EphemerisMsg

SEGMENTS = 100


class Ephemeris(KernelModule):
    """Position and velocity of one body from Chebyshev polynomials. See SPEC.md."""

    class Params(Record):
        """Parameters; the table is made when it is not given."""

        body_id: Annotated[int, "-", "NAIF identifier of the body: 10 Sun, 301 Moon, 499 Mars"] = 10
        center_id: Annotated[int, "-", "NAIF identifier of the central body, the origin of N"] = 399
        epoch_tai_ns: Annotated[int, "ns", "simulation time zero, TAI since 2000-01-01T12:00:00 TAI"] = 0
        span: Annotated[float, "s", "covered from time zero on, at most 400 days", Bound(gt=0, le=34560000.0)] = (
            2764800.0
        )
        mu: Annotated[float, "m^3/s^2", "gravitational parameter; 0 for that of the table of bodies", Bound(ge=0)] = 0.0
        radius: Annotated[float, "m", "radius; 0 for that of the table of bodies", Bound(ge=0)] = 0.0
        table: Annotated[F64, Shape(SEGMENTS, ORDER, 3), "m", "Chebyshev coefficients, four days each"] = zeros(
            SEGMENTS, ORDER, 3
        )

        def __post_init__(self) -> None:
            """Check the bodies, and make the table if none is given."""
            where = "Ephemeris.Params."
            body = known_body(self.body_id, f"{where}body_id")
            known_body(self.center_id, f"{where}center_id")
            if self.body_id == self.center_id:
                raise ValueError(f"{where}body_id: expected another body than center_id, got {self.body_id} for both")
            if not self.mu:
                msgspec.structs.force_setattr(self, "mu", body.mu)
            if not self.radius:
                msgspec.structs.force_setattr(self, "radius", body.radius)
            if not np.any(self.table) and 0.0 < self.span <= SEGMENTS * SEGMENT_NS / 1e9:
                segments, table = math.ceil(self.span * 1e9 / SEGMENT_NS), np.zeros((SEGMENTS, ORDER, 3))
                try:
                    table[:segments] = chebyshev_table(self.body_id, self.center_id, self.epoch_tai_ns, segments)
                except ValueError as error:
                    raise ValueError(f"{where}{error}") from None
                msgspec.structs.force_setattr(self, "table", table)
            super().__post_init__()

    out_ephemeris = Out(EphemerisMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_ephemeris: Row) -> None:
        """Evaluate the polynomial of the time."""
        if t_ns < 0 or t_ns > params.span * 1e9:
            raise ValueError("span: the time is outside of the table; make Ephemeris.Params with a longer span")
        segment = min(t_ns // SEGMENT_NS, SEGMENTS - 1)
        x = 2.0 * ((t_ns - segment * SEGMENT_NS) / SEGMENT_NS) - 1.0
        r, v = chebyshev_state(params.table, segment, x, 2e9 / SEGMENT_NS)
        out_ephemeris.body_id = params.body_id
        out_ephemeris.mu = params.mu
        out_ephemeris.radius = params.radius
        store3(out_ephemeris.r_PN_N, r)
        store3(out_ephemeris.v_PN_N, v)
        publish(out_ephemeris, t_ns)


def of_positions(
    position: Position, body_id: int, epoch_tai_ns: int, span: float, center_id: int = 399
) -> Ephemeris.Params:
    """Parameters for positions from elsewhere, such as an ephemeris of JPL.

    Args:
        position: takes two parts of n Julian dates in TT (n,), (n,); returns positions (n, 3) relative to the central
            body, m, axes of the GCRF. Asked for whole segments of four days, so up to four days after the span.
        body_id: NAIF identifier of the body.
        epoch_tai_ns: simulation time zero, TAI ns since 2000-01-01T12:00:00 TAI.
        span: covered from time zero on, s, at most 400 days.
        center_id: NAIF identifier of the central body.

    Raises:
        ValueError: if a parameter is wrong, or positions are not (n, 3) or not finite.
    """
    segments = min(max(math.ceil(span * 1e9 / SEGMENT_NS), 1), SEGMENTS)
    table = np.zeros((SEGMENTS, ORDER, 3))
    table[:segments] = chebyshev_fit(position, epoch_tai_ns, segments)
    return Ephemeris.Params(body_id=body_id, center_id=center_id, epoch_tai_ns=epoch_tai_ns, span=span, table=table)
