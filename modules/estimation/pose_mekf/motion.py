"""The time update: orbit by Runge-Kutta steps, attitude by the gyro, covariance by their derivatives.

Sources: B6 of the audit of the source, that is Lefferts, Markley and Shuster (1982), "Kalman filtering for spacecraft
attitude estimation", for attitude and bias; Farrenkopf (1978) for the noise of the gyro; Vallado, "Fundamentals of
Astrodynamics", sec. 8.7 for the field, whose gradient is written out here.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import ep_step, rotvec_to_dcm
from fsw.math.compiled import compiled
from fsw.math.extended import covariance_time
from fsw.math.gravity import Zonals, zonal_acceleration
from fsw.math.noise import gauss_markov_factors
from fsw.math.square_root import NOT_FINITE, OK
from fsw.math.vectors import M3, V3, add, axpy, mat_t_vec, matmul, matvec, norm, scale, store3, store4, sub, vec3, vec4
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf.layout import (
    BIAS,
    CORE,
    GPS,
    MAP,
    SIZE,
    THETA,
    X_BETA,
    X_BIAS,
    X_HEARD,
    X_HELD,
    X_NUISANCE,
    X_R,
    X_READING,
    X_V,
    R,
    V,
)
from modules.estimation.pose_models.pose import Pose, put_block


@compiled
def field(r: V3, frame: M3, params: Row) -> V3:
    """Acceleration [m/s^2] by the planet at ``r`` [m], N; the third row of ``frame`` is the planet's pole."""
    z = params.zonals
    zonals: Zonals = (z[0], z[1], z[2], z[3], z[4])
    return mat_t_vec(frame, zonal_acceleration(matvec(frame, r), params.mu, params.radius, zonals))


@compiled
def field_gradient(r: V3, pole: V3, mu: float, radius: float, j2: float) -> M3:
    """Derivative [1/s^2] of the acceleration of point mass and J2 by the position; ``pole`` is a unit vector."""
    far = norm(r)
    n = scale(1.0 / far, r)
    u = n[0] * pole[0] + n[1] * pole[1] + n[2] * pole[2]
    k = mu / (far * far * far)
    q = 1.5 * j2 * (radius / far) * (radius / far)
    same = k * (-1.0 + q * (5.0 * u * u - 1.0))
    nn, ne, ee = k * (3.0 + q * (5.0 - 35.0 * u * u)), k * q * 10.0 * u, -2.0 * k * q
    a = add(add(scale(nn * n[0] + ne * pole[0], n), scale(ne * n[0] + ee * pole[0], pole)), (same, 0.0, 0.0))
    b = add(add(scale(nn * n[1] + ne * pole[1], n), scale(ne * n[1] + ee * pole[1], pole)), (0.0, same, 0.0))
    c = add(add(scale(nn * n[2] + ne * pole[2], n), scale(ne * n[2] + ee * pole[2], pole)), (0.0, 0.0, same))
    return a, b, c


@compiled
def body_rate(x: F64) -> V3:
    """omega_BN_B [rad/s]: what the gyro reads or is held, less the bias."""
    return sub(vec3(x[X_READING:]), vec3(x[X_BIAS:]))


@compiled
def pose_of(x: F64, dcm_BN: M3) -> Pose:
    """The pose of `modules.estimation.pose_models` of an estimate and its attitude matrix."""
    return vec3(x[X_R:]), vec3(x[X_V:]), dcm_BN, body_rate(x)


@compiled
def move_orbit(r: V3, v: V3, dt: float, frame: M3, params: Row) -> tuple[V3, V3]:
    """Position and velocity after dt [s], by one classical Runge-Kutta step."""
    h = 0.5 * dt
    a1 = field(r, frame, params)
    v2 = axpy(h, a1, v)
    a2 = field(axpy(h, v, r), frame, params)
    v3 = axpy(h, a2, v)
    a3 = field(axpy(h, v2, r), frame, params)
    v4 = axpy(dt, a3, v)
    a4 = field(axpy(dt, v3, r), frame, params)
    mean_v = scale(1.0 / 6.0, add(add(v, v4), scale(2.0, add(v2, v3))))
    mean_a = scale(1.0 / 6.0, add(add(a1, a4), scale(2.0, add(a2, a3))))
    return axpy(dt, mean_v, r), axpy(dt, mean_a, v)


@compiled
def _scaled(k: float, m: M3) -> M3:
    return scale(k, m[0]), scale(k, m[1]), scale(k, m[2])


@compiled
def _plus(m: M3, k: float) -> M3:
    """m + k I."""
    return add(m[0], (k, 0.0, 0.0)), add(m[1], (0.0, k, 0.0)), add(m[2], (0.0, 0.0, k))


@compiled
def _skew(a: V3) -> M3:
    return (0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0)


