"""HillPoint: reference attitude fixed in the Hill frame."""

from __future__ import annotations

from typing import Annotated

from fsw import In, KernelModule, Mat3, Out, Record, Row, eye, publish
from fsw.math.attitude import dcm_to_mrp
from fsw.math.checks import require_rotation
from fsw.math.vectors import cross, mat3, matmul, norm, store3, vec3
from messages.attitude import AttRefMsg
from messages.states import NavTransMsg
from modules.guidance.hill_point.kernel import hill_frame


class HillPoint(KernelModule):
    """Points the body along the Hill frame: radial, along track, normal. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        dcm_RH: Annotated[Mat3, "-", "constant attitude of the reference relative to the Hill frame"] = eye(3)

        def __post_init__(self) -> None:
            """Check that it is a rotation."""
            super().__post_init__()
            require_rotation(self, "dcm_RH")

    in_trans = In(NavTransMsg)
    out_ref = Out(AttRefMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_trans: Row, out_ref: Row) -> None:
        """Compute the reference of the newest position and velocity."""
        if in_trans.seq == 0:
            return
        r, v = vec3(in_trans.r_BN_N), vec3(in_trans.v_BN_N)
        if not norm(cross(r, v)) > 1e-9 * norm(r) * norm(v):
            raise ValueError("in_trans: position and velocity are parallel, zero or NaN: there is no orbital plane")
        dcm_HN, omega, domega = hill_frame(r, v)
        store3(out_ref.sigma_RN, dcm_to_mrp(matmul(mat3(params.dcm_RH), dcm_HN)))
        store3(out_ref.omega_RN_N, omega)
        store3(out_ref.domega_RN_N, domega)
        publish(out_ref, t_ns)
