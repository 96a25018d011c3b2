"""LandmarkOracle: places of the ground that the camera sees, known from the true pose instead of from an image."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, Stream, Vec3, eye, publish, unseeded, zeros
from fsw.math.attitude import mrp_to_dcm, rotvec_to_dcm
from fsw.math.camera import LENS_SIZE, lens_vector, undistort_point
from fsw.math.checks import require_rotation
from fsw.math.geodesy import ecef_from_geodetic, ray_to_height
from fsw.math.random import normal, uniform
from fsw.math.vectors import add, axpy, mat3, mat_t_vec, matmul, matvec, scale, unit, vec3
from messages.environment import PlanetOrientationMsg
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, LandmarksMsg
from messages.states import SCStatesMsg


class LandmarkOracle(KernelModule):
    """Ray casting from the true pose: true matches with noise, false ones, map errors. See SPEC.md."""

    class Params(Record):
        """Parameters; `of_camera` makes the first five."""

        lens: Annotated[F64, Shape(LENS_SIZE), "-", "lens vector of fsw.math.camera"]
        width_px: Annotated[int, "px", "columns of the image", Bound(gt=0)] = 1024
        height_px: Annotated[int, "px", "rows of the image", Bound(gt=0)] = 1024
        dcm_CB: Annotated[Mat3, "-", "mounting: maps body to camera components"] = eye(3)
        r_CB_B: Annotated[Vec3, "m", "position of the camera relative to B, B components"] = zeros(3)
        count: Annotated[int, "-", "places looked at in each image", Bound(ge=1, le=MAX_LANDMARKS)] = 50
        sigma_px: Annotated[float, "px", "noise of each coordinate of a match", Bound(gt=0)] = 0.5
        sigma_map: Annotated[float, "m", "error of each coordinate of a place on the map", Bound(ge=0)] = 0.0
        bias_map_E: Annotated[Vec3, "m", "error that all places share, E components"] = zeros(3)
        sigma_height: Annotated[float, "m", "standard deviation of the terrain's height", Bound(ge=0)] = 0.0
        outliers: Annotated[float, "-", "share of matches that are false: anywhere in the image", Bound(ge=0, le=1)] = (
            0.0
        )
        clear: Annotated[float, "-", "share of images without cloud; the others give nothing", Bound(ge=0, le=1)] = 1.0
        row_time: Annotated[float, "s", "from the exposure of a row to that of the next: rolling shutter"] = 0.0

        def __post_init__(self) -> None:
            """Check lens and mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_CB")
            if not (self.lens[0] > 0.0 and self.lens[1] > 0.0):
                text = "expected the lens vector of a camera; make it with of_camera(camera)"
                raise ValueError(f"LandmarkOracle.Params.lens: {text}, got {self.lens.tolist()}")

    class State(Record):
        """Random streams: one for what is seen, one for what is false or hidden."""

        noise: Stream = unseeded
        faults: Stream = unseeded

    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_landmarks = Out(LandmarksMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_orientation: Row, out_landmarks: Row) -> None:
        """Cast rays from the newest true pose; the middle row of the image is exposed at its time."""
        if in_state.seq == 0 or in_orientation.seq == 0:
            return
        r_BN_N, v_BN_N, omega_EN_N = vec3(in_state.r_BN_N), vec3(in_state.v_BN_N), vec3(in_orientation.omega_EN_N)
        dcm_BN, dcm_EN = mrp_to_dcm(vec3(in_state.sigma_BN)), mat3(in_orientation.dcm_EN)
        omega_BN_B = vec3(in_state.omega_BN_B)
        age = (in_state.t_ns - in_orientation.t_ns) / 1e9
        width, height = params.width_px, params.height_px
        cloudy = not uniform(state.faults) < params.clear
        count = 0
        for _ in range(params.count):
            # all numbers are drawn for every place, so that one that misses the Earth changes no other
            u, v = (width - 1.0) * uniform(state.noise), (height - 1.0) * uniform(state.noise)
            h = params.sigma_height * normal(state.noise)
            seen_u, seen_v = u + params.sigma_px * normal(state.noise), v + params.sigma_px * normal(state.noise)
            error = (normal(state.noise), normal(state.noise), normal(state.noise))
            false, false_u, false_v = uniform(state.faults), uniform(state.faults), uniform(state.faults)
            after = params.row_time * (v - 0.5 * (height - 1.0))
            turned = matmul(rotvec_to_dcm(scale(after, omega_BN_B)), dcm_BN)
            earth = matmul(dcm_EN, rotvec_to_dcm(scale(age + after, omega_EN_N)))
            r_CN_N = add(axpy(after, v_BN_N, r_BN_N), mat_t_vec(turned, vec3(params.r_CB_B)))
            x, y = undistort_point(params.lens, u, v)
            ray_N = mat_t_vec(turned, mat_t_vec(mat3(params.dcm_CB), unit((x, y, 1.0))))
            r, ray = matvec(earth, r_CN_N), matvec(earth, ray_N)
            lat, lon, distance = ray_to_height(r[0], r[1], r[2], ray[0], ray[1], ray[2], h)
            if cloudy or not distance > 0.0:
                continue
            place = ecef_from_geodetic(lat, lon, h)
            for i in range(3):
                out_landmarks.r_LE_E[count, i] = place[i] + params.bias_map_E[i] + params.sigma_map * error[i]
            if false < params.outliers:
                seen_u, seen_v = (width - 1.0) * false_u, (height - 1.0) * false_v
            out_landmarks.pixel_px[count, 0], out_landmarks.pixel_px[count, 1] = seen_u, seen_v
            out_landmarks.sigma_px[count], out_landmarks.score[count] = params.sigma_px, 1.0
            for i in range(2):
                for j in range(2):
                    out_landmarks.P_px[count, i, j] = params.sigma_px * params.sigma_px if i == j else 0.0
            count += 1
        cells = 0
        for cell in range(24):
            for k in range(count):
                column = min(max(math.floor((out_landmarks.pixel_px[k, 0] + 0.5) * 6 / width), 0), 5)
                row = min(max(math.floor((out_landmarks.pixel_px[k, 1] + 0.5) * 4 / height), 0), 3)
                if 6 * row + column == cell:
                    cells += 1
                    break
        for k in range(count, MAX_LANDMARKS):
            for i in range(3):
                out_landmarks.r_LE_E[k, i] = math.nan
            out_landmarks.pixel_px[k, 0] = out_landmarks.pixel_px[k, 1] = math.nan
            out_landmarks.sigma_px[k] = out_landmarks.score[k] = math.nan
            for i in range(2):
                for j in range(2):
                    out_landmarks.P_px[k, i, j] = math.nan
        out_landmarks.exposure_ns = in_state.t_ns
        out_landmarks.count, out_landmarks.candidates, out_landmarks.cells = count, params.count, cells
        out_landmarks.status = 0 if count > 0 else 3
        publish(out_landmarks, t_ns)


def of_camera(camera: CameraConfigMsg) -> dict[str, Any]:
    """Parameters of a camera: ``LandmarkOracle.Params(**of_camera(camera), count=100)``."""
    return {
        "lens": lens_vector(camera),
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "dcm_CB": np.array(camera.dcm_CB),
    }
