"""Normal equations of landmarks, compiled: one pass over the landmarks of one photo."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.camera import project_derivatives
from fsw.math.compiled import compiled

F64 = NDArray[np.float64]

LENS_COLUMNS = 10
"""fx, fy, cx, cy, skew, k1, k2, p1, p2, k3."""

POSE_COLUMNS = 6
"""Position of the camera in C components (m), attitude error about C (rad)."""

COLUMNS = LENS_COLUMNS + POSE_COLUMNS


@compiled
def residuals(lens: F64, dcm_CE: F64, r_CE_E: F64, r_LE_E: F64, pixel_px: F64, out: F64) -> None:
    """Found minus predicted pixel of each landmark, into ``out`` (n, 2) px; NaN where the lens cannot see it.

    Args:
        lens: lens vector (11,). dcm_CE: (3, 3). r_CE_E: (3,) m. r_LE_E: (n, 3) m. pixel_px: (n, 2) px.
        out: written.
    """
    d_point, d_lens = np.empty((2, 3)), np.empty((2, 10))
    for i in range(r_LE_E.shape[0]):
        dx, dy, dz = r_LE_E[i, 0] - r_CE_E[0], r_LE_E[i, 1] - r_CE_E[1], r_LE_E[i, 2] - r_CE_E[2]
        x = dcm_CE[0, 0] * dx + dcm_CE[0, 1] * dy + dcm_CE[0, 2] * dz
        y = dcm_CE[1, 0] * dx + dcm_CE[1, 1] * dy + dcm_CE[1, 2] * dz
        z = dcm_CE[2, 0] * dx + dcm_CE[2, 1] * dy + dcm_CE[2, 2] * dz
        u, v = project_derivatives(lens, x, y, z, d_point, d_lens)
        out[i, 0], out[i, 1] = pixel_px[i, 0] - u, pixel_px[i, 1] - v


@compiled
def accumulate(
    lens: F64, dcm_CE: F64, r_CE_E: F64, r_LE_E: F64, pixel_px: F64, weight: F64, normal: F64, right: F64
) -> None:
    """Add the normal equations of one photo's landmarks by lens and pose.

    The columns are `LENS_COLUMNS`, then the camera's displacement in C components, then the attitude error theta, with
    dcm_true = (I - [theta x]) dcm_CE: a point r_C moves by -displacement and by r_C x theta.

    Args:
        lens, dcm_CE, r_CE_E, r_LE_E, pixel_px: as in `residuals`.
        weight: (n,) 1/px^2; a landmark that the lens cannot see is left out.
        normal: (16, 16) added to. right: (16,) added to.
    """
    d_point, d_lens, row = np.empty((2, 3)), np.empty((2, 10)), np.empty(16)
    for i in range(r_LE_E.shape[0]):
        dx, dy, dz = r_LE_E[i, 0] - r_CE_E[0], r_LE_E[i, 1] - r_CE_E[1], r_LE_E[i, 2] - r_CE_E[2]
        x = dcm_CE[0, 0] * dx + dcm_CE[0, 1] * dy + dcm_CE[0, 2] * dz
        y = dcm_CE[1, 0] * dx + dcm_CE[1, 1] * dy + dcm_CE[1, 2] * dz
        z = dcm_CE[2, 0] * dx + dcm_CE[2, 1] * dy + dcm_CE[2, 2] * dz
        u, v = project_derivatives(lens, x, y, z, d_point, d_lens)
        if math.isnan(u) or math.isnan(v):
            continue
        for axis in range(2):
            error = pixel_px[i, axis] - (u if axis == 0 else v)
            gx, gy, gz = d_point[axis, 0], d_point[axis, 1], d_point[axis, 2]
            for j in range(10):
                row[j] = d_lens[axis, j]
            row[10], row[11], row[12] = -gx, -gy, -gz
            row[13] = gy * z - gz * y
            row[14] = gz * x - gx * z
            row[15] = gx * y - gy * x
            for j in range(16):
                wj = weight[i] * row[j]
                right[j] += wj * error
                for k in range(16):
                    normal[j, k] += wj * row[k]
