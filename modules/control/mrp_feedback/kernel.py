"""The MRP feedback law."""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, axpy, cross, dot, matvec, scale, sub, vec3
from messages.base import F64


@compiled
def clip(x: float, limit: float) -> float:
    """x limited to [-limit, limit]; NaN stays NaN."""
    if x > limit:
        return limit
    if x < -limit:
        return -limit
    return x


@compiled
def feedback_torque(
    sigma_BR: V3,
    omega_BR: V3,
    omega_RN: V3,
    domega_RN: V3,
    z: V3,
    gains: V3,
    inertia: M3,
    wheels: V3,
    whole_rate: bool,
) -> V3:
    """Torque, N m, B components, without the known external torque (Eq. 1 of the spec).

    Args:
        sigma_BR: attitude error. omega_BR: rate error, rad/s. omega_RN: reference rate, rad/s. domega_RN: rad/s^2.
        z: integral measure (Eq. 2), N m s. gains: K, Ki, P. inertia: kg m^2.
        wheels: angular momentum of the wheels, N m s (Eq. 3).
        whole_rate: the gyroscopic term is taken with omega_BN instead of omega_RN + Ki z.
    """
    omega_BN = add(omega_BR, omega_RN)
    carrier = omega_BN if whole_rate else axpy(gains[1], z, omega_RN)
    gyroscopic = cross(carrier, add(matvec(inertia, omega_BN), wheels))
    feedforward = matvec(inertia, sub(domega_RN, cross(omega_BN, omega_RN)))
    feedback = axpy(gains[0], sigma_BR, scale(gains[2], axpy(gains[1], z, omega_BR)))
    return sub(add(gyroscopic, feedforward), feedback)


@compiled
def wheel_momentum(omega_BN: V3, speeds: F64, axes_B: F64, inertia: F64) -> V3:
    """Angular momentum of wheels about their axes, N m s, B components (Eq. 3 of the spec).

    Args:
        omega_BN: rate of the body, rad/s. speeds: (n,) of the wheels relative to the body, rad/s.
        axes_B: (n, 3) unit vectors. inertia: (n,) about the axes, kg m^2.
    """
    total = (0.0, 0.0, 0.0)
    for k in range(len(speeds)):
        if inertia[k] > 0.0:
            axis = vec3(axes_B[k])
            total = axpy(inertia[k] * (speeds[k] + dot(axis, omega_BN)), axis, total)
    return total
