"""The 13 numbers of the filter, their pose, and how the two error states go over into each other.

State x: r_BN_N, v_BN_N, Euler parameters beta_BO (scalar first), omega_BO_B. The filter's error has 12 numbers: dr, dv
(N), theta_BO, domega_BO (B), with the true attitude (I - [theta x]) dcm_BO. The models of `pose_models` take the error
of the pose relative to N: dr, dv, theta_BN, domega_BN. With theta_ON and domega_ON of `orbit`:

    theta_BN = theta_BO + dcm_BO theta_ON,    domega_BN = domega_BO + [w x] theta_BO + dcm_BO domega_ON,

w = dcm_BO omega_ON. So the matrix T of this is lower triangular with a diagonal of ones, and so is its inverse.
"""

from __future__ import annotations

import math

from fsw.math.attitude import ep_compose, ep_normalize, ep_to_dcm, rotvec_to_ep
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, add, matmul, matvec, store3, store4, vec3, vec4
from messages.base import F64
from modules.estimation.earth_tracker_ekf.orbit import Frame, Gravity, gravity_at, orbit_frame_derivatives
from modules.estimation.pose_models.pose import OMEGA, SIZE, THETA, Pose, R, V, put_block

BETA, RATE, STATES = 6, 10, 13
"""First columns of attitude and rate in x, and its length."""


@compiled
def frame_of(x: F64, field: Gravity) -> Frame:
    """The orbit frame of a state (13,)."""
    r, v = vec3(x[R:V]), vec3(x[V:BETA])
    a, G = gravity_at(r, field)
    return orbit_frame_derivatives(r, v, a, G)


@compiled
def pose_of(x: F64, frame: Frame) -> Pose:
    """The pose relative to N of a state (13,) in its orbit frame."""
    dcm_BO = ep_to_dcm(vec4(x[BETA:RATE]))
    return vec3(x[R:V]), vec3(x[V:BETA]), matmul(dcm_BO, frame[0]), add(vec3(x[RATE:]), matvec(dcm_BO, frame[1]))


@compiled
def to_pose_error(x: F64, frame: Frame, T: F64, inverse: bool) -> None:
    """T (12, 12): the error of the pose by the error of the state (13,); or its inverse."""
    _, omega_ON_O, turn_r, turn_v, rate_r, rate_v = frame
    dcm_BO = ep_to_dcm(vec4(x[BETA:RATE]))
    w = matvec(dcm_BO, omega_ON_O)
    sign = -1.0 if inverse else 1.0
    for i in range(SIZE):
        for j in range(SIZE):
            T[i, j] = 1.0 if i == j else 0.0
    put_block(T, THETA, R, matmul(dcm_BO, turn_r))
    put_block(T, THETA, V, matmul(dcm_BO, turn_v))
    put_block(T, OMEGA, R, matmul(dcm_BO, rate_r))
    put_block(T, OMEGA, V, matmul(dcm_BO, rate_v))
    w_cross = ((0.0, -w[2], w[1]), (w[2], 0.0, -w[0]), (-w[1], w[0], 0.0))
    for j in range(6):
        if inverse:  # what [w x] does to the turn of O
            seen = matvec(w_cross, (T[THETA, j], T[THETA + 1, j], T[THETA + 2, j]))
            for i in range(3):
                T[OMEGA + i, j] = seen[i] - T[OMEGA + i, j]
                T[THETA + i, j] *= -1.0
    for i in range(3):
        for j in range(3):
            T[OMEGA + i, THETA + j] = sign * w_cross[i][j]


@compiled
def corrected(x: F64, dx: F64, out: F64) -> bool:
    """The state (13,) after a correction (12,) of its error, into ``out`` (13,); whether it is finite."""
    for i in range(BETA):
        out[i] = x[i] + dx[i]
    for i in range(3):
        out[RATE + i] = x[RATE + i] + dx[OMEGA + i]
    turn = rotvec_to_ep(vec3(dx[THETA:OMEGA]))
    store4(out[BETA:RATE], ep_normalize(ep_compose(turn, vec4(x[BETA:RATE]))))
    total = 0.0
    for i in range(STATES):
        total += out[i]
    return math.isfinite(total)


@compiled
def carry_over(theta: V3, P: F64) -> None:
    """Covariance P (12, 12) after the attitude was corrected by theta [rad]: the axes of its error have turned by half.

    P <- G P G' with G = I - [theta x] / 2 in the attitude (Markley 2003, "Attitude error representations for Kalman
    filtering", JGCD 26:2).
    """
    half = (0.5 * theta[0], 0.5 * theta[1], 0.5 * theta[2])
    G = ((1.0, half[2], -half[1]), (-half[2], 1.0, half[0]), (half[1], -half[0], 1.0))
    for j in range(SIZE):
        column = matvec(G, (P[THETA, j], P[THETA + 1, j], P[THETA + 2, j]))
        for i in range(3):
            P[THETA + i, j] = column[i]
    for i in range(SIZE):
        store3(P[i, THETA:OMEGA], matvec(G, (P[i, THETA], P[i, THETA + 1], P[i, THETA + 2])))
    for i in range(SIZE):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
