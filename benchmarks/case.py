"""What both sides are given. Imports nothing of either, so that neither pays for the other when starts are timed."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray


class Case(msgspec.Struct, frozen=True):
    """Initial state and parameters of the spacecraft and the closed loop, SI, in the notation of docs/conventions.md.

    ``C`` and ``S`` are fully normalised harmonics up to ``degree``; with degree 0 the field is J2 alone.
    """

    r_BN_N: NDArray[np.float64]
    v_BN_N: NDArray[np.float64]
    sigma_BN: NDArray[np.float64]
    omega_BN_B: NDArray[np.float64]
    inertia_B: NDArray[np.float64]
    mu: float
    radius: float
    j2: float
    mass: float = 750.0
    gain_K: float = 3.5
    gain_P: float = 30.0
    period_ns: int = 100_000_000
    degree: int = 0
    C: NDArray[np.float64] | None = None
    S: NDArray[np.float64] | None = None


class Sky(msgspec.Struct, frozen=True):
    """What surrounds the spacecraft, SI.

    Attributes:
        sun_elements: orbit of the Sun about the Earth at time zero: a, e, i, node, argument of perigee, true anomaly.
        year: time zero as a decimal year. wmm_file: coefficients of WMM2025. dipole: g10, g11, h11 [T].
        field_radius: of the dipole. earth_radius: that casts the shadow. air: density and scale height of one band,
        above a sphere of ``earth_radius``.
    """

    sun_elements: tuple[float, ...]
    year: float
    wmm_file: str
    dipole: tuple[float, float, float]
    field_radius: float
    earth_radius: float
    air: tuple[float, float] = (1.217, 20e3)


PERIOD_S = 3
"""Tick of the single modules: 2,000 of them are an orbit, so that light and shadow are met as often as in flight."""
FAST, STARS, SLOW = 100, 500, 1000
"""Periods of the whole graph on both sides, ms: motion and inertial sensors, star tracker, all else."""
