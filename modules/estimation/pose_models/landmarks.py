"""A landmark on the ground: its pixel, or the direction to it.

Sources: `fsw.math.camera` for the lens; derivatives as in the audit of the source, section B6: with p the landmark from
the camera, dp_C/dr_N = -dcm_CN, dp_C/dtheta = dcm_CB [p_B x], misalignment mu (true dcm_CB = (I - [mu x]) dcm_CB):
[p_C x].
"""

from __future__ import annotations

import math

from fsw.math.camera import project_derivatives
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, cross, dot, mat_t_vec, matmul, matvec, norm, scale, sub
from messages.base import F64
from modules.estimation.pose_models.pose import SIZE, THETA, Pose, R, across, put_row, turned_by


@compiled
def landmark_from_camera(pose: Pose, dcm_CB: M3, r_CB_B: V3, dcm_EN: M3, r_LE_E: V3) -> tuple[V3, V3]:
    """The landmark relative to the body's point B, B components, and relative to the camera, C components [m]."""
    r, _, dcm_BN, _ = pose
    p_B = matvec(dcm_BN, sub(mat_t_vec(dcm_EN, r_LE_E), r))
    return p_B, matvec(dcm_CB, sub(p_B, r_CB_B))


@compiled
def _rows(d_point: F64, row: int, pose: Pose, dcm_CB: M3, p_B: V3, p_C: V3, H: F64, H_mount: F64) -> V3:
    """One row of derivatives by pose and misalignment, from its derivative by p_C; returns that by p_B."""
    d_C = (d_point[row, 0], d_point[row, 1], d_point[row, 2])
    d_B = mat_t_vec(dcm_CB, d_C)
    for j in range(SIZE):
        H[row, j] = 0.0
    put_row(H, row, R, scale(-1.0, mat_t_vec(pose[2], d_B)))
    put_row(H, row, THETA, turned_by(d_B, p_B))
    put_row(H_mount, row, 0, turned_by(d_C, p_C))
    return d_B


@compiled
def landmark_pixel(
    pose: Pose,
    dcm_CB: M3,
    r_CB_B: V3,
    lens: F64,
    dcm_EN: M3,
    omega_EN_N: V3,
    r_LE_E: V3,
    H: F64,
    H_mount: F64,
    H_lens: F64,
    H_map: F64,
    d_point: F64,
) -> tuple[float, float, float, float]:
    """Where a landmark is seen, and how that changes.

    Args:
        pose: of the body at the landmark's own exposure.
        dcm_CB: mounting of the camera.
        r_CB_B: camera relative to B [m], B components.
        lens: of `fsw.math.camera.lens_vector` (11,).
        dcm_EN: orientation of the Earth then.
        omega_EN_N: its angular rate [rad/s].
        r_LE_E: the landmark [m].
        H: out (2, 12), by the error of the pose.
        H_mount: out (2, 3), by a small turn mu of the camera [px/rad].
        H_lens: out (2, 10), by the first ten numbers of the lens.
        H_map: out (2, 3), by the landmark's place, E [px/m].
        d_point: work (2, 3).

    Returns:
        Column and row [px], and their rates [px/s]; NaN, with nothing written, behind the camera or outside the
        lens's range.
    """
    p_B, p_C = landmark_from_camera(pose, dcm_CB, r_CB_B, dcm_EN, r_LE_E)
    u, v = project_derivatives(lens, p_C[0], p_C[1], p_C[2], d_point, H_lens)
    if math.isnan(u):
        return u, v, u, v
    _, velocity, dcm_BN, omega = pose
    L_N = mat_t_vec(dcm_EN, r_LE_E)
    moving_B = sub(matvec(dcm_BN, sub(cross(omega_EN_N, L_N), velocity)), cross(omega, p_B))
    du = dot(_rows(d_point, 0, pose, dcm_CB, p_B, p_C, H, H_mount), moving_B)
    dv = dot(_rows(d_point, 1, pose, dcm_CB, p_B, p_C, H, H_mount), moving_B)
    for a in range(2):
        by_N = (H[a, R], H[a, R + 1], H[a, R + 2])
        put_row(H_map, a, 0, scale(-1.0, matvec(dcm_EN, by_N)))
    return u, v, du, dv


@compiled
def landmark_direction(
    pose: Pose,
    dcm_CB: M3,
    r_CB_B: V3,
    dcm_EN: M3,
    r_LE_E: V3,
    u_LC_C: V3,
    H: F64,
    H_mount: F64,
    H_map: F64,
    d_point: F64,
) -> tuple[float, float]:
    """Residual of a measured unit vector to a landmark, on two axes across the predicted one, and its derivatives.

    A unit vector has two free numbers: three of them would have a covariance without inverse.

    Args:
        pose, dcm_CB, r_CB_B, dcm_EN, r_LE_E, H, H_mount, H_map, d_point: as `landmark_pixel`, but [rad] for [px].
        u_LC_C: measured direction from the camera to the landmark.

    Returns:
        The two residuals, measured minus predicted [rad].
    """
    p_B, p_C = landmark_from_camera(pose, dcm_CB, r_CB_B, dcm_EN, r_LE_E)
    distance = norm(p_C)
    first, second = across(scale(1.0 / distance, p_C))
    put_row(d_point, 0, 0, scale(1.0 / distance, first))
    put_row(d_point, 1, 0, scale(1.0 / distance, second))
    for a in range(2):
        _rows(d_point, a, pose, dcm_CB, p_B, p_C, H, H_mount)
        by_N = (H[a, R], H[a, R + 1], H[a, R + 2])
        put_row(H_map, a, 0, scale(-1.0, matvec(dcm_EN, by_N)))
    return dot(first, u_LC_C), dot(second, u_LC_C)


@compiled
def exposed_at(pose: Pose, accel_N: V3, turn: M3, t: float) -> Pose:
    """The pose t [s] after (or, negative, before) its own time, for the rows of a rolling shutter.

    Args:
        pose: at its time.
        accel_N: acceleration [m/s^2].
        turn: rotation of the body in that time, which is `rotvec_to_dcm` of omega t.
        t: some hundredths of a second; the next term is a jerk of t^3 / 6.
    """
    r, v, dcm_BN, omega = pose
    moved = add(r, add(scale(t, v), scale(0.5 * t * t, accel_N)))
    return moved, add(v, scale(t, accel_N)), matmul(turn, dcm_BN), omega
