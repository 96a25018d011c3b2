"""HorizonNav: position of the camera relative to a body from points of its limb."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.camera import LENS_SIZE
from fsw.math.vectors import axpy, dot, mat3, matmul, matvec, norm, scale, transpose, vec3
from messages.environment import PlanetOrientationMsg
from messages.opnav import MAX_MODES, CameraConfigMsg, OpNavLimbMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.opnav import relative
from modules.opnav.horizon_nav.compat import basilisk_position
from modules.opnav.horizon_nav.kernel import MIN_POINTS, RAY, fit, local_frame, position, rays_of, shared

STRAIGHT = 400.0
"""n . n of a limb so straight (angular radius above 87 degrees) that it is more likely an edge of something else."""


class HorizonNav(KernelModule):
    """Fits the limb of an ellipsoid to points of an image. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        basilisk: Annotated[bool, "-", "reproduce Basilisk's horizonOpNav, errors included"] = False
        noise_factor: Annotated[float, "-", "on the sigma of the points; Basilisk's noiseSF", Bound(gt=0)] = 1.0
        axes: Annotated[Vec3, "m", "semi-axes of the body along its x, y, z; zeros: as tabled", Bound(ge=0)] = zeros(3)
        limb_height: Annotated[float, "m", "height above the surface of what looks like the limb"] = 0.0
        pole_N: Annotated[Vec3, "-", "pole of a spheroid, N; used without in_orientation"] = zeros(3)
        robust: Annotated[bool, "-", "leave out points that disagree with most"] = True
        gate: Annotated[float, "-", "standard deviations at which a point disagrees", Bound(gt=0)] = 4.0
        min_share: Annotated[float, "-", "least part of the points that must agree", Bound(ge=0, le=1)] = 0.6
        max_sigma: Annotated[float, "-", "largest relative standard deviation of the distance", Bound(gt=0)] = 0.1
        sigma_att: Annotated[float, "rad", "attitude error about each axis, goes to P_rr_N", Bound(ge=0)] = 0.0
        max_age: Annotated[float, "s", "largest time between attitude and exposure", Bound(ge=0)] = 10.0

    class State(Record):
        """What the next call needs."""

        seen: Annotated[int, "-", "seq of the last limb used"] = 0
        target: Annotated[int, "-", "body of the last limb; Basilisk uses it one call late"] = 0

    in_limb = In(OpNavLimbMsg)
    in_camera = In(CameraConfigMsg)
    in_attitude = In(NavAttMsg)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    out_position = Out(OpNavMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_limb: Row,
        in_camera: Row,
        in_attitude: Row,
        in_orientation: Row,
        out_position: Row,
    ) -> None:
        """Give a position, or the reason why there is none, for each new limb."""
        if in_limb.seq == 0 or (in_limb.seq == state.seen and not params.basilisk):
            return
        state.seen = in_limb.seq
        when, body_id, count = in_limb.exposure_ns, in_limb.body_id, in_limb.count
        relative.write_nothing(out_position, relative.VALID, when, body_id, 0.0 if params.basilisk else math.nan)
        publish(out_position, t_ns)
        if not in_limb.valid:
            out_position.status = relative.NOTHING_FOUND
            return
        if in_camera.seq == 0 or in_attitude.seq == 0:
            out_position.status = relative.NO_INPUT
            return
        dcm_CB = mat3(in_camera.dcm_CB)
        if params.basilisk:
            target = state.target if state.target != 0 else body_id
            state.target = body_id
            if count < 3 or target not in (399, 499, 599):
                out_position.status = relative.TOO_FEW if count < 3 else relative.UNKNOWN_BODY
                return
            dcm_BN = mrp_to_dcm(vec3(in_attitude.sigma_BN))
            r, P = basilisk_position(
                target,
                matmul(dcm_CB, dcm_BN),
                in_limb.limb_px,
                count,
                in_camera.width_px,
                in_camera.height_px,
                in_camera.focal_px[0],
                in_camera.focal_px[1],
                params.noise_factor,
            )
            if not math.isfinite(dot(r, r)):
                out_position.status = relative.NO_SOLUTION
                return
            out_position.body_id = target
            relative.write_position(out_position, r, P, dcm_CB, dcm_BN, 0.0)
            out_position.valid = True
            return

        a, b, c = relative.semi_axes(body_id, vec3(params.axes))
        a, b, c = a + params.limb_height, b + params.limb_height, c + params.limb_height
        if not (a > 0.0 and b > 0.0 and c > 0.0):
            out_position.status = relative.UNKNOWN_BODY
            return
        if count < MIN_POINTS:
            out_position.status = relative.TOO_FEW
            return
        if relative.too_old(in_attitude, when, params.max_age):
            out_position.status = relative.OLD_ATTITUDE
            return
        dcm_BN = relative.attitude_at(in_attitude, when)
        dcm_CN = matmul(dcm_CB, dcm_BN)
        dcm_EC = dcm_CB
        pole = vec3(params.pole_N)
        if a == b and b == c:
            dcm_EC = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        elif in_orientation.seq != 0:
            dcm_EC = matmul(relative.orientation_at(in_orientation, when), transpose(dcm_CN))
        elif a == b and norm(pole) > 0.0:
            dcm_EC = matmul(relative.pole_frame(pole), transpose(dcm_CN))
        else:
            out_position.status = relative.NO_ORIENTATION
            return
        if not math.isfinite(norm(matvec(dcm_EC, matvec(dcm_CN, (1.0, 1.0, 1.0))))):
            out_position.status = relative.BAD_NUMBERS
            return

        lens, rays, inv = np.zeros(LENS_SIZE), np.zeros((count, RAY)), np.zeros((3, 3))
        relative.lens_of(in_camera, lens)
        status = rays_of(lens, in_limb.limb_px, in_limb.sigma_px, count, params.noise_factor, rays)
        if status != relative.VALID:
            out_position.status = status
            return
        B = (scale(1.0 / a, dcm_EC[0]), scale(1.0 / b, dcm_EC[1]), scale(1.0 / c, dcm_EC[2]))
        B = local_frame(B, rays, count)
        status, n, chi2, kept = fit(B, rays, params.robust, params.gate, params.min_share, inv)
        if status == relative.VALID and not dot(n, n) < STRAIGHT:
            status = relative.NO_SOLUTION
        if status != relative.VALID:
            out_position.status = status
            return
        dof, more = kept - 3, 1.0
        if dof > 0 and chi2 / dof > 1.0 + 4.0 * math.sqrt(2.0 / dof):  # noise that large does not happen by chance
            more = chi2 / dof
        P_n = mat3(inv)
        alone, pushes = P_n, np.zeros((3, MAX_MODES + 1))
        shared(B, n, rays, params.gate, in_limb.common_px, in_limb.modes_px, pushes)
        P_n = (scale(more, P_n[0]), scale(more, P_n[1]), scale(more, P_n[2]))
        for j in range(MAX_MODES + 1):
            push = (pushes[0, j], pushes[1, j], pushes[2, j])
            out = (dot(alone[0], push), dot(alone[1], push), dot(alone[2], push))
            P_n = (axpy(out[0], out, P_n[0]), axpy(out[1], out, P_n[1]), axpy(out[2], out, P_n[2]))
        r, P = position(B, n, P_n)
        if not dot(r, matvec(P, r)) <= (params.max_sigma * dot(r, r)) ** 2:
            out_position.status = relative.TOO_UNSURE
            return
        relative.write_position(out_position, r, P, dcm_CB, dcm_BN, params.sigma_att)
        out_position.valid = True
