"""What each sensor says: residuals and derivatives by the error of the pose, divided by the standard deviation.

Every function writes rows into H (12, 12) and residual (12,), and returns a status and how many rows there are.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import ep_normalize, ep_to_dcm
from fsw.math.compiled import compiled
from fsw.math.eclipse import visible_fraction
from fsw.math.forces import ASTRONOMICAL_UNIT
from fsw.math.magnetic import RADIUS, harmonic_field, harmonic_gradient
from fsw.math.vectors import M3, V3, dot, mat3, mat_t_vec, matmul, matvec, norm, scale, sub, transpose, unit, vec3, vec4
from fsw.module import Row
from messages.base import F64
from modules.estimation.earth_tracker_ekf import status
from modules.estimation.earth_tracker_ekf.few import Found, divide, put_compressed
from modules.estimation.pose_models import sensors
from modules.estimation.pose_models.pose import SIZE, THETA, Pose, is_finite

C_LIGHT = 299792458.0


@compiled
def gps_rows(pose: Pose, params: Row, fix: Row, dcm_EN: M3, omega_EN_N: V3, H: F64, residual: F64) -> Found:
    """Position and velocity of the antenna: six rows."""
    r, v = vec3(fix.r_AE_E), vec3(fix.v_AE_E)
    if not (is_finite(r) and is_finite(v)):
        return status.BAD_NUMBERS, 0
    sensors.gps(pose, vec3(params.r_AB_B), dcm_EN, omega_EN_N, r, v, residual[:6], H[:6])
    for i in range(6):
        divide(H, residual, i, params.sigma_gps_r if i < 3 else params.sigma_gps_v)
    return status.UPDATED, 6


@compiled
def gyro_rows(pose: Pose, params: Row, imu: Row, H: F64, residual: F64) -> Found:
    """Angular rate relative to N: three rows."""
    omega_PN_P = vec3(imu.omega_PN_P)
    if not is_finite(omega_PN_P):
        return status.BAD_NUMBERS, 0
    sensors.gyro(pose, mat3(params.dcm_PB), vec3(params.gyro_bias_P), omega_PN_P, residual[:3], H[:3])
    for i in range(3):
        divide(H, residual, i, params.sigma_gyro)
    return status.UPDATED, 3


@compiled
def sun_rows(pose: Pose, params: Row, css: Row, sun: Row, H: F64, residual: F64) -> Found:
    """Cells that face the Sun, a row each; the others say nothing about the attitude and are left out."""
    if sun.seq == 0:
        return status.NO_INPUT, 0
    r_N = pose[0]
    r_SB_N = sub(vec3(sun.r_PN_N), r_N)
    far = norm(r_SB_N)
    if not math.isfinite(far):
        return status.BAD_NUMBERS, 0
    if visible_fraction(r_SB_N, sun.radius, scale(-1.0, r_N), params.radius) != 1.0:
        return status.IN_SHADOW, 0
    full, sun_N, n = params.css_scale * (ASTRONOMICAL_UNIT / far) ** 2, scale(1.0 / far, r_SB_N), 0
    for i in range(6):
        if not math.isfinite(css.signal[i]):
            return status.BAD_NUMBERS, 0
        normal_B = unit(vec3(params.normals_B[i]))
        cosine = sensors.sun_cell(pose, normal_B, sun_N, full, css.signal[i], residual[n : n + 1], H[n : n + 1])
        if cosine > params.css_limit:
            divide(H, residual, n, params.sigma_css)
            n += 1
    return (status.UPDATED if n > 0 else status.TOO_FEW), n


@compiled
def magnetometer_rows(pose: Pose, params: Row, field: Row, dcm_EN: M3, H: F64, residual: F64) -> Found:
    """Flux density against the field model at the estimated position: three rows."""
    B_S = vec3(field.B_S)
    if not is_finite(B_S):
        return status.BAD_NUMBERS, 0
    r_E, degree = matvec(dcm_EN, pose[0]), params.field_degree
    B_E = harmonic_field(r_E, RADIUS, degree, params.field_g, params.field_h)
    slope_E = harmonic_gradient(r_E, RADIUS, degree, params.field_g, params.field_h)
    slope_N = matmul(transpose(dcm_EN), matmul(slope_E, dcm_EN))
    sensors.magnetometer(
        pose,
        mat3(params.dcm_MB),
        mat_t_vec(dcm_EN, B_E),
        slope_N,
        vec3(params.magnetic_bias_M),
        B_S,
        residual[:3],
        H[:3],
    )
    for i in range(3):
        divide(H, residual, i, params.sigma_magnetometer)
    return status.UPDATED, 3


@compiled
def tracker_rows(pose: Pose, params: Row, tracker: Row, H: F64, residual: F64) -> Found:
    """Attitude of a star tracker: three rows."""
    if not tracker.valid:
        return status.INVALID, 0
    beta = vec4(tracker.beta_SN)
    size = beta[0] * beta[0] + beta[1] * beta[1] + beta[2] * beta[2] + beta[3] * beta[3]
    if not abs(size - 1.0) < 1e-6:
        return status.BAD_NUMBERS, 0
    sensors.star_tracker(pose, mat3(params.dcm_SB), ep_to_dcm(ep_normalize(beta)), residual[:3], H[:3])
    for i in range(3):
        divide(H, residual, i, params.sigma_tracker[i])
    return status.UPDATED, 3


@compiled
def star_rows(pose: Pose, params: Row, stars: Row, sun: Row, H: F64, residual: F64) -> Found:
    """Directions to stars of the catalogue, as three rows."""
    if not stars.valid:
        return status.INVALID, 0
    if params.star_count == 0 or (params.aberration and sun.seq == 0):
        return status.NO_INPUT, 0
    if not stars.sigma > 0.0:
        return status.BAD_NUMBERS, 0
    count = stars.count
    if count < 1:
        return status.TOO_FEW, 0
    rows, pair, seen = np.zeros((2 * count, 7)), np.empty((2, SIZE)), np.empty(2)
    moving = scale(1.0 / C_LIGHT, sub(pose[1], vec3(sun.v_PN_N))) if params.aberration else (0.0, 0.0, 0.0)
    for k in range(count):
        which, s_S = stars.star[k], vec3(stars.s_S[k])
        if not (0 <= which < params.star_count and abs(dot(s_S, s_S) - 1.0) < 1e-6):
            return status.BAD_NUMBERS, 0
        star = params.star_N[which]
        known = unit((star[0] + moving[0], star[1] + moving[1], star[2] + moving[2]))
        sensors.direction(pose, mat3(params.dcm_VB), known, s_S, seen, pair)
        for i in range(2):
            for j in range(3):
                rows[2 * k + i, 3 + j] = pair[i, THETA + j] / stars.sigma
            rows[2 * k + i, 6] = seen[i] / stars.sigma
    return put_compressed(rows, H, residual)
