"""Where the Sun stands in an image, from attitude and ephemeris."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import mrp_to_dcm
from fsw.math.compiled import plain
from messages.base import F64
from messages.environment import EphemerisMsg
from messages.opnav import CameraConfigMsg
from messages.states import NavAttMsg
from modules.opnav.disks.coarse import Light

HEAD_ON_SINE = 0.03
"""Nearer to the boresight, or opposite to it, than this [rad], the azimuth says nothing: the whole limb may be lit."""


def _dcm_BN(attitude: NavAttMsg) -> F64:
    s1, s2, s3 = attitude.sigma_BN.tolist()
    return np.array(plain(mrp_to_dcm)((s1, s2, s3)))


def sun_in_image(camera: CameraConfigMsg | None, attitude: NavAttMsg | None, sun: EphemerisMsg | None) -> Light | None:
    """Azimuth of the Sun's direction across the boresight, from column towards row; None if something is missing.

    The Sun is taken as infinitely far away, and the disk as near the boresight: 20 degrees off are a few in azimuth,
    which the finder's margin at the horns takes.
    """
    if camera is None or attitude is None or sun is None:
        return None
    s_C = camera.dcm_CB @ _dcm_BN(attitude) @ sun.r_PN_N
    across = math.hypot(s_C[0], s_C[1]) / max(float((s_C @ s_C) ** 0.5), 1.0)
    return Light(math.atan2(s_C[1], s_C[0]), 1.0 if across > HEAD_ON_SINE else 0.0)
