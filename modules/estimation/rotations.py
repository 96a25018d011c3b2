"""Rotations for modules of the Python tier: numpy arrays in and out, by SciPy. Conventions: `fsw.math.attitude`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

F64 = NDArray[np.float64]


def beta_from_dcm(dcm_BN: F64) -> F64:
    """Euler parameters beta_BN (4,), scalar first and not negative, of dcm_BN (3, 3)."""
    rotation: Any = Rotation.from_matrix(np.asarray(dcm_BN).T)
    return np.asarray(rotation.as_quat(canonical=True, scalar_first=True), float)


def dcm_from_beta(beta_BN: F64) -> F64:
    """dcm_BN (3, 3) of Euler parameters beta_BN (4,), scalar first."""
    rotation: Any = Rotation.from_quat(np.asarray(beta_BN), scalar_first=True)
    return np.asarray(rotation.as_matrix(), float).T


def dcm_from_rotation_vector(phi: F64) -> F64:
    """dcm_BN (3, 3), if B is N turned by ``phi`` (3,) rad."""
    rotation: Any = Rotation.from_rotvec(np.asarray(phi))
    return np.asarray(rotation.as_matrix(), float).T


def rotation_vector(dcm_BN: F64) -> F64:
    """Rotation vector (3,) rad that turns N into B."""
    rotation: Any = Rotation.from_matrix(np.asarray(dcm_BN).T)
    return np.asarray(rotation.as_rotvec(), float)


def mean_dcm(dcms: list[F64]) -> F64:
    """The rotation nearest to all of the given ones in the sense of least squares (chordal mean), (3, 3)."""
    u, _, vt = np.linalg.svd(np.sum(np.asarray(dcms), axis=0))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
