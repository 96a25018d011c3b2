"""Equations of motion of a rigid body in orbit, and their integration by the classical Runge-Kutta method."""

from __future__ import annotations

from typing import TypeAlias

from fsw.math.attitude import mrp_rate, mrp_to_dcm
from fsw.math.compiled import compiled
from fsw.math.gravity import gravity_acceleration
from fsw.math.vectors import M3, V3, add, axpy, cross, mat_t_vec, matvec, sub

Motion: TypeAlias = tuple[V3, V3, V3, V3]
"""r_BN_N (m), v_BN_N (m/s), sigma_BN, omega_BN_B (rad/s), or their derivatives."""
Body: TypeAlias = tuple[M3, M3]
"""Inertia about B (kg m^2), B components, and its inverse."""
Planet: TypeAlias = tuple[float, float, float]
"""Gravitational parameter (m^3/s^2), reference radius (m), J2."""


@compiled
def angular_acceleration(omega: V3, torque: V3, body: Body) -> V3:
    """Time derivative of omega_BN_B, rad/s^2: Euler's equation (Eq. 3 of the spec)."""
    return matvec(body[1], sub(torque, cross(omega, matvec(body[0], omega))))


@compiled
def derivative(y: Motion, torque: V3, push: V3, body: Body, planet: Planet) -> Motion:
    """Time derivative of a motion (Eq. 1 to 3) under a torque (N m) and a specific force ``push`` (N/kg), both in B."""
    accel = gravity_acceleration(y[0], planet[0], planet[1], planet[2])
    if push[0] != 0.0 or push[1] != 0.0 or push[2] != 0.0:
        accel = add(accel, mat_t_vec(mrp_to_dcm(y[2]), push))
    return y[1], accel, mrp_rate(y[2], y[3]), angular_acceleration(y[3], torque, body)


@compiled
def advance(y: Motion, h: float, rate: Motion) -> Motion:
    """y + h rate."""
    return axpy(h, rate[0], y[0]), axpy(h, rate[1], y[1]), axpy(h, rate[2], y[2]), axpy(h, rate[3], y[3])


@compiled
def rk4(y: Motion, h: float, torque: V3, push: V3, body: Body, planet: Planet) -> Motion:
    """One step of ``h`` seconds by the classical fourth-order Runge-Kutta method."""
    rate = total = derivative(y, torque, push, body, planet)
    for part, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        rate = derivative(advance(y, part * h, rate), torque, push, body, planet)
        total = advance(total, weight, rate)
    return advance(y, h / 6.0, total)
