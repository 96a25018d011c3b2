"""InertialPoint: a reference attitude at rest in N."""

from __future__ import annotations

from typing import Annotated

from fsw import KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.attitude import mrp_inner
from fsw.math.vectors import store3, vec3
from messages.attitude import AttRefMsg


class InertialPoint(KernelModule):
    """Holds the body at one attitude among the stars. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        sigma_RN: Annotated[Vec3, "-", "attitude of the reference relative to N, MRP of either set"] = zeros(3)

    out_ref = Out(AttRefMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_ref: Row) -> None:
        """Publish the attitude, at rest."""
        store3(out_ref.sigma_RN, mrp_inner(vec3(params.sigma_RN)))
        store3(out_ref.omega_RN_N, (0.0, 0.0, 0.0))
        store3(out_ref.domega_RN_N, (0.0, 0.0, 0.0))
        publish(out_ref, t_ns)