@compiled
def transition(G: M3, omega: V3, dt: float, Phi: F64) -> None:
    """Phi (26, 26) of dt [s] for a constant gradient G [1/s^2] and body rate omega [rad/s]; nuisance: identity."""
    for i in range(SIZE):
        for j in range(SIZE):
            Phi[i, j] = 1.0 if i == j else 0.0
    half = 0.5 * dt * dt
    put_block(Phi, R, R, _plus(_scaled(half, G), 1.0))
    put_block(Phi, R, V, _plus(_scaled(half * dt / 3.0, G), dt))
    put_block(Phi, V, R, _scaled(dt, G))
    put_block(Phi, V, V, _plus(_scaled(half, G), 1.0))
    put_block(Phi, THETA, THETA, rotvec_to_dcm(scale(dt, omega)))
    # -(integral of exp(-[omega s x]) ds); the next term is omega^3 dt^4 / 24
    w = _skew(omega)
    ww = matmul(w, w)
    for i in range(3):
        for j in range(3):
            same = dt if i == j else 0.0
            Phi[THETA + i, BIAS + j] = -same + half * w[i][j] - half * dt / 3.0 * ww[i][j]


@compiled
def process_noise(dt: float, held: bool, params: Row, sigma: F64, Q: F64) -> None:
    """Q (26, 26) of dt [s]; ``sigma`` (26,) of `modes`. While the rate is held, its noise is that of torques."""
    for i in range(SIZE):
        for j in range(SIZE):
            Q[i, j] = 0.0
    accel = params.accel_noise * params.accel_noise
    white = 0.0 if held else params.gyro_white * params.gyro_white
    walk = params.rate_noise * params.rate_noise if held else params.gyro_walk * params.gyro_walk
    for i in range(3):
        Q[R + i, R + i] = accel * dt * dt * dt / 3.0
        Q[R + i, V + i] = Q[V + i, R + i] = accel * dt * dt / 2.0
        Q[V + i, V + i] = accel * dt
        Q[THETA + i, THETA + i] = white * dt + walk * dt * dt * dt / 3.0
        Q[THETA + i, BIAS + i] = Q[BIAS + i, THETA + i] = -walk * dt * dt / 2.0
        Q[BIAS + i, BIAS + i] = walk * dt
        _, fresh = gauss_markov_factors(dt, params.gps_bias_tau)
        Q[GPS + i, GPS + i] = (sigma[GPS + i] * fresh) ** 2
        if params.map_bias_tau > 0.0 and sigma[MAP + i] > 0.0:
            _, fresh = gauss_markov_factors(dt, params.map_bias_tau)
            for j in range(3):
                Q[MAP + i, MAP + j] = params.map_bias_P[i, j] * fresh * fresh


@compiled
def move(x: F64, P: F64, sigma: F64, dt: float, frame: M3, params: Row) -> int:
    """Move estimate (34,) and covariance (26, 26) by dt [s]; a code of `fsw.math.square_root`, unchanged on failure.

    Args:
        x: estimate, whose reading of the gyro holds over the interval.
        P: covariance.
        sigma: (26,) of `modes`.
        dt: interval.
        frame: any dcm_EN with the planet's pole.
        params: of the module.
    """
    Phi, Q = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    r, v, omega = vec3(x[X_R:]), vec3(x[X_V:]), body_rate(x)
    r_new, v_new = move_orbit(r, v, dt, frame, params)
    G = field_gradient(scale(0.5, add(r, r_new)), frame[2], params.mu, params.radius, params.zonals[0])
    transition(G, omega, dt, Phi)
    process_noise(dt, x[X_HELD] > 0.5, params, sigma, Q)
    keep_gps, _ = gauss_markov_factors(dt, params.gps_bias_tau)
    keep_map = math.exp(-dt / params.map_bias_tau) if params.map_bias_tau > 0.0 else 1.0
    for i in range(3):
        Phi[GPS + i, GPS + i] = keep_gps
        Phi[MAP + i, MAP + i] = keep_map
    code = covariance_time(Phi, Q, P) if math.isfinite(norm(r_new) + norm(v_new)) else NOT_FINITE
    if code != OK:
        return code
    store3(x[X_R:], r_new)
    store3(x[X_V:], v_new)
    store4(x[X_BETA:], ep_step(vec4(x[X_BETA:]), omega, dt))
    for i in range(3):
        x[X_NUISANCE + GPS - CORE + i] *= keep_gps
        x[X_NUISANCE + MAP - CORE + i] *= keep_map
    return OK


@compiled
def _add_reading_noise(P: F64, params: Row) -> None:
    for i in range(3):
        P[BIAS + i, BIAS + i] += params.gyro_white * params.gyro_white / params.gyro_period


@compiled
def hold_rate(x: F64, P: F64, params: Row) -> None:
    """The gyro is silent: its last reading is held, and the bias is that to it. See SPEC.md."""
    x[X_HELD] = 1.0
    if x[X_HEARD] > 0.5:
        _add_reading_noise(P, params)
        return
    for i in range(BIAS, BIAS + 3):
        for j in range(SIZE):
            P[i, j] = P[j, i] = 0.0
        P[i, i] = params.rate_sigma * params.rate_sigma


@compiled
def read_gyro(x: F64, P: F64, reading: V3, params: Row) -> None:
    """A reading of the gyro (B) [rad/s] for the interval that follows; if the rate was held, the bias is that to it."""
    if x[X_HELD] > 0.5:
        store3(x[X_BIAS:], add(vec3(x[X_BIAS:]), sub(reading, vec3(x[X_READING:]))))
        _add_reading_noise(P, params)
        x[X_HELD] = 0.0
    x[X_HEARD] = 1.0
    store3(x[X_READING:], reading)
