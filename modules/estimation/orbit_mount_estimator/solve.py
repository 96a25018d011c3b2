"""What goes into the adjustment and what comes out of it: priors and messages."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from messages.base import F64
from messages.opnav import CameraConfigMsg
from messages.orbit import CameraAccuracyMsg, OrbitClockMsg, PhotoTimeMsg
from modules.estimation.orbit_mount_estimator.adjust import CLOCK, LENS, MOUNT, OFFSET, RATE, Adjustment, Priors
from modules.estimation.orbit_mount_estimator.clock import line_within
from modules.estimation.orbit_pose_prior.orbit import TleOrbit

EARTH_RADIUS = 6371e3


class Weights(msgspec.Struct, frozen=True, kw_only=True):
    """The parameters of the estimator, and what the orbit says of itself at the photos' time."""

    params: Any
    focal_px: float
    sigma_H: F64
    height: float
    speed: float

    @classmethod
    def of(cls, params: Any, orbit: TleOrbit, t_s: float, focal_px: float) -> Weights:
        """Evaluate the orbit at one time."""
        r, speed = orbit.at(t_s)[0][0], float(np.linalg.norm(orbit.velocity_earth(t_s)))
        height = float(np.linalg.norm(r)) - EARTH_RADIUS
        return cls(params=params, focal_px=focal_px, sigma_H=orbit.sigma_H(t_s), height=height, speed=speed)


def clock_line(times: list[PhotoTimeMsg], reference_ns: int) -> tuple[F64, F64]:
    """Correction of the shutter's clock at the reference and its rate, as far as the stamps tell.

    Returns:
        Mean (2,) and covariance (2, 2); zeros, which holds the clock, unless the shutter runs evenly.
    """
    held = np.zeros(2), np.zeros((2, 2))
    if len(times) < 2 or not all(t.even for t in times):
        return held
    exposure = np.array([t.exposure_ns for t in times]) * 1e-9
    earliest = np.array([t.earliest_ns for t in times]) * 1e-9 - exposure
    latest = np.array([t.latest_ns for t in times]) * 1e-9 - exposure
    tau = exposure - reference_ns * 1e-9
    reach = 2.0 * float(np.max(latest - earliest)) / float(np.ptp(tau))
    return line_within(earliest, latest, tau, np.linspace(-reach, reach, 2001)) or held


def within_stamps(times: list[PhotoTimeMsg], reference_ns: int, inside: F64, clock: F64) -> F64:
    """The point nearest to ``clock`` on the way from ``inside`` to it that puts no exposure outside its stamp."""
    exposure = np.array([t.exposure_ns for t in times]) * 1e-9
    tau = exposure - reference_ns * 1e-9
    low = np.array([t.earliest_ns for t in times]) * 1e-9 - exposure
    high = np.array([t.latest_ns for t in times]) * 1e-9 - exposure
    begun, way = inside[0] + inside[1] * tau, (clock[0] - inside[0]) + (clock[1] - inside[1]) * tau
    room = np.where(way > 0.0, high - begun, np.where(way < 0.0, low - begun, 0.0))
    share = np.divide(room, way, out=np.ones_like(way), where=way != 0.0)
    part = float(np.clip(share.min(), 0.0, 1.0))
    return clock if part >= 1.0 else inside + part * (clock - inside)


def _own_times(weights: Weights, times: list[PhotoTimeMsg]) -> F64:
    even = all(t.even for t in times)
    return np.array([weights.params.sigma_shutter if even else max(t.sigma_s, 1e-6) for t in times])


def held_priors(weights: Weights, times: list[PhotoTimeMsg], line: tuple[F64, F64]) -> Priors:
    """Calibration: lens, mounting and clock are free, positions are held to the orbit."""
    p = weights.params
    common = np.zeros(16)
    common[LENS] = [
        p.sigma_focal * weights.focal_px,
        *[p.sigma_center] * 2,
        *[p.sigma_radial] * 2,
        *[p.sigma_tangential] * 2,
    ]
    common[MOUNT] = np.inf
    return Priors(
        common=common,
        clock_mean=line[0],
        clock_cov=line[1],
        attitude=p.sigma_attitude,
        time_s=_own_times(weights, times),
        inflation=p.inflation,
    )


def arc_priors(weights: Weights, times: list[PhotoTimeMsg], clock: F64) -> Priors:
    """Track: lens and clock are held, mounting and track are free within what is known of them."""
    p = weights.params
    common = np.zeros(16)
    common[MOUNT], common[OFFSET], common[RATE] = p.sigma_attitude, weights.sigma_H, p.sigma_rate
    return Priors(
        common=common,
        clock_mean=clock,
        clock_cov=np.zeros((2, 2)),
        attitude=p.sigma_attitude,
        time_s=_own_times(weights, times),
        inflation=p.inflation,
    )


def camera_message(state: Adjustment, before: CameraConfigMsg) -> CameraConfigMsg:
    """The calibrated camera."""
    lens = state.lens
    return CameraConfigMsg(
        width_px=before.width_px,
        height_px=before.height_px,
        focal_px=lens[:2],
        center_px=lens[2:4],
        skew_px=float(lens[4]),
        distortion=lens[5:10],
        dcm_CB=state.dcm_CO,
    )


def accuracy_message(state: Adjustment, weights: Weights) -> CameraAccuracyMsg:
    """How well it is known, with the part that comes from holding positions to the orbit.

    A radial error dR of the orbit makes the focal length wrong by f dR / h, and the fixes are then wrong by dR again;
    along and across the track, an error goes into principal point and mounting, and comes back in the fixes.
    """
    sigma = np.sqrt(np.clip(np.diag(state.P), 0.0, None))
    focal = float(state.lens[0])
    inherited = focal * weights.sigma_H / weights.height
    common_H = weights.sigma_H.copy()
    common_H[1] = np.hypot(common_H[1], weights.speed * sigma[CLOCK][0])
    deviation = np.sqrt(np.mean(state.attitude**2, axis=0)) if len(state.attitude) > 1 else np.zeros(3)
    distortion = np.array([*sigma[3:7], 0.0])
    return CameraAccuracyMsg(
        photos=len(state.attitude),
        rms_px=state.rms_px,
        sigma_focal_px=float(np.hypot(sigma[0], inherited[0])),
        sigma_center_px=sigma[1:3],
        sigma_distortion=distortion,
        sigma_mounting=np.sqrt(sigma[MOUNT] ** 2 + deviation**2 + weights.params.sigma_attitude**2),
        sigma_common_H=common_H,
    )


def clock_message(state: Adjustment, weights: Weights, reference_ns: int, clock_P: F64) -> OrbitClockMsg:
    """Track and clock, the latter with the covariance of its calibration. Positions that were held have the orbit's."""
    P = np.zeros((6, 6))
    P[:4, :4] = state.P[12:16, 12:16]
    P[4:, 4:] = clock_P
    if not P[0, 0] > 0.0:
        P[:3, :3] = np.diag(weights.sigma_H**2)
    return OrbitClockMsg(
        photos=len(state.attitude),
        landmarks=state.landmarks,
        rms_px=state.rms_px,
        reference_ns=reference_ns,
        offset_H=state.common[OFFSET],
        rate_T=float(state.common[RATE]),
        clock_s=float(state.common[CLOCK][0]),
        clock_rate=float(state.common[CLOCK][1]),
        P=P,
    )
