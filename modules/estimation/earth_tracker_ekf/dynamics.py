"""Motion of the 13 states and of the covariance of their error.

The source's equations of motion with the corrections of its audit: gravity with J2, Runge-Kutta steps, and Euler's
equation in the form that holds for the rate relative to the orbit frame,

    domega_BO/dt = I^-1 (T - omega_BN x I omega_BN) + omega_BO x w - dcm_BO domega_ON/dt,    w = dcm_BO omega_ON,

with omega_BN = omega_BO + w. The transition of the error of the pose is integrated along with it by the same steps
(its derivatives are simple); that of the filter's error is T(end)^-1 Phi T(start), see `error`.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from fsw.math.attitude import ep_normalize, ep_rate, ep_to_dcm
from fsw.math.compiled import compiled
from fsw.math.square_root import NOT_FINITE, OK
from fsw.math.vectors import (
    M3,
    V3,
    add,
    cross,
    dot,
    matmul,
    matmul_into,
    matvec,
    norm,
    scale,
    store3,
    store4,
    sub,
    vec3,
    vec4,
)
from messages.base import F64
from modules.estimation.earth_tracker_ekf.error import BETA, RATE, STATES, frame_of, to_pose_error
from modules.estimation.earth_tracker_ekf.orbit import Gravity, gravity_at, orbit_frame_derivatives
from modules.estimation.pose_models.pose import OMEGA, SIZE, THETA, R, V

Body: TypeAlias = tuple[Gravity, M3, M3, V3, bool, float]
"""Gravity; inertia [kg m^2] and its inverse; torque [N m], B; whether gravity's gradient turns it; longest step [s]."""
TURN = 0.005
"""Largest turn of the body in a step [rad]."""


@compiled
def cross_matrix(a: V3) -> M3:
    """[a x]."""
    return (0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0)


@compiled
def gradient_torque(r_N: V3, dcm_BN: M3, mu: float, inertia: M3) -> tuple[V3, M3, M3]:
    """Torque [N m] of the gradient of gravity, B, and its derivatives by r (N) and by the attitude error."""
    far = norm(r_N)
    u_N = scale(1.0 / far, r_N)
    n = matvec(dcm_BN, u_N)
    k, In = 3.0 * mu / (far * far * far), matvec(inertia, n)
    torque = scale(k, cross(n, In))
    # d(n x I n) = ([n x] I - [(I n) x]) dn, with dn = [n x] theta, and dn = dcm_BN (I - u u') dr / r
    by_n, less = matmul(cross_matrix(n), inertia), cross_matrix(In)
    by_n = (sub(by_n[0], less[0]), sub(by_n[1], less[1]), sub(by_n[2], less[2]))
    by_n = (scale(k, by_n[0]), scale(k, by_n[1]), scale(k, by_n[2]))
    by_N = matmul(by_n, dcm_BN)
    rows = matvec(by_N, u_N)
    by_r = (
        scale(1.0 / far, sub(by_N[0], scale(rows[0] + 3.0 * torque[0], u_N))),
        scale(1.0 / far, sub(by_N[1], scale(rows[1] + 3.0 * torque[1], u_N))),
        scale(1.0 / far, sub(by_N[2], scale(rows[2] + 3.0 * torque[2], u_N))),
    )
    return torque, by_r, matmul(by_n, cross_matrix(n))


@compiled
def slope(x: F64, Phi: F64, body: Body, dx: F64, dPhi: F64) -> None:
    """Time derivatives of a state (13,) and of the transition (12, 12) of the error of its pose."""
    field, inertia, inverse, torque, gradient, _ = body
    r, v, beta, omega_BO = vec3(x[R:V]), vec3(x[V:BETA]), vec4(x[BETA:RATE]), vec3(x[RATE:])
    a, G = gravity_at(r, field)
    dcm_ON, omega_ON_O, _, _, rate_r, rate_v = orbit_frame_derivatives(r, v, a, G)
    dcm_BO = ep_to_dcm(beta)
    w = matvec(dcm_BO, omega_ON_O)
    omega = add(omega_BO, w)
    momentum = matvec(inertia, omega)
    by_r, by_theta = cross_matrix((0.0, 0.0, 0.0)), cross_matrix((0.0, 0.0, 0.0))
    if gradient:
        extra, by_r, by_theta = gradient_torque(r, matmul(dcm_BO, dcm_ON), field[0], inertia)
        torque = add(torque, extra)
        by_r, by_theta = matmul(inverse, by_r), matmul(inverse, by_theta)
    turning = add(matvec(rate_r, v), matvec(rate_v, a))  # of O: the derivative of its rate along the motion
    absolute = matvec(inverse, sub(torque, cross(omega, momentum)))
    store3(dx[R:V], v)
    store3(dx[V:BETA], a)
    store4(dx[BETA:RATE], ep_rate(beta, omega_BO))
    store3(dx[RATE:], sub(add(absolute, cross(omega_BO, w)), matvec(dcm_BO, turning)))
    spin, stiff = matmul(cross_matrix(omega), inertia), cross_matrix(momentum)
    by_omega = matmul(inverse, (sub(stiff[0], spin[0]), sub(stiff[1], spin[1]), sub(stiff[2], spin[2])))
    for j in range(SIZE):
        theta, rate = (Phi[THETA, j], Phi[THETA + 1, j], Phi[THETA + 2, j]), (Phi[9, j], Phi[10, j], Phi[11, j])
        turned = sub(rate, cross(omega, theta))
        changed = add(matvec(by_omega, rate), matvec(by_theta, theta))
        if j < 6:
            moved = (Phi[R, j], Phi[R + 1, j], Phi[R + 2, j])
            pulled = matvec(G, moved)
            for i in range(3):
                dPhi[R + i, j], dPhi[V + i, j] = Phi[V + i, j], pulled[i]
            if gradient:
                changed = add(changed, matvec(by_r, moved))
        for i in range(3):
            dPhi[THETA + i, j], dPhi[OMEGA + i, j] = turned[i], changed[i]


