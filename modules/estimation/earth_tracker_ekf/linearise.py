"""A measurement of any sensor, linear in the filter's error at the time of the estimate."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, solve_lower
from fsw.math.vectors import vec3
from fsw.module import Row
from messages.base import F64, I64
from modules.estimation.earth_tracker_ekf import status
from modules.estimation.earth_tracker_ekf.dynamics import Body, moved, noise
from modules.estimation.earth_tracker_ekf.error import frame_of, pose_of, to_pose_error
from modules.estimation.earth_tracker_ekf.few import Found
from modules.estimation.earth_tracker_ekf.landmark_rows import landmark_rows
from modules.estimation.earth_tracker_ekf.rows import (
    gps_rows,
    gyro_rows,
    magnetometer_rows,
    star_rows,
    sun_rows,
    tracker_rows,
)
from modules.estimation.pose_models.pose import SIZE, Pose
from modules.opnav.relative import orientation_at

Feeds: TypeAlias = Any
"""Rows: landmarks, GPS, gyro, Sun sensors, magnetometer, star tracker, stars; camera, Sun, orientation."""


@compiled
def measured_at(which: int, params: Row, feeds: Feeds) -> int:
    """Time of the newest measurement of a sensor [ns]."""
    if which == status.LANDMARKS:
        return feeds[0].exposure_ns
    if which == status.GPS:
        return feeds[1].fix_ns
    if which == status.GYRO:
        return feeds[2].t_ns - round(params.gyro_delay * 1e9)
    if which == status.SUN_SENSORS:
        return feeds[3].t_ns
    if which == status.MAGNETOMETER:
        return feeds[4].t_ns
    if which == status.STAR_TRACKER:
        return feeds[5].exposure_ns
    return feeds[6].exposure_ns


@compiled
def sequence_of(which: int, feeds: Feeds) -> int:
    """How often a sensor has written."""
    if which == status.LANDMARKS:
        return feeds[0].seq
    if which == status.GPS:
        return feeds[1].seq
    if which == status.GYRO:
        return feeds[2].seq
    if which == status.SUN_SENSORS:
        return feeds[3].seq
    if which == status.MAGNETOMETER:
        return feeds[4].seq
    if which == status.STAR_TRACKER:
        return feeds[5].seq
    return feeds[6].seq


@compiled
def rows_of(
    which: int,
    when: int,
    pose: Pose,
    P: F64,
    M: F64,
    params: Row,
    feeds: Feeds,
    first: bool,
    keep: I64,
    H: F64,
    residual: F64,
) -> Found:
    """Rows of a sensor by the error of the pose at the time of its measurement."""
    orientation, sun = feeds[9], feeds[8]
    if which == status.GYRO:
        return gyro_rows(pose, params, feeds[2], H, residual)
    if which == status.SUN_SENSORS:
        return sun_rows(pose, params, feeds[3], sun, H, residual)
    if which == status.STAR_TRACKER:
        return tracker_rows(pose, params, feeds[5], H, residual)
    if which == status.STARS:
        return star_rows(pose, params, feeds[6], sun, H, residual)
    if orientation.seq == 0:
        return status.NO_INPUT, 0
    dcm_EN, omega_EN_N = orientation_at(orientation, when), vec3(orientation.omega_EN_N)
    if which == status.GPS:
        return gps_rows(pose, params, feeds[1], dcm_EN, omega_EN_N, H, residual)
    if which == status.MAGNETOMETER:
        if params.field_degree == 0:
            return status.NO_INPUT, 0
        return magnetometer_rows(pose, params, feeds[4], dcm_EN, H, residual)
    if feeds[7].seq == 0:
        return status.NO_INPUT, 0
    return landmark_rows(pose, P, M, params, feeds[0], feeds[7], dcm_EN, first, keep, H, residual)


@compiled
def linearised(
    which: int,
    when: int,
    now: int,
    x: F64,
    P: F64,
    body: Body,
    params: Row,
    feeds: Feeds,
    first: bool,
    keep: I64,
    H: F64,
    residual: F64,
) -> Found:
    """White rows of a sensor by the filter's error.

    A measurement from before the estimate sees the estimate moved back; what process noise did since then is added to
    its own noise.

    Args:
        which: sensor.
        when: time of its measurement [ns], not after ``now``.
        now: time of the estimate [ns].
        x: state (13,).
        P: covariance (12, 12), for the gate of single landmarks.
        body: what moves.
        params: of the module.
        feeds: inputs.
        first: whether landmarks are to be chosen by the gate.
        keep: landmarks that were chosen.
        H: out (12, 12).
        residual: out (12,).

    Returns:
        Status and number of rows.
    """
    M, Phi, T, Q = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    then, lag = x, 1e-9 * (now - when)
    if lag > 0.0:
        then = x.copy()
        if moved(then, -lag, body, Phi) != OK:
            return status.FAILED_UPDATE, 0
        frame = frame_of(then, body[0])
        to_pose_error(then, frame, T, False)
        times(T, Phi, SIZE, M)
    else:
        frame = frame_of(then, body[0])
        to_pose_error(then, frame, M, False)
    code, m = rows_of(which, when, pose_of(then, frame), P, M, params, feeds, first, keep, H, residual)
    if code != status.UPDATED:
        return code, 0
    times(H, M, m, T)
    total = 0.0
    for i in range(m):
        total += residual[i]
        for j in range(SIZE):
            H[i, j] = T[i, j]
            total += T[i, j]
    if not math.isfinite(total):
        return status.BAD_NUMBERS, 0
    if lag > 0.0:
        noise(x, lag, body, params.accel_density, params.torque_density, Q)
        if not add_noise(Q, m, H, residual):
            return status.FAILED_UPDATE, 0
    return status.UPDATED, m


@compiled
def times(A: F64, B: F64, m: int, out: F64) -> None:
    """The first m rows of A B, (12, 12)."""
    for i in range(m):
        for j in range(SIZE):
            out[i, j] = 0.0
        for k in range(SIZE):
            a = A[i, k]
            if a != 0.0:
                for j in range(SIZE):
                    out[i, j] += a * B[k, j]


@compiled
def add_noise(Q: F64, m: int, H: F64, residual: F64) -> bool:
    """Make m white rows white again whose noise has grown by H Q H'."""
    half, S, L, column = np.empty((SIZE, SIZE)), np.eye(m), np.empty((m, m)), np.empty(m)
    times(H, Q, m, half)
    for i in range(m):
        for j in range(m):
            for k in range(SIZE):
                S[i, j] += half[i, k] * H[j, k]
    if cholesky(S, L) != OK:
        return False
    for j in range(SIZE + 1):
        for i in range(m):
            column[i] = H[i, j] if j < SIZE else residual[i]
        if solve_lower(L, column) != OK:
            return False
        for i in range(m):
            if j < SIZE:
                H[i, j] = column[i]
            else:
                residual[i] = column[i]
    return True
