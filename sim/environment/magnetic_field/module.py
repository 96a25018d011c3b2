"""Magnetic field: the geomagnetic reference field (IGRF-14 or WMM2025) at the spacecraft."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np

from fsw import F64, I64, Bound, In, KernelModule, Out, Record, Row, Shape, publish, zeros
from fsw.math.magnetic import COUNT, RADIUS, harmonic_field
from fsw.math.vectors import mat3, mat_t_vec, matvec, store3, vec3
from messages.environment import MagneticFieldMsg, PlanetOrientationMsg
from messages.states import SCStatesMsg
from sim.environment.magnetic_field.models import YEARS, Model, igrf14, yearly_table

_NO_TIMES: I64 = np.zeros(YEARS, np.int64)


class MagneticField(KernelModule):
    """The main field of the Earth from Gauss coefficients that change with time. See SPEC.md."""

    class Params(Record):
        """Parameters; `of_model` makes them for a model other than IGRF-14."""

        epoch_tai_ns: Annotated[int, "ns", "simulation time zero, TAI since 2000-01-01T12:00:00 TAI"] = 0
        radius: Annotated[float, "m", "reference radius of the coefficients", Bound(gt=0)] = RADIUS
        degree: Annotated[int, "-", "highest degree", Bound(ge=1, le=13)] = 13
        nodes_tai_ns: Annotated[
            I64, Shape(YEARS), "ns", "instants of the tables, ascending; the last one is repeated"
        ] = _NO_TIMES
        g: Annotated[F64, Shape(YEARS, COUNT), "T", "cosine coefficients at the nodes, scaled"] = zeros(YEARS, COUNT)
        h: Annotated[F64, Shape(YEARS, COUNT), "T", "sine coefficients at the nodes, scaled"] = zeros(YEARS, COUNT)

        def __post_init__(self) -> None:
            """Fill the tables from IGRF-14 where none are given."""
            if not np.any(self.nodes_tai_ns):
                for name, table in zip(("nodes_tai_ns", "g", "h"), _table(igrf14(), self.epoch_tai_ns), strict=True):
                    msgspec.structs.force_setattr(self, name, table)
            super().__post_init__()

    class State(Record):
        """Coefficients at the last time."""

        g: Annotated[F64, Shape(COUNT), "T", "cosine coefficients now, scaled"] = zeros(COUNT)
        h: Annotated[F64, Shape(COUNT), "T", "sine coefficients now, scaled"] = zeros(COUNT)

    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_field = Out(MagneticFieldMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_orientation: Row, out_field: Row) -> None:
        """Field at the newest position and orientation."""
        if in_state.seq == 0 or in_orientation.seq == 0:
            return
        now = params.epoch_tai_ns + t_ns
        if now < params.nodes_tai_ns[0]:
            raise ValueError("epoch_tai_ns: the time is before the first instant of the coefficients, nodes_tai_ns[0]")
        k = 0
        while k + 1 < YEARS and params.nodes_tai_ns[k + 1] > params.nodes_tai_ns[k]:
            if now <= params.nodes_tai_ns[k + 1]:
                break
            k += 1
        if k + 1 == YEARS or params.nodes_tai_ns[k + 1] <= params.nodes_tai_ns[k]:
            raise ValueError("epoch_tai_ns: the time is after the validity of the coefficients; take a newer model")
        span = params.nodes_tai_ns[k + 1] - params.nodes_tai_ns[k]
        w = (now - params.nodes_tai_ns[k]) / span
        g0, g1, h0, h1 = params.g[k], params.g[k + 1], params.h[k], params.h[k + 1]
        g, h = state.g, state.h
        for i in range(COUNT):
            g[i] = g0[i] + w * (g1[i] - g0[i])
            h[i] = h0[i] + w * (h1[i] - h0[i])
        dcm_EN = mat3(in_orientation.dcm_EN)
        r_BN_E = matvec(dcm_EN, vec3(in_state.r_BN_N))
        b = harmonic_field(r_BN_E, params.radius, params.degree, g, h)
        if not math.isfinite(b[0] + b[1] + b[2]):
            raise ValueError(
                "in_state.r_BN_N, in_orientation.dcm_EN: expected finite numbers and a position that is not 0"
            )
        store3(out_field.B_N, mat_t_vec(dcm_EN, b))
        publish(out_field, t_ns)


def _table(model: Model, epoch_tai_ns: int) -> tuple[I64, F64, F64]:
    try:
        return yearly_table(model, epoch_tai_ns)
    except ValueError as error:
        raise ValueError(f"MagneticField.Params.{error}") from None


def of_model(model: Model, epoch_tai_ns: int, degree: int = 0) -> MagneticField.Params:
    """Parameters for a model read from a file.

    Args:
        model: from `read_shc`, `read_cof`, `igrf14` or `wmm2025`.
        epoch_tai_ns: simulation time zero, TAI nanoseconds since 2000-01-01T12:00:00 TAI.
        degree: highest degree used; 0 for that of the model.

    Raises:
        ValueError: if the epoch is outside the validity of the model, or the model has no such degree.
    """
    if not 0 <= degree <= model.degree:
        raise ValueError(f"MagneticField.Params.degree: {model.name} has degree {model.degree}, got {degree}")
    times, g, h = _table(model, epoch_tai_ns)
    return MagneticField.Params(epoch_tai_ns=epoch_tai_ns, degree=degree or model.degree, nodes_tai_ns=times, g=g, h=h)
