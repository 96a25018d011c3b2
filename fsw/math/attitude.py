"""Attitude: Euler parameters, modified Rodrigues parameters (MRP), direction cosine matrices, rotation vectors.

All describe frame B relative to frame N: ``dcm_BN`` takes components in N to components in B. Euler parameters
``beta`` have the scalar first; those that functions return have a scalar >= 0. An MRP ``sigma`` that functions return
lies in the inner set, length <= 1; a rotation vector is not longer than pi. Inputs may be of the other sign or set.
Basilisk's `RigidBodyKinematics` differs there: its MRP2EP, MRP2PRV, PRV2MRP and euler2PRV keep the sign or the longer
way of their input, which is the same rotation. Source: Schaub and Junkins, "Analytical Mechanics of Space Systems", 4th
ed., ch. 3.
"""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, V4, cross, dot, mat_t_vec, matvec, scale


@compiled
def ep_normalize(beta: V4) -> V4:
    """Unit Euler parameters with scalar >= 0; NaN if all are 0."""
    n = math.sqrt(beta[0] * beta[0] + beta[1] * beta[1] + beta[2] * beta[2] + beta[3] * beta[3])
    k = (-1.0 / n if beta[0] < 0.0 else 1.0 / n) if n > 0.0 else math.nan
    return (k * beta[0], k * beta[1], k * beta[2], k * beta[3])


@compiled
def ep_to_dcm(beta: V4) -> M3:
    """dcm_BN of unit Euler parameters beta_BN."""
    w, x, y, z = beta
    return (
        (w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z),
    )


@compiled
def dcm_to_ep(m: M3) -> V4:
    """Euler parameters of a rotation matrix by the method of Sheppard (1978): divides by the largest of the four."""
    trace = m[0][0] + m[1][1] + m[2][2]
    w = 1.0 + trace
    x = 1.0 + 2.0 * m[0][0] - trace
    y = 1.0 + 2.0 * m[1][1] - trace
    z = 1.0 + 2.0 * m[2][2] - trace
    wx, wy, wz = m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]
    yz, zx, xy = m[1][2] + m[2][1], m[2][0] + m[0][2], m[0][1] + m[1][0]
    if w >= x and w >= y and w >= z:
        beta = (w, wx, wy, wz)
    elif x >= y and x >= z:
        beta = (wx, x, xy, zx)
    elif y >= z:
        beta = (wy, xy, y, yz)
    else:
        beta = (wz, zx, yz, z)
    return ep_normalize(beta)


@compiled
def ep_to_mrp(beta: V4) -> V3:
    """MRP, inner set, of unit Euler parameters."""
    k = -1.0 / (1.0 - beta[0]) if beta[0] < 0.0 else 1.0 / (1.0 + beta[0])
    return (k * beta[1], k * beta[2], k * beta[3])


@compiled
def mrp_to_ep(sigma: V3) -> V4:
    """Euler parameters, scalar >= 0, of an MRP of either set."""
    s2 = dot(sigma, sigma)
    k = 2.0 / (1.0 + s2)
    w = (1.0 - s2) / (1.0 + s2)
    if w < 0.0:
        w, k = -w, -k
    return (w, k * sigma[0], k * sigma[1], k * sigma[2])


@compiled
def mrp_shadow(sigma: V3) -> V3:
    """The other MRP of the same attitude, -sigma / |sigma|^2; NaN for sigma = 0, whose shadow is at infinity."""
    s2 = dot(sigma, sigma)
    return scale(-1.0 / s2 if s2 > 0.0 else math.nan, sigma)


@compiled
def mrp_inner(sigma: V3) -> V3:
    """The MRP of the same attitude with length <= 1."""
    s2 = dot(sigma, sigma)
    if s2 > 1.0:
        return scale(-1.0 / s2, sigma)
    return sigma


@compiled
def mrp_to_dcm(sigma: V3) -> M3:
    """dcm_BN of sigma_BN, of either set."""
    return ep_to_dcm(mrp_to_ep(sigma))


@compiled
def dcm_to_mrp(m: M3) -> V3:
    """MRP, inner set, of a rotation matrix."""
    return ep_to_mrp(dcm_to_ep(m))


