"""Where the Sun stands in an image, from attitude and ephemeris."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import mrp_to_dcm
from fsw.math.camera import lens_vector, undistort_point
from fsw.math.compiled import plain
from messages.base import F64
from messages.environment import EphemerisMsg
from messages.opnav import CameraConfigMsg
from messages.states import NavAttMsg
from modules.opnav.disks.coarse import Light
from modules.opnav.disks.photometry import View

HEAD_ON_SINE = 0.03
"""With the Sun nearer to the line of sight, or opposite to it, than this [rad], the whole limb may be lit."""


def _dcm_BN(attitude: NavAttMsg) -> F64:
    s1, s2, s3 = attitude.sigma_BN.tolist()
    return np.array(plain(mrp_to_dcm)((s1, s2, s3)))


def view_of(camera: CameraConfigMsg | None, attitude: NavAttMsg | None, sun: EphemerisMsg | None) -> View | None:
    """The camera and the Sun's direction in its frame, the Sun infinitely far away; None if something is missing."""
    if camera is None or attitude is None or sun is None:
        return None
    s_C = camera.dcm_CB @ _dcm_BN(attitude) @ sun.r_PN_N
    return View(lens_vector(camera), s_C / max(float(np.linalg.norm(s_C)), 1.0))


def sun_at(view: View, x: float, y: float) -> Light:
    """Azimuth of the Sun in the image of a body that is seen at column ``x``, row ``y``, from column towards row.

    It is the way in which the image of a point moves when it goes towards the Sun.
    """
    tx, ty = plain(undistort_point)(view.lens, x, y)
    if not math.isfinite(tx):
        tx, ty = (x - view.lens[2]) / view.lens[0], (y - view.lens[3]) / view.lens[1]
    sx, sy, sz = view.sun.tolist()
    across = np.linalg.norm(np.cross(view.sun, [tx, ty, 1.0])) / math.sqrt(tx * tx + ty * ty + 1.0)
    u = view.lens[0] * (sx - tx * sz) + view.lens[4] * (sy - ty * sz)
    v = view.lens[1] * (sy - ty * sz)
    return Light(math.atan2(v, u), 1.0 if across > HEAD_ON_SINE else 0.0)
