"""The MRP feedback law."""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, add, axpy, cross, matvec, scale, sub


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
    sigma_BR: V3, omega_BR: V3, omega_RN: V3, domega_RN: V3, z: V3, gains: V3, inertia: M3, whole_rate: bool
) -> V3:
    """Torque, N m, B components, without the known external torque (Eq. 1 of the spec).

    Args:
        sigma_BR: attitude error. omega_BR: rate error, rad/s. omega_RN: reference rate, rad/s. domega_RN: rad/s^2.
        z: integral measure (Eq. 2), N m s. gains: K, Ki, P. inertia: kg m^2.
        whole_rate: the gyroscopic term is taken with omega_BN instead of omega_RN + Ki z.
    """
    omega_BN = add(omega_BR, omega_RN)
    carrier = omega_BN if whole_rate else axpy(gains[1], z, omega_RN)
    gyroscopic = cross(carrier, matvec(inertia, omega_BN))
    feedforward = matvec(inertia, sub(domega_RN, cross(omega_BN, omega_RN)))
    feedback = axpy(gains[0], sigma_BR, scale(gains[2], axpy(gains[1], z, omega_BR)))
    return sub(add(gyroscopic, feedforward), feedback)