@compiled
def ep_inverse(beta: V4) -> V4:
    """beta_NB of beta_BN."""
    return (beta[0], -beta[1], -beta[2], -beta[3])


@compiled
def ep_compose(beta_CB: V4, beta_BN: V4) -> V4:
    """beta_CN of beta_CB and beta_BN, in the order of ``dcm_CN = dcm_CB dcm_BN``."""
    c0, c1, c2, c3 = beta_CB
    b0, b1, b2, b3 = beta_BN
    w = c0 * b0 - c1 * b1 - c2 * b2 - c3 * b3
    x = c1 * b0 + c0 * b1 + c3 * b2 - c2 * b3
    y = c2 * b0 - c3 * b1 + c0 * b2 + c1 * b3
    z = c3 * b0 + c2 * b1 - c1 * b2 + c0 * b3
    return (-w, -x, -y, -z) if w < 0.0 else (w, x, y, z)


@compiled
def ep_relative(beta_BN: V4, beta_RN: V4) -> V4:
    """beta_BR of two attitudes relative to the same frame."""
    return ep_compose(beta_BN, ep_inverse(beta_RN))


@compiled
def mrp_compose(sigma_CB: V3, sigma_BN: V3) -> V3:
    """sigma_CN of sigma_CB and sigma_BN; by way of Euler parameters, so that no pair of attitudes is singular."""
    return ep_to_mrp(ep_compose(mrp_to_ep(sigma_CB), mrp_to_ep(sigma_BN)))


@compiled
def mrp_relative(sigma_BN: V3, sigma_RN: V3) -> V3:
    """sigma_BR of two attitudes relative to the same frame."""
    return ep_to_mrp(ep_relative(mrp_to_ep(sigma_BN), mrp_to_ep(sigma_RN)))


@compiled
def ep_rate(beta: V4, omega: V3) -> V4:
    """Time derivative of beta_BN for the rate omega_BN_B, rad/s."""
    w, x, y, z = beta
    p, q, r = omega
    return (
        0.5 * (-x * p - y * q - z * r),
        0.5 * (w * p - z * q + y * r),
        0.5 * (z * p + w * q - x * r),
        0.5 * (-y * p + x * q + w * r),
    )


@compiled
def mrp_rate(sigma: V3, omega: V3) -> V3:
    """Time derivative of sigma_BN for the rate omega_BN_B, rad/s."""
    a = 0.25 * (1.0 - dot(sigma, sigma))
    b = 0.5 * dot(sigma, omega)
    c = cross(sigma, omega)
    return (
        a * omega[0] + 0.5 * c[0] + b * sigma[0],
        a * omega[1] + 0.5 * c[1] + b * sigma[1],
        a * omega[2] + 0.5 * c[2] + b * sigma[2],
    )


@compiled
def mrp_rate_to_omega(sigma: V3, sigma_dot: V3) -> V3:
    """omega_BN_B, rad/s, of sigma_BN and its time derivative: the inverse of `mrp_rate`."""
    s2 = dot(sigma, sigma)
    k = 4.0 / ((1.0 + s2) * (1.0 + s2))
    a = k * (1.0 - s2)
    b = 2.0 * k * dot(sigma, sigma_dot)
    c = cross(sigma, sigma_dot)
    return (
        a * sigma_dot[0] - 2.0 * k * c[0] + b * sigma[0],
        a * sigma_dot[1] - 2.0 * k * c[1] + b * sigma[1],
        a * sigma_dot[2] - 2.0 * k * c[2] + b * sigma[2],
    )


@compiled
def rotvec_to_ep(phi: V3) -> V4:
    """Euler parameters, scalar >= 0, of a rotation vector (axis times angle, rad, any length)."""
    half = 0.5 * math.sqrt(dot(phi, phi))
    # below 1e-4 the series is exact to the last bit: the next term is half^4 / 120
    k = 0.5 * math.sin(half) / half if half > 1e-4 else 0.5 * (1.0 - half * half / 6.0)
    w = math.cos(half)
    if w < 0.0:
        w, k = -w, -k
    return (w, k * phi[0], k * phi[1], k * phi[2])


