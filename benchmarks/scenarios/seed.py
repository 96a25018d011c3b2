"""The source's filter on the measurements of a scenario, in its three flavours."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.baselines.seed_ekf import AS_WRITTEN, BUG_FIXED, SeedEkf, Settings, tuned
from benchmarks.scenarios.pose_truth import Cached, Setup, draw, rotvec, sensed, turn
from messages.base import F64

KNOWN_STARS = np.eye(3)[:2]
"""Directions whose measured images stand for the star tracker, which the source has as vectors."""
TRAINING = 1000, 1001
"""Seeds on which the tuned flavour is tuned; the runs that are judged have others."""
TRAINING_S = 200


def start(cached: Cached, x0: F64) -> F64:
    """The 13 numbers that the run begins with: the truth, wrong by the draw."""
    r, v, dcm_BN = cached.scene.truth.at(0.0)
    r, v, dcm_BN = r - x0[:3], v - x0[3:6], turn(-x0[6:9]) @ dcm_BN
    z, y = -r / np.linalg.norm(r), -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    dcm_BO = dcm_BN @ np.array([np.cross(y, z), y, z]).T
    rotation: Any = Rotation.from_matrix(dcm_BO.T)
    rate = float(np.linalg.norm(np.cross(r, v)) / (r @ r))
    omega_BO = cached.scene.truth.omega(0.0) - dcm_BO @ np.array([0.0, -rate, 0.0])
    return np.concatenate([r, v, rotation.as_quat(scalar_first=True), omega_BO])


def flown(cached: Cached, setup: Setup, seed: int, settings: Settings, every: int, duration: int) -> F64:
    """Errors (K, 12) of position, velocity and attitude at every tenth second; NaN once the filter has broken."""
    made = draw(setup, cached.scene.focal, seed)
    ekf = SeedEkf(start(cached, made.x0), settings)
    errors: list[F64] = []
    with np.errstate(all="ignore"):
        for now in sensed(cached, setup, made, seed):
            if now.t > duration:
                break
            error = np.full(12, np.nan)
            try:
                ekf.predict(1.0)
                ekf.gyro(now.rate)
                if now.star is not None:
                    rotation: Any = Rotation.from_quat(now.star, scalar_first=True)
                    ekf.star_vectors(KNOWN_STARS @ np.asarray(rotation.as_matrix()), KNOWN_STARS)
                if now.image is not None:
                    ekf.earth_tracker(now.image[2], now.image[1])
                if now.gps is not None:
                    ekf.gps(now.gps[0])
                r, v, dcm_BN, _ = cached.states[now.t]
                error[:6] = np.concatenate([r, v]) - ekf.x[:6]
                error[6:9] = rotvec(dcm_BN @ ekf.dcm_BN().T)
            except (np.linalg.LinAlgError, ValueError):
                pass
            if now.t % every == 0:
                errors.append(error)
    return np.array(errors)


def settings_of(cached: Cached, setup: Setup, flavour: str, altitude: float) -> Settings:
    """What the source leaves open, as the scenario has it."""
    return Settings(
        flavour=flavour, focal_px=cached.scene.focal, altitude=altitude, sigma_px=setup.sigma_px, sigma_star=1.5e-4
    )


def study(cached: Cached, setup: Setup, flavour: str, runs: int, altitude: float, every: int) -> tuple[F64, float]:
    """Errors (runs, K, 12) of a flavour, and milliseconds for each image.

    Args:
        cached: truth.
        setup: measurements.
        flavour: `AS_WRITTEN`, `BUG_FIXED` or "tuned".
        runs: seeds 0 to runs - 1.
        altitude: that the ground sampling distance assumes [m].
        every: seconds between epochs.
    """
    settings = settings_of(cached, setup, AS_WRITTEN if flavour == AS_WRITTEN else BUG_FIXED, altitude)
    if flavour == "tuned":

        def cost(tried: Settings) -> float:
            e = [flown(cached, setup, seed, tried, every, TRAINING_S) for seed in TRAINING]
            value = float(np.sqrt(np.mean(np.square(np.array(e)[:, TRAINING_S // every // 2 :, :3]))))
            return value if math.isfinite(value) else math.inf

        settings = tuned(settings, cost, depths=(100.0, 1e3, 1e4), pixels=(1.0,), noises=(1.0, 100.0))
    began = time.process_time()
    errors = np.array([flown(cached, setup, seed, settings, every, cached.duration) for seed in range(runs)])
    spent = time.process_time() - began
    return errors, 1e3 * spent / max(1, runs * len(cached.scene.images))
