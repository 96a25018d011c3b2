"""Adjustment of lens, mounting, shutter clock and track from the landmarks of several photos (least squares)."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import monotonic_limit
from modules.estimation.orbit_mount_estimator.normals import COLUMNS, accumulate, residuals
from modules.estimation.orbit_pose_prior.orbit import TleOrbit
from modules.estimation.rotations import dcm_from_rotation_vector, rotation_vector

F64 = NDArray[np.float64]

LENS, MOUNT, CLOCK, OFFSET, RATE = slice(0, 7), slice(7, 10), slice(10, 12), slice(12, 15), 15
"""Places in the vector of common parameters: f cx cy k1 k2 p1 p2, attitude of the mounting, clock, track, its rate."""

COMMON, PER_PHOTO = 16, 4
_LENS_PLACES = (0, 2, 3, 5, 6, 7, 8)
_CUT = 3.0


class PhotoData(msgspec.Struct, frozen=True, kw_only=True):
    """Landmarks of one photo, and its time: (n, 3) m Earth-fixed, (n, 2) px, (n,) px; s of simulation time."""

    exposure_s: float
    r_LE_E: F64
    pixel_px: F64
    sigma_px: F64


class Priors(msgspec.Struct, frozen=True, kw_only=True):
    """Standard deviations before the landmarks are seen; 0 holds a parameter.

    Attributes:
        common: (16,) in the order of `LENS` to `RATE`; the entries of the clock are not used.
        clock_mean, clock_cov: (2,), (2, 2) of the clock's correction at the reference, s, and its rate; cov 0 holds it.
        attitude: of one photo's attitude about the mounting, rad. time_s: (n,) of one photo's time about the clock.
        inflation: factor on the standard deviation of a landmark, for errors that neighbours share.
    """

    common: F64
    clock_mean: F64
    clock_cov: F64
    attitude: float
    time_s: F64
    inflation: float


class Adjustment(msgspec.Struct, kw_only=True):
    """The parameters, as `adjust` moves them.

    Attributes:
        lens: lens vector (11,). dcm_CO: mounting. common: (16,) sums of all corrections.
        attitude: (n, 3) rad, time_s: (n,) deviations of each photo. P: (16, 16) covariance, zeros where held.
        rms_px: two-dimensional, with robust weights. landmarks: how many went in. converged: the last step was small.
    """

    lens: F64
    dcm_CO: F64
    common: F64
    attitude: F64
    time_s: F64
    P: F64
    rms_px: float = np.nan
    landmarks: int = 0
    converged: bool = False


def start(lens: F64, dcm_CO: F64, photos: int, clock: F64) -> Adjustment:
    """Parameters before the first iteration; ``clock`` (2,) is where the shutter's clock starts."""
    common = np.zeros(COMMON)
    common[CLOCK] = clock
    none = np.zeros((COMMON, COMMON))
    return Adjustment(
        lens=lens.copy(),
        dcm_CO=dcm_CO.copy(),
        common=common,
        attitude=np.zeros((photos, 3)),
        time_s=np.zeros(photos),
        P=none,
    )


def pose(state: Adjustment, k: int, t_s: float, tau_s: float, orbit: TleOrbit) -> tuple[F64, F64, F64]:
    """Pose of the camera at photo ``k`` for the present parameters, and how it moves with them.

    Args:
        state: the parameters. k: number of the photo. t_s: its nominal time. tau_s: time since the clock's reference.
        orbit: the approximate orbit.

    Returns:
        r_CE_E (3,), dcm_CE (3, 3), and the derivatives (6, 16 + 4) of displacement (C, m) and attitude (C, rad) by the
        common parameters and by the photo's own attitude and time.
    """
    x = state.common
    t = t_s + x[CLOCK][0] + x[CLOCK][1] * tau_s + state.time_s[k]
    r_BE_E, dcm_OE, dcm_HE = orbit.frames(t)
    later = orbit.frames(t + 1.0)[1]
    shift_H = x[OFFSET] + np.array([0.0, x[RATE] * tau_s, 0.0])
    radius = float(np.linalg.norm(r_BE_E))
    tilt = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.0]]) / radius
    dcm_OE = dcm_from_rotation_vector(tilt @ shift_H) @ dcm_OE
    dcm_PO = dcm_from_rotation_vector(state.attitude[k]) @ state.dcm_CO
    dcm_CE = dcm_PO @ dcm_OE
    moves = np.zeros((6, COMMON + PER_PHOTO))
    by_shift = np.vstack([dcm_CE @ dcm_HE.T, dcm_PO @ tilt])
    turning = dcm_PO @ rotation_vector(later @ orbit.frames(t)[1].T)
    by_time = np.concatenate([dcm_CE @ orbit.velocity_earth(t), turning])
    moves[3:, MOUNT] = moves[3:, COMMON : COMMON + 3] = np.eye(3)
    moves[:, CLOCK] = np.outer(by_time, [1.0, tau_s])
    moves[:, OFFSET], moves[:, RATE] = by_shift, by_shift[:, 1] * tau_s
    moves[:, COMMON + 3] = by_time
    return r_BE_E + dcm_HE.T @ shift_H, dcm_CE, moves