@compiled
def ep_to_rotvec(beta: V4) -> V3:
    """Rotation vector, rad, length <= pi, of unit Euler parameters."""
    v = math.sqrt(beta[1] * beta[1] + beta[2] * beta[2] + beta[3] * beta[3])
    w = abs(beta[0])
    k = 2.0 * math.atan2(v, w) / v if v > 1e-150 else 2.0
    if beta[0] < 0.0:
        k = -k
    return (k * beta[1], k * beta[2], k * beta[3])


@compiled
def rotvec_to_dcm(phi: V3) -> M3:
    """Rotation matrix of a rotation vector, rad: dcm_BN if B is N turned by ``phi``."""
    return ep_to_dcm(rotvec_to_ep(phi))


@compiled
def dcm_to_rotvec(m: M3) -> V3:
    """Rotation vector, rad, length <= pi, of a rotation matrix."""
    return ep_to_rotvec(dcm_to_ep(m))


@compiled
def rotvec_to_mrp(phi: V3) -> V3:
    """MRP, inner set, of a rotation vector, rad."""
    return ep_to_mrp(rotvec_to_ep(phi))


@compiled
def mrp_to_rotvec(sigma: V3) -> V3:
    """Rotation vector, rad, length <= pi, of an MRP of either set."""
    return ep_to_rotvec(mrp_to_ep(sigma))


@compiled
def axis_angle_to_ep(axis: V3, angle: float) -> V4:
    """Euler parameters, scalar >= 0, of a turn about an axis (any length) by an angle, rad; NaN if the axis is 0."""
    length = math.sqrt(dot(axis, axis))
    k = math.sin(0.5 * angle) / length if length > 0.0 else math.nan
    w = math.cos(0.5 * angle)
    if w < 0.0:
        w, k = -w, -k
    return (w, k * axis[0], k * axis[1], k * axis[2])


@compiled
def ep_to_axis_angle(beta: V4) -> tuple[V3, float]:
    """Unit axis and angle, rad, in [0, pi], of unit Euler parameters; axis x if there is no turn."""
    phi = ep_to_rotvec(beta)
    angle = math.sqrt(dot(phi, phi))
    if not angle > 1e-150:
        return (1.0, 0.0, 0.0), angle
    return scale(1.0 / angle, phi), angle


@compiled
def ep_to_gibbs(beta: V4) -> V3:
    """Gibbs vector (classical Rodrigues parameters) of Euler parameters; infinite or NaN at half a turn."""
    return (beta[1] / beta[0], beta[2] / beta[0], beta[3] / beta[0])


@compiled
def gibbs_to_ep(gibbs: V3) -> V4:
    """Euler parameters, scalar > 0, of a Gibbs vector."""
    w = 1.0 / math.sqrt(1.0 + dot(gibbs, gibbs))
    return (w, w * gibbs[0], w * gibbs[1], w * gibbs[2])


@compiled
def ep_step(beta: V4, omega: V3, dt: float) -> V4:
    """beta_BN after dt (s) of the constant rate omega_BN_B (rad/s), by the exponential map: exact, and of length 1."""
    return ep_normalize(ep_compose(rotvec_to_ep(scale(dt, omega)), beta))


@compiled
def ep_rate_to_omega(beta: V4, beta_dot: V4) -> V3:
    """omega_BN_B, rad/s, of beta_BN and its time derivative: the inverse of `ep_rate`."""
    w, x, y, z = beta
    a, p, q, r = beta_dot
    return (
        2.0 * (-x * a + w * p + z * q - y * r),
        2.0 * (-y * a - z * p + w * q + x * r),
        2.0 * (-z * a + y * p - x * q + w * r),
    )


@compiled
def ep_matrix(beta: V4) -> tuple[V3, V3, V3, V3]:
    """B (4 rows of 3) of ``beta_dot = 1/2 B omega``; its transposed inverts it for unit Euler parameters."""
    w, x, y, z = beta
    return ((-x, -y, -z), (w, -z, y), (z, w, -x), (-y, x, w))


@compiled
def mrp_matrix(sigma: V3) -> M3:
    """B of ``sigma_dot = 1/4 B omega``; its inverse is its transposed over (1 + sigma^2)^2."""
    x, y, z = sigma
    d = 1.0 - dot(sigma, sigma)
    return (
        (d + 2.0 * x * x, 2.0 * (x * y - z), 2.0 * (x * z + y)),
        (2.0 * (y * x + z), d + 2.0 * y * y, 2.0 * (y * z - x)),
        (2.0 * (z * x - y), 2.0 * (z * y + x), d + 2.0 * z * z),
    )


