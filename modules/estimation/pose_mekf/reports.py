"""The messages that the filter writes."""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf import status
from modules.estimation.pose_mekf.layout import (
    CENTER,
    CORE,
    FOCAL,
    GPS,
    K1,
    MAP,
    MOUNT,
    SIZE,
    TIME,
    X_BETA,
    X_BIAS,
    X_HELD,
    X_NUISANCE,
    X_R,
    X_REFUSED,
    X_USED,
    X_V,
)


@compiled
def blank(state: Row, out: Row) -> None:
    """Nothing has been measured yet."""
    out.nis = math.nan
    out.freedom = out.landmarks = out.accepted = 0
    state.status_gps = state.status_star = state.status_vectors = status.NO_MEASUREMENT


@compiled
def write_estimate(state: Row, out: Row) -> None:
    """Estimate, covariance, and what became of measurements."""
    x = state.x
    for i in range(3):
        out.r_BN_N[i], out.v_BN_N[i], out.bias_B[i] = x[X_R + i], x[X_V + i], x[X_BIAS + i]
    for i in range(4):
        out.beta_BN[i] = x[X_BETA + i]
    for i in range(SIZE):
        for j in range(SIZE):
            out.P[i, j] = state.P[i, j]
    out.estimate_ns, out.lost, out.rate_held = state.time_ns, state.lost, x[X_HELD] > 0.5
    out.status_gps, out.status_star, out.status_vectors = state.status_gps, state.status_star, state.status_vectors
    out.contradicting, out.images = state.contradicting, state.images
    out.used, out.refused = int(x[X_USED]), int(x[X_REFUSED])


@compiled
def _sigma(P: F64, i: int) -> float:
    return math.sqrt(P[i, i]) if P[i, i] > 0.0 else 0.0


@compiled
def write_nuisance(x: F64, P: F64, out: Row) -> None:
    """Nuisance states of an estimate (34,), (26, 26)."""
    n = X_NUISANCE - CORE
    for i in range(3):
        out.mount_C[i], out.sigma_mount[i] = x[n + MOUNT + i], _sigma(P, MOUNT + i)
        out.gps_E[i], out.sigma_gps[i] = x[n + GPS + i], _sigma(P, GPS + i)
        out.map_E[i], out.sigma_map[i] = x[n + MAP + i], _sigma(P, MAP + i)
    for i in range(2):
        out.center_px[i], out.sigma_center_px[i] = x[n + CENTER + i], _sigma(P, CENTER + i)
    out.focal, out.sigma_focal = x[n + FOCAL], _sigma(P, FOCAL)
    out.k1, out.sigma_k1 = x[n + K1], _sigma(P, K1)
    out.time_s, out.sigma_time = x[n + TIME], _sigma(P, TIME)
