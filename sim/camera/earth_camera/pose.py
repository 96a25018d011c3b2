"""Where the camera is at each row of an exposure, Earth-fixed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from messages.base import F64


class Pose(NamedTuple):
    """Position and attitude of a camera at each of its rows; the last entry stands for all rows after it."""

    r_CE_E: F64
    """(n, 3) [m]."""
    dcm_CE: F64
    """(n, 3, 3)."""
    dcm_EN: F64
    """(n, 3, 3), for what is fixed to N: stars."""


class Motion(NamedTuple):
    """A moving camera at one instant: of the body B as in `SCStatesMsg`, of the Earth as in `PlanetOrientationMsg`."""

    r_BN_N: F64
    v_BN_N: F64
    dcm_BN: F64
    omega_BN_B: F64
    dcm_EN: F64
    omega_EN_N: F64

    def after(self, seconds: F64, dcm_CB: F64, r_CB_B: F64) -> Pose:
        """The pose (n entries) at times after the instant (n,) [s], with constant velocity and rates.

        Args:
            seconds: a fraction of a second at most: without acceleration, 0.1 s are 5 cm in low orbit.
            dcm_CB: mounting of the camera, maps body to camera components (3, 3).
            r_CB_B: position of the camera relative to B, B components (3,) [m].
        """
        dcm_BN = turned(self.omega_BN_B, seconds) @ self.dcm_BN
        dcm_EN = self.dcm_EN @ turned(self.omega_EN_N, seconds)
        r_N = self.r_BN_N + seconds[:, None] * self.v_BN_N + np.einsum("nji,j->ni", dcm_BN, r_CB_B)
        dcm_CE = dcm_CB @ dcm_BN @ np.swapaxes(dcm_EN, 1, 2)
        return Pose(np.einsum("nij,nj->ni", dcm_EN, r_N), np.ascontiguousarray(dcm_CE), dcm_EN)


def turned(omega: F64, seconds: F64) -> F64:
    """The matrices (n, 3, 3) of frames that turn with omega (3,) [rad/s], after times (n,) [s]; passive."""
    x, y, z = omega
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rate = float(np.linalg.norm(omega))
    angle = (rate * seconds)[:, None, None]
    if rate == 0.0:
        return np.broadcast_to(np.eye(3), (len(seconds), 3, 3))
    skew /= rate
    return np.eye(3) - np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)