@compiled
def runge_kutta(x: F64, Phi: F64, dt: float, body: Body) -> None:
    """One classical step of a state (13,) and of a transition (12, 12), in place; dt [s] of either sign."""
    dx, dPhi = np.zeros((4, STATES)), np.zeros((4, SIZE, SIZE))
    at, way = x.copy(), Phi.copy()
    for stage in range(4):
        slope(at, way, body, dx[stage], dPhi[stage])
        if stage < 3:
            h = dt if stage == 2 else 0.5 * dt
            for i in range(STATES):
                at[i] = x[i] + h * dx[stage, i]
            for i in range(SIZE):
                for j in range(SIZE if i >= THETA else THETA):
                    way[i, j] = Phi[i, j] + h * dPhi[stage, i, j]
    k = dt / 6.0
    for i in range(STATES):
        x[i] += k * (dx[0, i] + 2.0 * (dx[1, i] + dx[2, i]) + dx[3, i])
    for i in range(SIZE):
        for j in range(SIZE if i >= THETA else THETA):
            Phi[i, j] += k * (dPhi[0, i, j] + 2.0 * (dPhi[1, i, j] + dPhi[2, i, j]) + dPhi[3, i, j])
    store4(x[BETA:RATE], ep_normalize(vec4(x[BETA:RATE])))


@compiled
def moved(x: F64, dt: float, body: Body, Phi: F64) -> int:
    """A state (13,) moved by dt [s], which may be negative, in place.

    Args:
        x: state.
        dt: interval; cut into equal steps, each short enough for orbit and rotation.
        body: what moves.
        Phi: out (12, 12), transition of the filter's error.

    Returns:
        `OK`, or `NOT_FINITE`; x is then lost.
    """
    field, longest = body[0], body[5]
    dcm_BO, frame = ep_to_dcm(vec4(x[BETA:RATE])), frame_of(x, field)
    fast = norm(add(vec3(x[RATE:]), matvec(dcm_BO, frame[1])))
    if not math.isfinite(fast * dt):
        return NOT_FINITE
    count = max(1, math.ceil(abs(dt) / longest - 1e-9), math.ceil(fast * abs(dt) / TURN))
    way, T, half = np.eye(SIZE), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    to_pose_error(x, frame, T, False)
    for _ in range(count):
        runge_kutta(x, way, dt / count, body)
    matmul_into(way, T, half)
    to_pose_error(x, frame_of(x, field), T, True)
    matmul_into(T, half, Phi)
    return OK if math.isfinite(Phi[0, 0] + x[0] + x[BETA] + x[RATE]) else NOT_FINITE


@compiled
def noise(x: F64, dt: float, body: Body, accel: float, torque: float, Q: F64) -> None:
    """Covariance Q (12, 12) of the filter's error that white accelerations and torques leave after dt.

    Args:
        x: state (13,) at the end.
        dt: interval [s], not negative.
        body: what moves.
        accel: density of each component of acceleration [m^2/s^3].
        torque: density of each component of torque [N^2 m^2 s].
        Q: out. Velocity moves position and rate moves attitude, as without gravity and gyroscopic torque.
    """
    inverse, d2, d3 = body[2], dt * dt / 2.0, dt * dt * dt / 3.0
    absolute, T, half = np.zeros((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    for i in range(3):
        absolute[R + i, R + i], absolute[V + i, V + i] = accel * d3, accel * dt
        absolute[R + i, V + i] = absolute[V + i, R + i] = accel * d2
        for j in range(3):
            q = torque * dot(inverse[i], inverse[j])
            absolute[THETA + i, THETA + j], absolute[OMEGA + i, OMEGA + j] = q * d3, q * dt
            absolute[THETA + i, OMEGA + j] = absolute[OMEGA + i, THETA + j] = q * d2
    to_pose_error(x, frame_of(x, body[0]), T, True)
    matmul_into(T, absolute, half)
    for i in range(SIZE):
        for j in range(i + 1):
            total = 0.0
            for k in range(SIZE):
                total += half[i, k] * T[j, k]
            Q[i, j] = Q[j, i] = total
