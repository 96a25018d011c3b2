"""Arithmetic of the predicted pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from messages.orbit import OrbitClockMsg

F64 = NDArray[np.float64]


def corrected_time_s(exposure_ns: int, clock: OrbitClockMsg | None) -> float:
    """Simulation time of an exposure, s: what the stamps say, plus the estimated correction of the shutter's clock."""
    if clock is None:
        return exposure_ns * 1e-9
    return exposure_ns * 1e-9 + clock.clock_s + clock.clock_rate * (exposure_ns - clock.reference_ns) * 1e-9


def prior_covariance(dcm_HE: F64, sigma_H: F64, sigma_C: F64) -> F64:
    """Covariance (6, 6) of position in E (m) and attitude error in C (rad), from standard deviations in H and C."""
    P = np.zeros((6, 6))
    P[:3, :3] = dcm_HE.T @ np.diag(sigma_H**2) @ dcm_HE
    P[3:, 3:] = np.diag(sigma_C**2)
    return P
