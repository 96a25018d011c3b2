"""What both sides are given. Imports nothing of either, so that neither pays for the other when starts are timed."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray


class Case(msgspec.Struct, frozen=True):
    """Initial state and parameters of the closed loop, SI, in the notation of docs/conventions.md."""

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
