"""Measurements of one instant that are not images: receiver, star tracker, single stars."""

from __future__ import annotations

import numpy as np

from fsw.math.attitude import ep_to_dcm
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, mat3, vec3, vec4
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf.correct import apply
from modules.estimation.pose_mekf.layout import BIAS, CORE, GPS, SIZE, X_BETA, X_NUISANCE
from modules.estimation.pose_mekf.motion import pose_of
from modules.estimation.pose_models.pose import OMEGA
from modules.estimation.pose_models.sensors import direction, gps, star_tracker

GYRO, RECEIVER, TRACKER, STAR = 0, 1, 2, 3
"""Kinds of entries of the memory."""
WIDTH = 7
"""Numbers of an entry: reading (B); position and velocity (E); Euler parameters (S); measured and known direction and
standard deviation."""


@compiled
def by_error_state(H_pose: F64, row: int, H: F64) -> None:
    """A row of derivatives by the error state (26,) from that by the error of a pose (12,): omega = reading - bias."""
    for j in range(SIZE):
        H[row, j] = 0.0
    for j in range(OMEGA):
        H[row, j] = H_pose[row, j]
    for j in range(3):
        H[row, BIAS + j] = -H_pose[row, OMEGA + j]


@compiled
def use_instant(
    kind: int, data: F64, x: F64, P: F64, estimated: F64, dcm_EN: M3, params: Row, in_orientation: Row
) -> int:
    """Correct the estimate (34,), (26, 26) by an entry of the memory (7,) of its own time; returns the status."""
    m = 6 if kind == RECEIVER else (3 if kind == TRACKER else 2)
    residual, H_pose, H, noise = np.empty(m), np.empty((m, CORE)), np.empty((m, SIZE)), np.zeros((m, m))
    pose = pose_of(x, ep_to_dcm(vec4(x[X_BETA:])))
    if kind == RECEIVER:
        omega_EN_N, r_AB_B = vec3(in_orientation.omega_EN_N), vec3(params.r_AB_B)
        gps(pose, r_AB_B, dcm_EN, omega_EN_N, vec3(data), vec3(data[3:]), residual, H_pose)
        for i in range(3):
            residual[i] -= x[X_NUISANCE + GPS - CORE + i]
            noise[i, i] = params.gps_sigma_r * params.gps_sigma_r
            noise[3 + i, 3 + i] = params.gps_sigma_v * params.gps_sigma_v
    elif kind == TRACKER:
        star_tracker(pose, mat3(params.dcm_SB), ep_to_dcm(vec4(data)), residual, H_pose)
        for i in range(3):
            noise[i, i] = params.star_sigma[i] * params.star_sigma[i]
    else:
        same: M3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        direction(pose, same, vec3(data[3:]), vec3(data), residual, H_pose)
        for i in range(2):
            noise[i, i] = data[6] * data[6]
    for a in range(m):
        by_error_state(H_pose, a, H)
    if kind == RECEIVER:
        for i in range(3):
            H[i, GPS + i] = 1.0
    what, _ = apply(x, P, H, noise, residual, estimated, params.gate)
    return what
