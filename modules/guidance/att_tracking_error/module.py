"""AttTrackingError: how far body and reference differ."""

from __future__ import annotations

from typing import Annotated

from fsw import In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.attitude import mrp_compose, mrp_relative, mrp_to_dcm
from fsw.math.vectors import matvec, scale, store3, sub, vec3
from messages.attitude import AttGuidMsg, AttRefMsg
from messages.states import NavAttMsg


class AttTrackingError(KernelModule):
    """Attitude and rate error of the body relative to a reference. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        sigma_R0R: Annotated[
            Vec3, "-", "from the wanted body frame R to the frame R0 of the reference message, MRP"
        ] = zeros(3)

    in_att = In(NavAttMsg)
    in_ref = In(AttRefMsg)
    out_guid = Out(AttGuidMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_att: Row, in_ref: Row, out_guid: Row) -> None:
        """Compare the newest attitude with the newest reference."""
        if in_att.seq == 0 or in_ref.seq == 0:
            return
        sigma_BN = vec3(in_att.sigma_BN)
        sigma_RN = mrp_compose(scale(-1.0, vec3(params.sigma_R0R)), vec3(in_ref.sigma_RN))
        dcm_BN = mrp_to_dcm(sigma_BN)
        omega_RN_B = matvec(dcm_BN, vec3(in_ref.omega_RN_N))
        store3(out_guid.sigma_BR, mrp_relative(sigma_BN, sigma_RN))
        store3(out_guid.omega_BR_B, sub(vec3(in_att.omega_BN_B), omega_RN_B))
        store3(out_guid.omega_RN_B, omega_RN_B)
        store3(out_guid.domega_RN_B, matvec(dcm_BN, vec3(in_ref.domega_RN_N)))
        publish(out_guid, t_ns)
