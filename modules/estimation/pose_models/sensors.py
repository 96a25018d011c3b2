"""Navigation receiver, gyro, star tracker, stars, Sun sensors and magnetometer.

Each function writes the residual, measured minus predicted, and its derivatives by the error of the pose.
"""

from __future__ import annotations

from fsw.math.attitude import dcm_to_rotvec
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, cross, dot, mat_t_vec, matmul, matvec, store3, sub, transpose
from messages.base import F64
from modules.estimation.pose_models.pose import OMEGA, THETA, Pose, R, V, across, clear, put_block, put_row, turned_by


@compiled
def _crossed(m: M3, a: V3) -> M3:
    """m [a x]: the derivative by theta of m applied to a vector that is ``a`` in B."""
    return turned_by(m[0], a), turned_by(m[1], a), turned_by(m[2], a)


@compiled
def gps(pose: Pose, r_AB_B: V3, dcm_EN: M3, omega_EN_N: V3, r_AE_E: V3, v_AE_E: V3, residual: F64, H: F64) -> None:
    """Position and velocity of an antenna A relative to the turning Earth, E components.

    Args:
        pose: at the time of the fix.
        r_AB_B: antenna relative to B [m], B components.
        dcm_EN: orientation of the Earth then.
        omega_EN_N: its angular rate [rad/s].
        r_AE_E: measured position [m].
        v_AE_E: measured velocity relative to E [m/s].
        residual: out (6,) [m, m/s].
        H: out (6, 12).
    """
    r, v, dcm_BN, omega = pose
    arm_N, whirl_B = mat_t_vec(dcm_BN, r_AB_B), cross(omega, r_AB_B)
    r_A = add(r, arm_N)
    v_A = sub(add(v, mat_t_vec(dcm_BN, whirl_B)), cross(omega_EN_N, r_A))
    store3(residual[:3], sub(r_AE_E, matvec(dcm_EN, r_A)))
    store3(residual[3:], sub(v_AE_E, matvec(dcm_EN, v_A)))
    clear(H)
    # a vector fixed in B is (I + [theta x]) a in the estimated B: by theta, -[a x]
    dcm_EB = matmul(dcm_EN, transpose(dcm_BN))
    by_arm = _crossed(dcm_EB, (-r_AB_B[0], -r_AB_B[1], -r_AB_B[2]))
    by_whirl = _crossed(dcm_EB, (-whirl_B[0], -whirl_B[1], -whirl_B[2]))
    omega_E = matvec(dcm_EN, omega_EN_N)
    put_block(H, 0, R, dcm_EN)
    put_block(H, 0, THETA, by_arm)
    put_block(H, 3, V, dcm_EN)
    put_block(H, 3, OMEGA, by_arm)
    for j in range(3):
        d = cross(omega_E, (dcm_EN[0][j], dcm_EN[1][j], dcm_EN[2][j]))
        e = cross(omega_E, (by_arm[0][j], by_arm[1][j], by_arm[2][j]))
        for i in range(3):
            H[3 + i, R + j] = -d[i]
            H[3 + i, THETA + j] = by_whirl[i][j] - e[i]


@compiled
def gyro(pose: Pose, dcm_PB: M3, bias_P: V3, omega_PN_P: V3, residual: F64, H: F64) -> None:
    """Angular rate with a bias [rad/s], P components: residual (3,), H (3, 12)."""
    store3(residual, sub(omega_PN_P, add(matvec(dcm_PB, pose[3]), bias_P)))
    clear(H)
    put_block(H, 0, OMEGA, dcm_PB)


@compiled
def star_tracker(pose: Pose, dcm_SB: M3, dcm_SN: M3, residual: F64, H: F64) -> None:
    """Attitude dcm_SN of a star tracker: residual (3,) rotation vector [rad], S components; H (3, 12)."""
    store3(residual, dcm_to_rotvec(matmul(dcm_SN, transpose(matmul(dcm_SB, pose[2])))))
    clear(H)
    put_block(H, 0, THETA, dcm_SB)


@compiled
def direction(pose: Pose, dcm_SB: M3, known_N: V3, measured_S: V3, residual: F64, H: F64) -> None:
    """A measured unit vector whose true direction in N is known, such as to a star or to the Sun.

    Args:
        pose: at the time of the measurement.
        dcm_SB: mounting of the sensor.
        known_N: unit vector.
        measured_S: unit vector.
        residual: out (2,) [rad], on two axes across the predicted direction.
        H: out (2, 12).
    """
    seen_B = matvec(pose[2], known_N)
    first, second = across(matvec(dcm_SB, seen_B))
    residual[0], residual[1] = dot(first, measured_S), dot(second, measured_S)
    clear(H)
    put_row(H, 0, THETA, turned_by(mat_t_vec(dcm_SB, first), seen_B))
    put_row(H, 1, THETA, turned_by(mat_t_vec(dcm_SB, second), seen_B))


@compiled
def sun_cell(pose: Pose, normal_B: V3, sun_N: V3, scale: float, signal: float, residual: F64, H: F64) -> float:
    """One coarse Sun sensor that faces the Sun: scale cos(angle).

    Args:
        pose: at the time of the measurement.
        normal_B: unit normal of the cell.
        sun_N: unit vector to the Sun.
        scale: signal of a cell that faces the Sun.
        signal: measured.
        residual: out (1,) [-].
        H: out (1, 12).

    Returns:
        The predicted cosine. The model is that of a lit cell: where it is not well above zero, the cell says
        nothing about the attitude and is not to be used.
    """
    seen_B = matvec(pose[2], sun_N)
    cosine = dot(normal_B, seen_B)
    residual[0] = signal - scale * cosine
    clear(H)
    row = turned_by(normal_B, seen_B)
    put_row(H, 0, THETA, (scale * row[0], scale * row[1], scale * row[2]))
    return cosine


@compiled
def magnetometer(pose: Pose, dcm_SB: M3, B_N: V3, gradient_N: M3, bias_S: V3, B_S: V3, residual: F64, H: F64) -> None:
    """Magnetic flux density.

    Args:
        pose: at the time of the measurement.
        dcm_SB: mounting of the sensor.
        B_N: flux density of the model at the pose's position [T].
        gradient_N: its derivative by the position [T/m].
        bias_S: of the sensor [T].
        B_S: measured [T].
        residual: out (3,) [T].
        H: out (3, 12).
    """
    seen_B = matvec(pose[2], B_N)
    store3(residual, sub(B_S, add(matvec(dcm_SB, seen_B), bias_S)))
    clear(H)
    put_block(H, 0, THETA, _crossed(dcm_SB, seen_B))
    put_block(H, 0, R, matmul(matmul(dcm_SB, pose[2]), gradient_N))
