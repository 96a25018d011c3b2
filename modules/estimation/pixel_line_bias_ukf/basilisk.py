"""Basilisk's pixelLineBiasUKF as it is in release 2.12.1, with its faults, to compare with.

The planet is expected mirrored through the optical centre, the bias is rounded to whole pixels and measured by the same
pixels, once more rounded, and the covariance is scaled in its first 60 numbers only.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import mrp_to_dcm
from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, transpose_in_place
from fsw.math.unscented import unscented_weights
from fsw.math.vectors import M3, dot, mat3, matmul, matvec, vec3
from fsw.module import Row
from messages.base import F64
from modules.estimation.relative_od_ukf import status
from modules.estimation.relative_od_ukf.basilisk import (
    basilisk_measurement_update,
    basilisk_orbit_update,
    factor_of,
    gravity_km,
    post_fit,
)
from modules.opnav.basilisk import basilisk_radii


@compiled
def whole(x: float) -> float:
    """The nearest integer, halves away from zero, as C rounds."""
    return math.copysign(math.floor(math.fabs(x) + 0.5), x)


@compiled
def basilisk_circles(
    points: F64, camera: Row, dcm_CN: M3, radius: float, circle: F64, seen: F64, observed: F64
) -> None:
    """Basilisk's measurement model.

    Args:
        points: (k, 9) [km, km/s, px].
        camera: row of the camera, of `modules.opnav.basilisk.camera_of`.
        dcm_CN: maps N to C components.
        radius: of the body [km].
        circle: column, row, radius measured (3,) [px].
        seen: out (k, 6), the circle without bias, and the bias.
        observed: out (6,), the circle and the rounded difference of the first point's circle from it.
    """
    X, Y = 1.0 / camera.focal_px[0], 1.0 / camera.focal_px[1]
    for p in range(points.shape[0]):
        r = (points[p, 0], points[p, 1], points[p, 2])
        r_C = matvec(dcm_CN, r)
        seen[p, 0] = -r_C[0] / r_C[2] / X + camera.width_px // 2 - 0.5
        seen[p, 1] = -r_C[1] / r_C[2] / Y + camera.height_px // 2 - 0.5
        seen[p, 2] = math.tan(math.asin(min(1.0, radius / math.sqrt(dot(r, r))))) / X
        for i in range(3):
            if p == 0:
                observed[i] = circle[i]
                observed[3 + i] = whole(seen[0, i] - circle[i])
            seen[p, i] -= points[p, 6 + i]
            seen[p, 3 + i] = points[p, 6 + i]


@compiled
def as_basilisk(t_ns: int, params: Row, state: Row, circles: Row, camera: Row, attitude: Row, out: Row) -> int:
    """One call of Basilisk's pixelLineBiasUKF; ``state.x`` and ``state.S`` are in km and km/s. Returns the status."""
    n, weights, noise = 9, unscented_weights(9, params.alpha, params.beta, params.kappa), np.empty((9, 9))
    if not state.started:
        P = np.empty((n, n))
        for i in range(n):
            for j in range(n):
                P[i, j] = params.P[i, j] * (1e-6 if 9 * i + j < 60 else 1.0)
        for i in range(3):
            state.x[i], state.x[3 + i] = 1e-3 * params.r_CP_N[i], 1e-3 * params.v_CP_N[i]
            state.x[6 + i] = params.bias_px[i]
        cholesky(P, state.S)
        state.time, state.planet, state.started = params.start_ns * 1e-9, params.body_id, True
    factor_of(params.process_noise, noise)
    transpose_in_place(noise)
    points, middle, seen = np.empty((2 * n + 1, n)), np.empty(n), np.empty((2 * n + 1, 6))
    circle, observed, R = np.empty(3), np.empty(6), np.zeros((6, 6))
    dcm_CN = matmul(mat3(camera.dcm_CB), mrp_to_dcm(vec3(attitude.sigma_BN)))
    t, t_measured, what = t_ns * 1e-9, attitude.t_ns * 1e-9, status.NO_MEASUREMENT
    for i in range(3):
        out.residual[i] = 0.0
    usable = circles.seq != 0 and camera.seq != 0 and attitude.seq != 0 and circles.valid
    radius = 1e-3 * basilisk_radii(circles.body_id)[0]
    if usable and t_measured >= state.time and radius > 0.0:
        state.planet = circles.body_id
        code = basilisk_orbit_update(t_measured, gravity_km(state.planet), weights, noise, state, points, middle)
        what = status.UPDATED if code == OK else status.FAILED_PREDICTION
        for i in range(3):
            circle[i] = circles.radius_px[0] if i == 2 else circles.center_px[0, i]
            for j in range(3):
                R[i, j] = R[3 + i, 3 + j] = circles.P_px[0, i, j]
        basilisk_circles(points, camera, dcm_CN, radius, circle, seen, observed)
        code = basilisk_measurement_update(weights, 1.0, R, observed, seen, points, middle, state)
        what = what if code == OK else status.FAILED_UPDATE
        if code == OK:
            for i in range(3):
                state.x[6 + i] = whole(state.x[6 + i])
    if t > state.time:
        basilisk_orbit_update(t, gravity_km(state.planet), weights, noise, state, points, middle)
    if what != status.NO_MEASUREMENT:
        basilisk_circles(points, camera, dcm_CN, radius, circle, seen, observed)
        post_fit(weights, observed, seen, out.residual)
    return what
