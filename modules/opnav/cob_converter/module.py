"""CobConverter: direction of a body's centre from its centre of brightness."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.camera import LENS_SIZE
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, mat3, mat_t_vec, matmul, matvec, norm, store3, store33, transpose, unit, vec3
from messages.environment import EphemerisMsg
from messages.opnav import CameraConfigMsg, OpNavBrightnessMsg, OpNavDirectionMsg
from messages.states import NavAttMsg, NavTransMsg
from modules.opnav import relative
from modules.opnav.cob_converter.kernel import NONE, direction_covariance, direction_of_light


@compiled
def write_nothing(out: Row, status: int, exposure_ns: int, body_id: int) -> None:
    """An invalid direction with its reason."""
    out.exposure_ns, out.valid, out.status, out.body_id = exposure_ns, False, status, body_id
    for i in range(3):
        out.u_PC_N[i], out.u_PC_B[i], out.u_PC_C[i] = math.nan, math.nan, math.nan
        for j in range(3):
            out.P_uu_N[i, j], out.P_uu_B[i, j], out.P_uu_C[i, j] = math.nan, math.nan, math.nan


@compiled
def write_direction(out: Row, u_C: V3, P_C: M3, dcm_CB: M3, dcm_BN: M3, sigma_att: float) -> None:
    """Direction and covariance in C, B and N; the attitude's error [rad, each axis] goes to N only."""
    dcm_CN = matmul(dcm_CB, dcm_BN)
    u_N = mat_t_vec(dcm_CN, u_C)
    store3(out.u_PC_C, u_C)
    store3(out.u_PC_B, mat_t_vec(dcm_CB, u_C))
    store3(out.u_PC_N, u_N)
    store33(out.P_uu_C, P_C)
    store33(out.P_uu_B, relative.sandwich(transpose(dcm_CB), P_C))
    store33(out.P_uu_N, relative.sandwich(transpose(dcm_CN), P_C))
    for i in range(3):
        out.P_uu_N[i, i] += sigma_att * sigma_att
        for j in range(3):
            out.P_uu_N[i, j] -= sigma_att * sigma_att * u_N[i] * u_N[j]


class CobConverter(KernelModule):
    """Turns a centre of brightness into a direction. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        law: Annotated[
            int, "-", "how the body reflects: 0 no phase correction, 1 Lambert, 2 uniform", Bound(ge=0, le=2)
        ] = 1
        sigma_law: Annotated[float, "-", "relative standard deviation of the phase correction", Bound(ge=0)] = 0.1
        axes: Annotated[Vec3, "m", "semi-axes of the body along its x, y, z; zeros: as tabled", Bound(ge=0)] = zeros(3)
        max_phase: Annotated[float, "rad", "no direction beyond this phase angle", Bound(gt=0, lt=3.1)] = 2.6
        sigma_att: Annotated[float, "rad", "attitude error about each axis, goes to P_uu_N", Bound(ge=0)] = 0.0
        max_age: Annotated[float, "s", "largest time between attitude and exposure", Bound(ge=0)] = 10.0

    class State(Record):
        """What the next call needs."""

        seen: Annotated[int, "-", "seq of the last centre used"] = 0

    in_brightness = In(OpNavBrightnessMsg)
    in_camera = In(CameraConfigMsg)
    in_attitude = In(NavAttMsg)
    in_sun = In(EphemerisMsg, optional=True)
    in_trans = In(NavTransMsg, optional=True)
    out_direction = Out(OpNavDirectionMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_brightness: Row,
        in_camera: Row,
        in_attitude: Row,
        in_sun: Row,
        in_trans: Row,
        out_direction: Row,
    ) -> None:
        """Give a direction, or the reason why there is none, for each new centre of brightness."""
        if in_brightness.seq in (0, state.seen):
            return
        state.seen = in_brightness.seq
        when = in_brightness.exposure_ns
        write_nothing(out_direction, relative.VALID, when, in_brightness.body_id)
        publish(out_direction, t_ns)
        if not in_brightness.valid:
            out_direction.status = relative.NOTHING_FOUND
            return
        if in_camera.seq == 0 or in_attitude.seq == 0 or (params.law != NONE and in_sun.seq == 0):
            out_direction.status = relative.NO_INPUT
            return
        if relative.too_old(in_attitude, when, params.max_age):
            out_direction.status = relative.OLD_ATTITUDE
            return
        u, v, P_px = in_brightness.center_px[0], in_brightness.center_px[1], in_brightness.P_px
        a, b, c = P_px[0, 0], P_px[0, 1], P_px[1, 1]
        if not (math.isfinite(u + v + a + b + c) and a > 0.0 and c > 0.0 and a * c > b * b and P_px[1, 0] == b):
            out_direction.status = relative.BAD_NUMBERS
            return
        dcm_CB, dcm_BN = mat3(in_camera.dcm_CB), relative.attitude_at(in_attitude, when)
        sun_C, sin_rho = (0.0, 0.0, 0.0), 0.0
        if params.law != NONE:
            sun_C = matvec(matmul(dcm_CB, dcm_BN), unit(vec3(in_sun.r_PN_N)))
        if in_trans.seq != 0:
            axes = relative.semi_axes(in_brightness.body_id, vec3(params.axes))
            far = norm(vec3(in_trans.r_BN_N))
            mean = (axes[0] + axes[1] + axes[2]) / 3.0
            if not mean > 0.0:
                out_direction.status = relative.UNKNOWN_BODY
                return
            if not far > mean:
                out_direction.status = relative.NO_SOLUTION
                return
            sin_rho = mean / far
        elif params.law != NONE and not in_brightness.area_px > 0.0:
            out_direction.status = relative.BAD_NUMBERS
            return
        if not math.isfinite(norm(matvec(matmul(dcm_CB, dcm_BN), (1.0, 1.0, 1.0))) + norm(sun_C)):
            out_direction.status = relative.BAD_NUMBERS
            return
        lens, P = np.zeros(LENS_SIZE), np.zeros((3, 3))
        relative.lens_of(in_camera, lens)
        area = in_brightness.area_px
        status, u_C, dx, dy = direction_of_light(lens, u, v, params.law, sun_C, sin_rho, area, params.max_phase)
        if status != relative.VALID:
            out_direction.status = status
            return
        direction_covariance(lens, u_C, P_px, params.sigma_law * dx, params.sigma_law * dy, P)
        write_direction(out_direction, u_C, mat3(P), dcm_CB, dcm_BN, params.sigma_att)
        out_direction.valid = True
