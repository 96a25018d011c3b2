"""An image from end to end: prior gate, iteration, rejection, test of the whole, and correction of the estimate."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.extended import joseph
from fsw.math.square_root import OK
from fsw.math.vectors import vec3
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf import status
from modules.estimation.pose_mekf.correct import correct, limit, transport
from modules.estimation.pose_mekf.image import gate_one_by_one, largest_change, linearize, robust_weights, solve
from modules.estimation.pose_mekf.layout import ESTIMATE, SIZE, THETA
from modules.opnav.relative import orientation_at

MOST_ITERATIONS = 25
"""Robust weights of many false landmarks settle slowly."""
SETTLED = 0.1
"""Largest change of a residual between iterations, in sigma, when they have."""
SEARCH_SHARE = 0.5
"""Share of the landmarks that has to agree when a lost estimate is looked for."""


@compiled
def _moved(x: F64, dx: F64, out: F64) -> None:
    for i in range(ESTIMATE):
        out[i] = x[i]
    correct(out, dx)


@compiled
def use_image(
    x: F64,
    P: F64,
    estimated: F64,
    sigma: F64,
    params: Row,
    marks: Row,
    in_camera: Row,
    in_orientation: Row,
    search: bool,
    out: Row,
) -> int:
    """Correct an estimate (34,), (26, 26) by an image of its own time; on any status but UPDATED it stays.

    Args:
        x: estimate.
        P: covariance.
        estimated: (26,) of `modes`.
        sigma: (26,) of `modes`.
        params: of the module.
        marks: landmarks.
        in_camera: camera.
        in_orientation: planet.
        search: the estimate is nearly unknown: most landmarks have to agree.
        out: PoseFilterMsg; what the image said is written.
    """
    dcm_EN, omega_EN_N = orientation_at(in_orientation, marks.exposure_ns), vec3(in_orientation.omega_EN_N)
    count = marks.count
    rows, weight = np.empty((2 * count, SIZE + 1)), np.empty(count)
    H, K, dx, now = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.zeros(SIZE), np.empty(ESTIMATE)
    huber = params.huber if params.huber > 0.0 else math.inf
    gate = limit(2.0, params.gate)
    usable = linearize(x, sigma, params, marks, in_camera, dcm_EN, omega_EN_N, rows)
    out.landmarks = usable
    if usable < params.min_landmarks:
        return status.BAD_NUMBERS if count >= params.min_landmarks and usable == 0 else status.TOO_FEW
    least = max(float(params.min_landmarks), (SEARCH_SHARE if search else params.min_share) * usable)
    kept = gate_one_by_one(P, rows, count, huber, gate, weight)
    out.accepted = kept
    if kept < least:
        return status.TOO_FEW
    # Considered states are corrected too while the estimate settles: their errors are no residuals of landmarks.
    every, last = np.ones(SIZE), np.full(count, math.inf)
    settled = 0
    for k in range(MOST_ITERATIONS):
        code, _ = solve(P, rows, count, weight, dx, every, H, K, dx)
        if code != OK:
            return status.FAILED_UPDATE
        _moved(x, dx, now)
        linearize(now, sigma, params, marks, in_camera, dcm_EN, omega_EN_N, rows)
        # what does not agree is only given up when the estimate has settled
        kept = robust_weights(rows, count, huber, gate if settled > 0 else math.inf, weight)
        out.accepted = kept
        if kept < least:
            return status.TOO_FEW
        change = largest_change(rows, count, weight, last)
        if settled > 0 or (k + 2 >= params.iterations and change < SETTLED) or k == MOST_ITERATIONS - 3:
            settled += 1
        if settled == 3 or (settled == 2 and change < SETTLED):
            break
    before = np.empty((2 * count, SIZE + 1))
    linearize(x, sigma, params, marks, in_camera, dcm_EN, omega_EN_N, before)
    one, none, step = np.empty(count), np.zeros(SIZE), np.empty(SIZE)
    for i in range(count):
        one[i] = 1.0 if weight[i] > 0.0 else 0.0
    code, nis = solve(P, before, count, one, none, every, H, K, step)
    out.nis, out.freedom = nis, 2 * kept
    if code != OK:
        return status.FAILED_UPDATE
    # far from the truth the image is no linear function of the error, so only the landmarks that agree can tell
    if nis > limit(2.0 * kept, params.gate) and not search:
        return status.GATED
    code, _ = solve(P, rows, count, weight, dx, estimated, H, K, dx)
    if code == OK:
        code = joseph(K, H, np.eye(SIZE), P)
    if code != OK:
        return status.FAILED_UPDATE
    correct(x, dx)
    transport((dx[THETA], dx[THETA + 1], dx[THETA + 2]), P)
    return status.UPDATED
