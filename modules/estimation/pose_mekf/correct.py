"""Corrections of the estimate by error states, and gates."""

from __future__ import annotations

import math

import numpy as np

from fsw.math import unscented
from fsw.math.attitude import dcm_to_rotvec, ep_compose, ep_normalize, rotvec_to_dcm, rotvec_to_ep
from fsw.math.compiled import compiled
from fsw.math.extended import kalman_update
from fsw.math.square_root import OK
from fsw.math.vectors import V3, matmul, store3, store4, vec3, vec4
from messages.base import F64
from modules.estimation.pose_mekf import status
from modules.estimation.pose_mekf.layout import (
    CORE,
    MOUNT,
    SIZE,
    THETA,
    X_BETA,
    X_BIAS,
    X_NUISANCE,
    X_R,
    X_REFUSED,
    X_USED,
    mask,
)


@compiled
def correct(x: F64, dx: F64) -> None:
    """Move an estimate (34,) by an error state (26,): rotations are composed, the rest is added."""
    for i in range(6):
        x[X_R + i] += dx[i]
    theta: V3 = (dx[THETA], dx[THETA + 1], dx[THETA + 2])
    store4(x[X_BETA:], ep_normalize(ep_compose(rotvec_to_ep(theta), vec4(x[X_BETA:]))))
    for i in range(3):
        x[X_BIAS + i] += dx[THETA + 3 + i]
    mount = dcm_to_rotvec(matmul(rotvec_to_dcm(vec3(dx[MOUNT:])), rotvec_to_dcm(vec3(x[X_NUISANCE:]))))
    store3(x[X_NUISANCE:], mount)
    for i in range(MOUNT + 3, SIZE):
        x[X_NUISANCE + i - CORE] += dx[i]


@compiled
def transport(theta: V3, P: F64) -> None:
    """P <- G P G', G = I - [theta x] / 2 for the attitude: the error is now that of the corrected attitude."""
    a, b, c = 0.5 * theta[0], 0.5 * theta[1], 0.5 * theta[2]
    for j in range(SIZE):
        p, q, s = P[THETA, j], P[THETA + 1, j], P[THETA + 2, j]
        P[THETA, j], P[THETA + 1, j], P[THETA + 2, j] = p + c * q - b * s, q - c * p + a * s, s + b * p - a * q
    for i in range(SIZE):
        p, q, s = P[i, THETA], P[i, THETA + 1], P[i, THETA + 2]
        P[i, THETA], P[i, THETA + 1], P[i, THETA + 2] = p + c * q - b * s, q - c * p + a * s, s + b * p - a * q
    for i in range(SIZE):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])


@compiled
def limit(freedom: float, quantile: float) -> float:
    """Upper limit of a chi-square variable, by Wilson and Hilferty (1931); infinity for a quantile of 0.

    Args:
        freedom: degrees of freedom; the error is below 5 % for 2 of them, and below 1 % for 6.
        quantile: of the normal distribution, 3.719 for 0.9999.
    """
    if not quantile > 0.0:
        return math.inf
    part = 2.0 / (9.0 * freedom)
    root = 1.0 - part + quantile * math.sqrt(part)
    return freedom * root * root * root


@compiled
def apply(x: F64, P: F64, H: F64, R: F64, residual: F64, estimated: F64, quantile: float) -> tuple[int, float]:
    """One measurement of one instant; counts it in x.

    Args:
        x: estimate (34,).
        P: covariance (26, 26).
        H: (m, 26).
        R: (m, m).
        residual: (m,) measured minus predicted.
        estimated: (26,) of `modes`.
        quantile: of the gate; see `limit`.

    Returns:
        Status, and the normalised innovation squared.
    """
    dx = np.empty(SIZE)
    gate = limit(residual.shape[0], quantile)
    code, nis = kalman_update(P, H, R, residual, gate, mask(estimated), dx)
    if code != OK:
        x[X_REFUSED] += 1.0
        return (status.GATED if code == unscented.GATED else status.FAILED_UPDATE), nis
    correct(x, dx)
    transport((dx[THETA], dx[THETA + 1], dx[THETA + 2]), P)
    x[X_USED] += 1.0
    return status.UPDATED, nis
