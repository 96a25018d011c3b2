"""The first estimate, an estimate that is lost, and one from a pose."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import dcm_to_ep, ep_to_dcm, mrp_to_ep, rotvec_to_dcm
from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky
from fsw.math.vectors import mat3, mat_t_vec, matmul, store3, store4, sub, transpose, vec3, vec4
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf.layout import (
    BIAS,
    CORE,
    ESTIMATE,
    MAP,
    MOUNT,
    SIZE,
    THETA,
    X_BETA,
    X_NUISANCE,
    X_R,
    X_READING,
    X_V,
    R,
)
from modules.opnav.relative import orientation_at


@compiled
def knows_planet(in_orientation: Row) -> bool:
    """Whether the planet's orientation was written and holds numbers."""
    total = 0.0
    for i in range(3):
        total += in_orientation.omega_EN_N[i]
        for j in range(3):
            total += in_orientation.dcm_EN[i, j]
    return in_orientation.seq != 0 and math.isfinite(total)


@compiled
def reset_nuisance(x: F64, P: F64, params: Row, sigma: F64) -> None:
    """Nuisance states as at the start: zero, of standard deviations (26,), correlated only within the map's error."""
    for i in range(CORE, SIZE):
        x[X_NUISANCE + i - CORE] = 0.0
        for j in range(SIZE):
            P[i, j] = P[j, i] = 0.0
        P[i, i] = sigma[i] * sigma[i]
    for i in range(3):
        for j in range(3):
            if sigma[MAP + i] > 0.0 and sigma[MAP + j] > 0.0:
                P[MAP + i, MAP + j] = params.map_bias_P[i, j]


@compiled
def begin(state: Row, params: Row, sigma: F64) -> None:
    """The first estimate, from the parameters."""
    for i in range(ESTIMATE):
        state.x[i] = 0.0
    for i in range(3):
        state.x[X_R + i], state.x[X_V + i] = params.r_BN_N[i], params.v_BN_N[i]
        state.x[X_READING + i] = params.omega_BN_B[i]
    store4(state.x[X_BETA:], mrp_to_ep(vec3(params.sigma_BN)))
    for i in range(CORE):
        for j in range(CORE):
            state.P[i, j] = params.P[i, j]
    reset_nuisance(state.x, state.P, params, sigma)
    state.time_ns = state.gyro_ns = params.start_ns
    state.lost = params.start_lost
    state.started = True


@compiled
def lose(x: F64, P: F64, params: Row, sigma: F64) -> None:
    """The estimate is no longer trusted: wide standard deviations, no correlations, nuisance states as at the start."""
    for i in range(CORE):
        for j in range(SIZE):
            P[i, j] = P[j, i] = 0.0
        if i < BIAS:
            wide = params.lost_sigma[i // 3]
            P[i, i] = wide * wide
        else:
            P[i, i] = params.P[i, i]
    reset_nuisance(x, P, params, sigma)


@compiled
def place(x: F64, in_fix: Row, in_camera: Row, in_orientation: Row, params: Row) -> bool:
    """Put the estimate at a pose of the camera; False if it holds NaN."""
    dcm_EN = orientation_at(in_orientation, in_fix.exposure_ns)
    dcm_CE = ep_to_dcm(vec4(in_fix.beta_CE))
    mount = rotvec_to_dcm(vec3(x[X_NUISANCE + MOUNT - CORE :]))
    dcm_BE = matmul(transpose(matmul(mount, mat3(in_camera.dcm_CB))), dcm_CE)
    dcm_BN = matmul(dcm_BE, dcm_EN)
    r_CN_N = mat_t_vec(dcm_EN, vec3(in_fix.r_CE_E))
    r_BN_N = sub(r_CN_N, mat_t_vec(dcm_BN, vec3(params.r_CB_B)))
    if not math.isfinite(r_BN_N[0] + r_BN_N[1] + r_BN_N[2] + dcm_BN[0][0] + dcm_BN[1][1]):
        return False
    store3(x[X_R:], r_BN_N)
    store4(x[X_BETA:], dcm_to_ep(dcm_BN))
    return True


@compiled
def trust(x: F64, P: F64, in_fix: Row, in_camera: Row, in_orientation: Row) -> bool:
    """Give a lost estimate that was put at a pose the pose's covariance; False if that is none.

    The body's attitude is that of the camera less the error of its mounting, so the two are correlated.
    """
    work, factor = np.empty((6, 6)), np.empty((6, 6))
    total = 0.0
    for i in range(6):
        for j in range(6):
            work[i, j] = in_fix.P_pose[i, j]
            total += work[i, j]
    if not math.isfinite(total) or cholesky(work, factor) != OK:
        return False
    dcm_EN = orientation_at(in_orientation, in_fix.exposure_ns)
    mount = rotvec_to_dcm(vec3(x[X_NUISANCE + MOUNT - CORE :]))
    dcm_BC, dcm_NE = transpose(matmul(mount, mat3(in_camera.dcm_CB))), transpose(dcm_EN)
    for j in range(6):  # columns of the factor: from E and C to N and B
        r = (factor[0, j], factor[1, j], factor[2, j])
        theta = (factor[3, j], factor[4, j], factor[5, j])
        for i in range(3):
            factor[i, j] = dcm_NE[i][0] * r[0] + dcm_NE[i][1] * r[1] + dcm_NE[i][2] * r[2]
            factor[3 + i, j] = dcm_BC[i][0] * theta[0] + dcm_BC[i][1] * theta[1] + dcm_BC[i][2] * theta[2]
    for a in range(6):
        for b in range(6):
            value = 0.0
            for k in range(6):
                value += factor[a, k] * factor[b, k]
            P[R + a if a < 3 else THETA + a - 3, R + b if b < 3 else THETA + b - 3] = value
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += dcm_BC[i][k] * P[MOUNT + k, MOUNT + k] * dcm_BC[j][k]
            P[THETA + i, THETA + j] += total
            P[THETA + i, MOUNT + j] = P[MOUNT + j, THETA + i] = -dcm_BC[i][j] * P[MOUNT + j, MOUNT + j]
    return True
