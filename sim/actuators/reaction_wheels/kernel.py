"""Friction of a wheel, its speed over an interval, and the impulse of a torque that is held in a turning body."""

from __future__ import annotations

import math
from typing import NamedTuple

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, cross, mat_t_vec, scale, sub

FINE = 0.1
"""Near standstill the speed changes by this part of the Stribeck speed in a step, so that friction is resolved."""
FAR = 5.0
"""Stribeck speeds from standstill at which static friction has gone (to 1e-11)."""
MOST = 1000
"""Largest number of steps in an interval."""


class Bearing(NamedTuple):
    """Inertia (kg m^2) and friction of a wheel: N m s, N m, N m, rad/s; ``stribeck`` is above 0."""

    inertia: float
    viscous: float
    coulomb: float
    static: float
    stribeck: float


@compiled
def dry(speed: float, b: Bearing) -> float:
    """Magnitude of the friction that does not vanish at standstill, N m (Eq. 2 of the spec)."""
    x = speed / b.stribeck
    if x * x > 36.0:  # less than the last digit
        return b.coulomb
    return b.coulomb + (b.static - b.coulomb) * math.exp(-x * x)


@compiled
def drag(speed: float, torque: float, b: Bearing) -> float:
    """Torque of friction on a wheel that turns at ``speed`` (rad/s), or stands and is driven by ``torque`` (N m)."""
    if speed == 0.0:
        return -max(-b.static, min(b.static, torque))
    return -math.copysign(dry(speed, b), speed) - b.viscous * speed


@compiled
def gained(x: float) -> float:
    """(1 - exp(-x)) / x for x >= 0."""
    return -math.expm1(-x) / x if x > 1e-12 else 1.0 - 0.5 * x


@compiled
def glide(speed: float, torque: float, sign: float, level: float, dt: float, b: Bearing) -> tuple[float, float]:
    """Speed (rad/s) after up to ``dt`` (s) under a torque and a dry friction of constant ``level`` against ``sign``.

    Returns:
        The speed, exact for the constant level, and the time left if the wheel has come to a stop.
    """
    drive = torque - sign * level
    after = speed + (drive - b.viscous * speed) * dt / b.inertia * gained(b.viscous * dt / b.inertia)
    if speed == 0.0 or after * sign > 0.0 or drive * sign >= 0.0:
        return after, 0.0
    x = -speed * b.viscous / drive
    stop = -speed * b.inertia / drive * (math.log1p(x) / x if x > 1e-12 else 1.0 - 0.5 * x)
    return 0.0, max(dt - stop, 0.0)


@compiled
def spun(speed: float, torque: float, dt: float, b: Bearing) -> float:
    """Speed of a wheel (rad/s) after ``dt`` (s) under a constant torque of its motor (N m) and friction (Eq. 2)."""
    left = dt
    for _ in range(2 * MOST):  # it may stop and start
        if left <= 0.0:
            return speed
        if speed == 0.0 and math.fabs(torque) <= b.static:
            return 0.0
        sign = math.copysign(1.0, speed if speed != 0.0 else torque)
        step, level = left, b.coulomb
        if b.static > b.coulomb and math.fabs(speed) < FAR * b.stribeck + math.fabs(torque) * left / b.inertia:
            rate = math.fabs(torque - sign * dry(speed, b) - b.viscous * speed) / b.inertia
            step = min(left, max(FINE * b.stribeck / max(rate, 1e-300), dt / MOST))
            half, _ = glide(speed, torque, sign, dry(speed, b), 0.5 * step, b)
            level = dry(half, b)
        speed, rest = glide(speed, torque, sign, level, step, b)
        left += rest - step
    return speed


@compiled
def held_impulse(dcm0: M3, dcm1: M3, rate0: V3, rate1: V3, torque_B: V3, dt: float) -> V3:
    """Impulse, N m s, N components, of a torque that is constant in B while B turns (Eq. 5 of the spec).

    Args:
        dcm0: dcm_BN at the begin. dcm1: at the end. rate0: omega_BN_B at the begin, rad/s. rate1: at the end.
        torque_B: N m, B components. dt: s.
    """
    mean = scale(0.5 * dt, add(mat_t_vec(dcm0, torque_B), mat_t_vec(dcm1, torque_B)))
    slope = sub(mat_t_vec(dcm0, cross(rate0, torque_B)), mat_t_vec(dcm1, cross(rate1, torque_B)))
    return add(mean, scale(dt * dt / 12.0, slope))
