"""FaultDetection: compares two positions from one image, and gives one of them, both together, or none."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Out, Record, Row, publish
from fsw.math.attitude import mrp_to_dcm
from fsw.math.compiled import compiled
from fsw.math.vectors import dot, mat3, norm, scale, store3, store33, sub, vec3
from messages.opnav import CameraConfigMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.opnav import relative
from modules.opnav.fault_detection.kernel import distance2, frobenius, merged, positive

MERGED, PRIMARY, BOTH = 0, 1, 2
NONE, FIRST, SECOND = 0, 1, 2
FAULT = 20
"""Status: both are valid and disagree."""
ALONE = 21
"""Status: only one is valid, and the mode does not accept it alone."""
OTHER_BODY = 22
"""Status: the two are relative to different bodies."""


@compiled
def passed_on(out: Row, given: Row) -> None:
    """Copy a position."""
    out.exposure_ns, out.valid, out.status = given.exposure_ns, given.valid, given.status
    out.fault_detected, out.body_id = given.fault_detected, given.body_id
    store3(out.r_CP_N, vec3(given.r_CP_N))
    store3(out.r_CP_B, vec3(given.r_CP_B))
    store3(out.r_CP_C, vec3(given.r_CP_C))
    store33(out.P_rr_N, mat3(given.P_rr_N))
    store33(out.P_rr_B, mat3(given.P_rr_B))
    store33(out.P_rr_C, mat3(given.P_rr_C))


class FaultDetection(KernelModule):
    """Compares the positions of two image chains. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        basilisk: Annotated[bool, "-", "reproduce Basilisk's faultDetection"] = False
        mode: Annotated[
            int, "-", "0 merge, 1 the primary if it is valid, 2 the primary if both are", Bound(ge=0, le=2)
        ] = 0
        gate: Annotated[float, "-", "largest squared Mahalanobis distance; 16.27 lets 99.9 % pass", Bound(gt=0)] = 16.27
        on_fault: Annotated[
            int, "-", "given on a fault: 0 nothing, 1 the primary, 2 the secondary", Bound(ge=0, le=2)
        ] = 0
        independent: Annotated[bool, "-", "errors are independent; if not, the covariance of a merge is doubled"] = True
        sigma_fault: Annotated[float, "-", "Basilisk's sigmaFault", Bound(gt=0)] = 3.0
        sigma_att: Annotated[float, "rad", "attitude error about each axis, goes to a merged P_rr_N", Bound(ge=0)] = 0.0
        max_age: Annotated[float, "s", "largest time between attitude and exposure", Bound(ge=0)] = 10.0

    class State(Record):
        """What the next call needs."""

        seen_primary: Annotated[int, "-", "seq of the last primary used"] = 0
        seen_secondary: Annotated[int, "-", "seq of the last secondary used"] = 0

    in_primary = In(OpNavMsg)
    in_secondary = In(OpNavMsg)
    in_camera = In(CameraConfigMsg)
    in_attitude = In(NavAttMsg)
    out_position = Out(OpNavMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_primary: Row,
        in_secondary: Row,
        in_camera: Row,
        in_attitude: Row,
        out_position: Row,
    ) -> None:
        """Judge the newest pair, once."""
        if in_primary.seq == 0 and in_secondary.seq == 0:
            return
        fresh = in_primary.seq != state.seen_primary or in_secondary.seq != state.seen_secondary
        if not fresh and not params.basilisk:
            return
        state.seen_primary, state.seen_secondary = in_primary.seq, in_secondary.seq
        one = in_primary.seq != 0 and in_primary.valid
        two = in_secondary.seq != 0 and in_secondary.valid
        r1, P1 = vec3(in_primary.r_CP_C), mat3(in_primary.P_rr_C)
        r2, P2 = vec3(in_secondary.r_CP_C), mat3(in_secondary.P_rr_C)
        when, body_id, bad = in_primary.exposure_ns, in_primary.body_id, relative.NOTHING_FOUND
        if in_primary.seq == 0:
            when, body_id = in_secondary.exposure_ns, in_secondary.body_id
        if not params.basilisk:
            if in_primary.seq != 0 and in_secondary.seq != 0:
                # of two images the older one is over; its position says nothing of the newer one's
                one = one and in_primary.exposure_ns >= in_secondary.exposure_ns
                two = two and in_secondary.exposure_ns >= in_primary.exposure_ns
                if in_secondary.exposure_ns > when:
                    when, body_id = in_secondary.exposure_ns, in_secondary.body_id
            if one and not (math.isfinite(norm(r1)) and positive(P1)):
                one, bad = False, relative.BAD_NUMBERS
            if two and not (math.isfinite(norm(r2)) and positive(P2)):
                two, bad = False, relative.BAD_NUMBERS
        relative.write_nothing(out_position, bad, when, body_id, 0.0 if params.basilisk else math.nan)
        publish(out_position, t_ns)
        if not one and not two:
            return
        if not (one and two):
            if one and params.mode != BOTH:
                passed_on(out_position, in_primary)
            elif two and params.mode == MERGED:
                passed_on(out_position, in_secondary)
            else:
                out_position.status = ALONE
            return
        if not params.basilisk and in_primary.body_id != in_secondary.body_id:
            out_position.status = OTHER_BODY
            return
        if params.basilisk:
            fault = norm(sub(r2, r1)) > params.sigma_fault * math.sqrt(frobenius(P1) + frobenius(P2))
        else:
            fault = not distance2(r1, P1, r2, P2) <= params.gate
        if fault:
            choice = SECOND if params.basilisk else params.on_fault
            if choice == FIRST:
                passed_on(out_position, in_primary)
            elif choice == SECOND:
                passed_on(out_position, in_secondary)
            else:
                out_position.status = FAULT
            out_position.fault_detected = True
            return
        if params.mode != MERGED:
            passed_on(out_position, in_primary)
            return
        if in_camera.seq == 0 or in_attitude.seq == 0:
            out_position.status = relative.NO_INPUT
            return
        if not params.basilisk and relative.too_old(in_attitude, when, params.max_age):
            out_position.status = relative.OLD_ATTITUDE
            return
        dcm_BN = mrp_to_dcm(vec3(in_attitude.sigma_BN))
        if not params.basilisk:
            dcm_BN = relative.attitude_at(in_attitude, when)
        r, P = merged(r1, P1, r2, P2)
        if not (params.basilisk or params.independent):
            # equal weights in covariance intersection: right for any correlation
            P = (scale(2.0, P[0]), scale(2.0, P[1]), scale(2.0, P[2]))
        if not math.isfinite(dot(r, r)):
            out_position.status = relative.BAD_NUMBERS
            return
        relative.write_position(out_position, r, P, mat3(in_camera.dcm_CB), dcm_BN, params.sigma_att)
        out_position.valid, out_position.status = True, relative.VALID
        out_position.fault_detected = False
