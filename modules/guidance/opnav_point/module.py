"""OpNavPoint: turns the camera to the body that optical navigation has found."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.vectors import mat3, mat_t_vec, matvec, norm, scale, store3, sub, unit, vec3
from messages.attitude import AttGuidMsg
from messages.opnav import CameraConfigMsg, OpNavDirectionMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.guidance.alignment import alignment_error

BORESIGHT = np.array([0.0, 0.0, 1.0])
BORESIGHT.setflags(write=False)


class OpNavPoint(KernelModule):
    """Points an axis of the camera at a measured body, and searches if there is none. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        align_axis_C: Annotated[Vec3, "-", "axis to point, any length, camera components"] = BORESIGHT
        timeout: Annotated[float, "s", "how long an old direction is pointed at", Bound(gt=0)] = 100.0
        spin_rate: Annotated[float, "rad/s", "wanted rate about the direction"] = 0.0
        search_rate_B: Annotated[Vec3, "rad/s", "wanted rate while there is no direction, B components"] = zeros(3)
        small_angle: Annotated[float, "rad", "error that counts as none", Bound(gt=0, lt=0.1)] = 1e-6

        def __post_init__(self) -> None:
            """Check the axis too."""
            super().__post_init__()
            if not np.linalg.norm(self.align_axis_C) > 0.1:
                text = f"expected a vector longer than 0.1, got {self.align_axis_C.tolist()}"
                raise ValueError(f"OpNavPoint.Params.align_axis_C: {text}")

    class State(Record):
        """The last direction."""

        heading_N: Annotated[Vec3, "-", "unit vector to the body, N components"] = zeros(3)
        exposure_ns: Annotated[int, "ns", "time of its image; -1 for none"] = -1

    in_att = In(NavAttMsg)
    in_camera = In(CameraConfigMsg)
    in_position = In(OpNavMsg, optional=True)
    in_direction = In(OpNavDirectionMsg, optional=True)
    out_guid = Out(AttGuidMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_att: Row,
        in_camera: Row,
        in_position: Row,
        in_direction: Row,
        out_guid: Row,
    ) -> None:
        """Take over a newer measurement, and write the error."""
        if in_position.seq > 0 and in_position.valid and in_position.exposure_ns > state.exposure_ns:
            away = vec3(in_position.r_CP_N)
            if math.isfinite(norm(away)) and norm(away) > 0.0:
                store3(state.heading_N, scale(-1.0 / norm(away), away))
                state.exposure_ns = in_position.exposure_ns
        if in_direction.seq > 0 and in_direction.valid and in_direction.exposure_ns > state.exposure_ns:
            there = unit(vec3(in_direction.u_PC_N))
            if math.isfinite(there[0]):
                store3(state.heading_N, there)
                state.exposure_ns = in_direction.exposure_ns
        if in_att.seq == 0 or in_camera.seq == 0:
            return
        omega_BN, dcm_BN = vec3(in_att.omega_BN_B), mrp_to_dcm(vec3(in_att.sigma_BN))
        axis_B = mat_t_vec(mat3(in_camera.dcm_CB), unit(vec3(params.align_axis_C)))
        if not math.isfinite(norm(omega_BN) + norm(matvec(dcm_BN, axis_B))):
            return
        sigma, omega_RN = (0.0, 0.0, 0.0), vec3(params.search_rate_B)
        if state.exposure_ns >= 0 and (t_ns - state.exposure_ns) / 1e9 < params.timeout:
            heading_B = matvec(dcm_BN, vec3(state.heading_N))
            sigma = alignment_error(axis_B, heading_B, params.small_angle)
            omega_RN = scale(params.spin_rate, heading_B)
        store3(out_guid.sigma_BR, sigma)
        store3(out_guid.omega_RN_B, omega_RN)
        store3(out_guid.omega_BR_B, sub(omega_BN, omega_RN))
        store3(out_guid.domega_RN_B, (0.0, 0.0, 0.0))
        publish(out_guid, t_ns)