def _robust_weights(error: F64, sigma: F64) -> tuple[F64, F64, float]:
    """Weights of Geman and McClure (1987) and of precision, (n,), and the unit error of the residuals (n, 2) px."""
    length = np.hypot(error[:, 0], error[:, 1]) / sigma
    seen = np.isfinite(length)
    unit = float(np.median(length[seen])) / 1.1774 if np.any(seen) else np.nan
    robust = 1.0 / (1.0 + (np.where(seen, length, np.inf) / (_CUT * unit)) ** 2) ** 2
    return robust, 1.0 / (unit * sigma) ** 2, unit


def _equations(
    state: Adjustment, photos: list[PhotoData], tau_s: F64, orbit: TleOrbit, inflation: float
) -> tuple[F64, F64]:
    """Normal matrix and right side of all landmarks at the present parameters; notes rms and count in ``state``."""
    n = COMMON + PER_PHOTO * len(photos)
    normal, right = np.zeros((n, n)), np.zeros(n)
    poses = [pose(state, k, p.exposure_s, tau_s[k], orbit) for k, p in enumerate(photos)]
    errors = [np.empty((len(p.pixel_px), 2)) for p in photos]
    for photo, (r, dcm, _), error in zip(photos, poses, errors, strict=True):
        residuals(state.lens, dcm, r, photo.r_LE_E, photo.pixel_px, error)
    every = np.concatenate(errors)
    robust, precision, _ = _robust_weights(every, np.concatenate([p.sigma_px for p in photos]))
    seen = robust > 0.0
    state.landmarks = int(np.sum(seen))
    state.rms_px = float(np.sqrt(np.sum(robust[seen, None] * every[seen] ** 2) / np.sum(robust[seen])))
    weights = np.split(robust * precision / inflation**2, np.cumsum([len(e) for e in errors])[:-1])
    for k, (photo, (r, dcm, moves), weight) in enumerate(zip(photos, poses, weights, strict=True)):
        local_n, local_r = np.zeros((COLUMNS, COLUMNS)), np.zeros(COLUMNS)
        accumulate(state.lens, dcm, r, photo.r_LE_E, photo.pixel_px, weight, local_n, local_r)
        to_all = np.zeros((COLUMNS, COMMON + PER_PHOTO))
        to_all[_LENS_PLACES, np.arange(7)] = 1.0
        to_all[1, 0] = 1.0
        to_all[10:] = moves
        own = COMMON + PER_PHOTO * k
        places = np.r_[0:COMMON, own : own + PER_PHOTO]
        normal[np.ix_(places, places)] += to_all.T @ local_n @ to_all
        right[places] += to_all.T @ local_r
    return normal, right


def _add_priors(normal: F64, right: F64, state: Adjustment, priors: Priors) -> NDArray[np.bool_]:
    """Add the priors; returns which parameters are free."""
    n = len(state.time_s)
    sigma = np.concatenate([priors.common, np.zeros(PER_PHOTO * n)])
    value = np.concatenate([state.common, np.column_stack([state.attitude, state.time_s]).ravel()])
    sigma[COMMON:] = np.column_stack([np.full((n, 3), priors.attitude), priors.time_s]).ravel()
    sigma[CLOCK] = 0.0
    free = sigma > 0.0
    soft = np.flatnonzero(free & np.isfinite(sigma))
    normal[soft, soft] += 1.0 / sigma[soft] ** 2
    right[soft] -= value[soft] / sigma[soft] ** 2
    if np.all(np.diag(priors.clock_cov) > 0.0):
        free[CLOCK] = True
        information = np.linalg.inv(priors.clock_cov)
        normal[CLOCK, CLOCK] += information
        right[CLOCK] -= information @ (state.common[CLOCK] - priors.clock_mean)
    return free


def _move(state: Adjustment, step: F64) -> None:
    """Apply a correction to all parameters."""
    state.common = state.common + step[:COMMON]
    lens = state.lens.copy()
    lens[list(_LENS_PLACES)] += step[LENS]
    lens[1] += step[0]
    lens[10] = monotonic_limit(float(lens[5]), float(lens[6]), float(lens[9]))
    state.lens = lens
    state.dcm_CO = dcm_from_rotation_vector(step[MOUNT]) @ state.dcm_CO
    own = step[COMMON:].reshape(-1, PER_PHOTO)
    state.attitude, state.time_s = state.attitude + own[:, :3], state.time_s + own[:, 3]


def adjust(
    state: Adjustment,
    photos: list[PhotoData],
    orbit: TleOrbit,
    reference_s: float,
    priors: Priors,
    iterations: int = 25,
) -> Adjustment:
    """Iterate Gauss-Newton steps with robust weights until the parameters rest.

    Args:
        state: where to begin; changed and returned. photos: one or more. orbit: positions refer to it.
        reference_s: time to which clock and track rate refer. priors: what is known before. iterations: at most.
    """
    tau = np.array([p.exposure_s for p in photos]) - reference_s
    for _ in range(iterations):
        normal, right = _equations(state, photos, tau, orbit, priors.inflation)
        free = np.flatnonzero(_add_priors(normal, right, state, priors))
        kept = normal[np.ix_(free, free)]
        scale = 1.0 / np.sqrt(np.diag(kept))
        inverse = np.linalg.inv(kept * np.outer(scale, scale)) * np.outer(scale, scale)
        step = np.zeros(len(right))
        step[free] = inverse @ right[free]
        _move(state, step)
        P = np.zeros_like(normal)
        P[np.ix_(free, free)] = inverse
        state.P = P[:COMMON, :COMMON]
        if np.all(np.abs(step[free]) < 0.02 * np.sqrt(np.diag(inverse))):
            state.converged = True
            break
    return state
