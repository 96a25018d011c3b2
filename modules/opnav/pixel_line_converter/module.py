"""PixelLineConverter: position of the camera relative to a body from the circle of its disk."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.camera import LENS_SIZE
from fsw.math.vectors import dot, mat3, matmul, matvec, norm, transpose, unit, vec3
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, OpNavCirclesMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.opnav import relative
from modules.opnav.pixel_line_converter.kernel import basilisk_line, covariance, position_of_circle


class PixelLineConverter(KernelModule):
    """Turns the first circle of a finder into a position. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        basilisk: Annotated[bool, "-", "reproduce Basilisk's pixelLineConverter, errors included"] = False
        axes: Annotated[Vec3, "m", "semi-axes of the body along its x, y, z; zeros: as tabled", Bound(ge=0)] = zeros(3)
        pole_N: Annotated[Vec3, "-", "pole of a spheroid, N; used without in_orientation"] = zeros(3)
        lit_half: Annotated[bool, "-", "the circle goes through the lit part of the limb only; needs in_sun"] = False
        max_sigma: Annotated[float, "-", "largest relative standard deviation of the distance", Bound(gt=0)] = 0.3
        sigma_att: Annotated[float, "rad", "attitude error about each axis, goes to P_rr_N", Bound(ge=0)] = 0.0
        max_age: Annotated[float, "s", "largest time between attitude and exposure", Bound(ge=0)] = 10.0

    class State(Record):
        """What the next call needs."""

        seen: Annotated[int, "-", "seq of the last circles used"] = 0
        target: Annotated[int, "-", "body of the last valid circle"] = 0

    in_circles = In(OpNavCirclesMsg)
    in_camera = In(CameraConfigMsg)
    in_attitude = In(NavAttMsg)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    in_sun = In(EphemerisMsg, optional=True)
    out_position = Out(OpNavMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_circles: Row,
        in_camera: Row,
        in_attitude: Row,
        in_orientation: Row,
        in_sun: Row,
        out_position: Row,
    ) -> None:
        """Give a position, or the reason why there is none, for each new set of circles."""
        if in_circles.seq == 0 or (in_circles.seq == state.seen and not params.basilisk):
            return
        state.seen = in_circles.seq
        when, body_id = in_circles.exposure_ns, in_circles.body_id
        relative.write_nothing(out_position, relative.VALID, when, body_id, 0.0 if params.basilisk else math.nan)
        publish(out_position, t_ns)
        if not in_circles.valid or in_circles.count < 1:
            out_position.status = relative.NOTHING_FOUND
            return
        state.target = body_id
        if in_camera.seq == 0 or in_attitude.seq == 0:
            out_position.status = relative.NO_INPUT
            return
        circle = (in_circles.center_px[0, 0], in_circles.center_px[0, 1], in_circles.radius_px[0])
        U = mat3(in_circles.P_px[0])
        dcm_CB = mat3(in_camera.dcm_CB)
        if params.basilisk:
            dcm_BN = mrp_to_dcm(vec3(in_attitude.sigma_BN))
            w, h, f = in_camera.width_px, in_camera.height_px, in_camera.focal_px
            r, P = basilisk_line(body_id, w, h, f[0], f[1], circle, U)
            if not (circle[2] > 0.0 and math.isfinite(dot(r, r))):
                out_position.status = relative.UNKNOWN_BODY if circle[2] > 0.0 else relative.BAD_NUMBERS
                return
            relative.write_position(out_position, r, P, dcm_CB, dcm_BN, 0.0)
            out_position.valid = True
            return

        axes = relative.semi_axes(body_id, vec3(params.axes))
        if not axes[0] > 0.0:
            out_position.status = relative.UNKNOWN_BODY
            return
        spare = np.zeros((3, 3))
        if not (math.isfinite(circle[0] + circle[1] + circle[2]) and circle[2] > 0.0) or not relative.invert_spd(
            in_circles.P_px[0], spare
        ):
            out_position.status = relative.BAD_NUMBERS
            return
        if relative.too_old(in_attitude, when, params.max_age):
            out_position.status = relative.OLD_ATTITUDE
            return
        dcm_BN = relative.attitude_at(in_attitude, when)
        dcm_CN = matmul(dcm_CB, dcm_BN)
        sun_C = (0.0, 0.0, 0.0)
        if params.lit_half:
            if in_sun.seq == 0:
                out_position.status = relative.NO_INPUT
                return
            sun_C = matvec(dcm_CN, unit(vec3(in_sun.r_PN_N)))
        dcm_EC, pole, shape = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), vec3(params.pole_N), 0.0
        if not (axes[0] == axes[1] and axes[1] == axes[2]):
            if in_orientation.seq != 0:
                dcm_EC = matmul(relative.orientation_at(in_orientation, when), transpose(dcm_CN))
            elif axes[0] == axes[1] and norm(pole) > 0.0:
                dcm_EC = matmul(relative.pole_frame(pole), transpose(dcm_CN))
            else:  # a sphere of the mean radius, which is that uncertain
                mean = (axes[0] + axes[1] + axes[2]) / 3.0
                least = min(axes[0], axes[1], axes[2])
                shape = (max(axes[0], axes[1], axes[2]) - least) / mean / math.sqrt(12.0)
                axes = (mean, mean, mean)
        if not math.isfinite(norm(matvec(dcm_EC, matvec(dcm_CN, (1.0, 1.0, 1.0)))) + norm(sun_C)):
            out_position.status = relative.BAD_NUMBERS
            return
        lens = np.zeros(LENS_SIZE)
        relative.lens_of(in_camera, lens)
        status, r, J = position_of_circle(lens, axes, dcm_EC, sun_C, circle)
        if status != relative.VALID:
            out_position.status = status
            return
        P, s2 = covariance(J, U), shape * shape
        P = (
            (P[0][0] + s2 * r[0] * r[0], P[0][1] + s2 * r[0] * r[1], P[0][2] + s2 * r[0] * r[2]),
            (P[1][0] + s2 * r[1] * r[0], P[1][1] + s2 * r[1] * r[1], P[1][2] + s2 * r[1] * r[2]),
            (P[2][0] + s2 * r[2] * r[0], P[2][1] + s2 * r[2] * r[1], P[2][2] + s2 * r[2] * r[2]),
        )
        if not dot(r, matvec(P, r)) <= (params.max_sigma * dot(r, r)) ** 2:
            out_position.status = relative.TOO_UNSURE
            return
        relative.write_position(out_position, r, P, dcm_CB, dcm_BN, params.sigma_att)
        out_position.valid = True