@compiled
def mrp_matrix_rate(sigma: V3, sigma_dot: V3) -> M3:
    """Time derivative of `mrp_matrix`, 1/s."""
    x, y, z = sigma
    p, q, r = sigma_dot
    d = -2.0 * dot(sigma, sigma_dot)
    return (
        (d + 4.0 * x * p, 2.0 * (x * q + p * y - r), 2.0 * (x * r + p * z + q)),
        (2.0 * (y * p + q * x + r), d + 4.0 * y * q, 2.0 * (y * r + q * z - p)),
        (2.0 * (z * p + r * x - q), 2.0 * (z * q + r * y + p), d + 4.0 * z * r),
    )


@compiled
def mrp_second_rate(sigma: V3, sigma_dot: V3, omega: V3, omega_dot: V3) -> V3:
    """Second time derivative of sigma_BN, 1/s^2, for the rate omega_BN_B and its time derivative in B."""
    a = matvec(mrp_matrix(sigma), omega_dot)
    b = matvec(mrp_matrix_rate(sigma, sigma_dot), omega)
    return scale(0.25, (a[0] + b[0], a[1] + b[1], a[2] + b[2]))


@compiled
def mrp_second_rate_to_omega_dot(sigma: V3, sigma_dot: V3, sigma_second: V3) -> V3:
    """Time derivative of omega_BN_B, rad/s^2, of the first two of sigma_BN: the inverse of `mrp_second_rate`."""
    omega = mrp_rate_to_omega(sigma, sigma_dot)
    b = matvec(mrp_matrix_rate(sigma, sigma_dot), omega)
    k = 1.0 / (1.0 + dot(sigma, sigma))
    rest = (4.0 * sigma_second[0] - b[0], 4.0 * sigma_second[1] - b[1], 4.0 * sigma_second[2] - b[2])
    return scale(k * k, mat_t_vec(mrp_matrix(sigma), rest))


@compiled
def rotvec_rate(phi: V3, omega: V3) -> V3:
    """Time derivative of the rotation vector phi_BN, rad/s, for the rate omega_BN_B (Bortz 1971, eq. 16).

    NaN from a whole turn on, where it does not exist.
    """
    angle2 = dot(phi, phi)
    if not angle2 < 4.0 * math.pi * math.pi:
        return (math.nan, math.nan, math.nan)
    if angle2 > 1e-4:
        half = 0.5 * math.sqrt(angle2)
        k = (1.0 - half * math.cos(half) / math.sin(half)) / angle2
    else:  # the next term of the series is 1e-16 of the first
        k = 1.0 / 12.0 + angle2 * (1.0 / 720.0 + angle2 * (1.0 / 30240.0 + angle2 / 1209600.0))
    a = cross(phi, omega)
    b = cross(phi, a)
    return (
        omega[0] + 0.5 * a[0] + k * b[0],
        omega[1] + 0.5 * a[1] + k * b[1],
        omega[2] + 0.5 * a[2] + k * b[2],
    )


@compiled
def rotvec_rate_to_omega(phi: V3, phi_dot: V3) -> V3:
    """omega_BN_B, rad/s, of the rotation vector phi_BN and its time derivative: the inverse of `rotvec_rate`."""
    angle2 = dot(phi, phi)
    if angle2 > 1e-4:
        angle = math.sqrt(angle2)
        sine = math.sin(0.5 * angle)
        k, j = 2.0 * sine * sine / angle2, (1.0 - math.sin(angle) / angle) / angle2
    else:
        k = 0.5 - angle2 * (1.0 / 24.0 - angle2 / 720.0)
        j = 1.0 / 6.0 - angle2 * (1.0 / 120.0 - angle2 / 5040.0)
    a = cross(phi, phi_dot)
    b = cross(phi, a)
    return (
        phi_dot[0] - k * a[0] + j * b[0],
        phi_dot[1] - k * a[1] + j * b[1],
        phi_dot[2] - k * a[2] + j * b[2],
    )
