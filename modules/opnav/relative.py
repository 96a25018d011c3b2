"""What the modules of disk navigation share: bodies, the lens of a row, attitudes at an exposure, and the output.

Semi-axes of bodies that are not spheroids: Archinal et al. (2018), "Report of the IAU Working Group on Cartographic
Coordinates and Rotational Elements: 2015", Celest. Mech. Dyn. Astr. 130:22, tables 4 to 6; all others are the
spheroids of `fsw.math.bodies`.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import mrp_to_dcm, rotvec_to_dcm
from fsw.math.bodies import bodies
from fsw.math.camera import UNLIMITED
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, dot, mat3, mat_t_vec, matmul, scale, store3, store33, transpose, vec3
from fsw.module import Row
from messages.base import F64

VALID = 0
NOTHING_FOUND = 1
"""The finder's message says that it is not valid."""
NO_INPUT = 2
"""Camera or attitude were never written."""
UNKNOWN_BODY = 3
"""The body is not in the table, and the parameters give no size."""
BAD_NUMBERS = 4
"""NaN, a standard deviation or a radius that is not positive, or a covariance that is not positive definite."""
OLD_ATTITUDE = 5
"""The attitude is too far from the time of the exposure."""
OUTSIDE_LENS = 6
"""A pixel, or a part of the disk, lies where the lens sees nothing."""
NO_SOLUTION = 7
"""No position outside the body explains the measurement."""
TOO_UNSURE = 8
"""The arc is too short for its noise: the range would not be known."""
TOO_FEW = 9
"""Fewer points than a fit needs."""
OUTLIERS = 10
"""Too large a part of the points agrees with no limb."""
NO_ORIENTATION = 11
"""The body is not a sphere, and nothing says how it is turned."""

_TRIAXIAL = {
    401: (13.0e3, 11.4e3, 9.1e3),
    402: (7.8e3, 6.0e3, 5.1e3),
    501: (1829.4e3, 1819.4e3, 1815.7e3),
    502: (1562.6e3, 1560.3e3, 1559.5e3),
    601: (207.8e3, 196.7e3, 190.6e3),
    602: (256.6e3, 251.4e3, 248.3e3),
    603: (538.4e3, 528.3e3, 526.3e3),
    604: (563.4e3, 561.3e3, 559.6e3),
    605: (765.0e3, 763.1e3, 762.4e3),
    606: (2575.15e3, 2574.78e3, 2574.47e3),
    608: (745.7e3, 745.7e3, 712.1e3),
    2000004: (289.0e3, 280.0e3, 229.0e3),
    2000433: (17.0e3, 5.5e3, 5.5e3),
}
SHAPES = np.array(
    sorted(
        (float(k), *v)
        for k, v in {
            **{b.naif: (b.radius, b.radius, b.radius * (1.0 - b.flattening)) for b in bodies()},
            **_TRIAXIAL,
        }.items()
    )
)
"""NAIF identifier and semi-axes [m], a row for each body."""


@compiled
def semi_axes(body_id: int, given: V3) -> V3:
    """Semi-axes a, b, c [m] of a body: those given if positive, else those of the table; NaN if it is not there."""
    if given[0] > 0.0 and given[1] > 0.0 and given[2] > 0.0:
        return given
    for i in range(SHAPES.shape[0]):
        if SHAPES[i, 0] == body_id:
            return (SHAPES[i, 1], SHAPES[i, 2], SHAPES[i, 3])
    return (math.nan, math.nan, math.nan)


@compiled
def lens_of(camera: Row, lens: F64) -> None:
    """The lens vector (11,) of `fsw.math.camera` from the row of a camera message."""
    lens[0], lens[1] = camera.focal_px[0], camera.focal_px[1]
    lens[2], lens[3] = camera.center_px[0], camera.center_px[1]
    lens[4] = camera.skew_px
    for i in range(5):
        lens[5 + i] = camera.distortion[i]
    lens[10] = first_root(3.0 * lens[5], 5.0 * lens[6], 7.0 * lens[9])


@compiled
def first_root(a: float, b: float, c: float) -> float:
    """Smallest positive root of 1 + a s + b s^2 + c s^3, or `UNLIMITED`: see `fsw.math.camera.monotonic_limit`."""
    # between zero, the turning points and infinity the cubic is monotonic, so a change of sign holds one root
    low = 0.0
    disc = b * b - 3.0 * a * c
    for k in range(3):
        high = UNLIMITED
        if k < 2 and disc > 0.0:
            q = -(b + math.copysign(math.sqrt(disc), b))
            t0 = q / (3.0 * c) if c != 0.0 else -1.0
            t1 = a / q if q != 0.0 else -1.0
            near, far = min(t0, t1), max(t0, t1)
            high = near if k == 0 else far
        if high <= low:
            continue
        if 1.0 + high * (a + high * (b + high * c)) <= 0.0:
            left, right = low, high
            for _ in range(200):
                middle = 0.5 * (left + right) if right < 4.0 * left + 1e-3 else math.sqrt(max(left, 1e-6) * right)
                if middle <= left or middle >= right:
                    break
                if 1.0 + middle * (a + middle * (b + middle * c)) > 0.0:
                    left = middle
                else:
                    right = middle
            return left
        low = high
    return UNLIMITED


@compiled
def attitude_at(attitude: Row, exposure_ns: int) -> M3:
    """dcm_BN at an exposure: that of the message, turned on by its rate over the time between."""
    dcm_BN = mrp_to_dcm(vec3(attitude.sigma_BN))
    age = (exposure_ns - attitude.t_ns) / 1e9
    if age == 0.0:
        return dcm_BN
    return matmul(rotvec_to_dcm(scale(age, vec3(attitude.omega_BN_B))), dcm_BN)


@compiled
def too_old(attitude: Row, exposure_ns: int, max_age: float) -> bool:
    """Whether an attitude is further than ``max_age`` [s] from the time of an exposure."""
    return not math.fabs((exposure_ns - attitude.t_ns) / 1e9) <= max_age


@compiled
def sandwich(m: M3, P: M3) -> M3:
    """m P m'."""
    return matmul(matmul(m, P), transpose(m))


@compiled
def orientation_at(orientation: Row, exposure_ns: int) -> M3:
    """dcm_EN at an exposure: that of the message, turned on by its rate over the time between."""
    dcm_EN = mat3(orientation.dcm_EN)
    age = (exposure_ns - orientation.t_ns) / 1e9
    if age == 0.0:
        return dcm_EN
    return matmul(dcm_EN, rotvec_to_dcm(scale(age, vec3(orientation.omega_EN_N))))


@compiled
def pole_frame(pole_N: V3) -> M3:
    """A dcm_EN whose third axis is a pole (any length above 0); the others are any, as for a spheroid."""
    x, y, z = pole_N
    n = math.sqrt(x * x + y * y + z * z)
    e3 = (x / n, y / n, z / n)
    if math.fabs(e3[2]) < 0.9:
        k = math.sqrt(e3[0] * e3[0] + e3[1] * e3[1])
        e1 = (-e3[1] / k, e3[0] / k, 0.0)
    else:
        k = math.sqrt(e3[1] * e3[1] + e3[2] * e3[2])
        e1 = (0.0, -e3[2] / k, e3[1] / k)
    e2 = (e3[1] * e1[2] - e3[2] * e1[1], e3[2] * e1[0] - e3[0] * e1[2], e3[0] * e1[1] - e3[1] * e1[0])
    return (e1, e2, e3)


@compiled
def write_nothing(out: Row, status: int, exposure_ns: int, body_id: int, filler: float) -> None:
    """An invalid position with its reason; every number is ``filler``."""
    out.exposure_ns, out.valid, out.status = exposure_ns, False, status
    out.fault_detected, out.body_id = False, body_id
    for i in range(3):
        out.r_CP_N[i], out.r_CP_B[i], out.r_CP_C[i] = filler, filler, filler
        for j in range(3):
            out.P_rr_N[i, j], out.P_rr_B[i, j], out.P_rr_C[i, j] = filler, filler, filler


@compiled
def write_position(out: Row, r_C: V3, P_C: M3, dcm_CB: M3, dcm_BN: M3, sigma_att: float) -> None:
    """Position [m] and covariance [m^2] in C, B and N; the attitude's error [rad, each axis] goes to N only."""
    dcm_CN = matmul(dcm_CB, dcm_BN)
    store3(out.r_CP_C, r_C)
    store3(out.r_CP_B, mat_t_vec(dcm_CB, r_C))
    r_N = mat_t_vec(dcm_CN, r_C)
    store3(out.r_CP_N, r_N)
    store33(out.P_rr_C, P_C)
    store33(out.P_rr_B, sandwich(transpose(dcm_CB), P_C))
    store33(out.P_rr_N, sandwich(transpose(dcm_CN), P_C))
    if sigma_att > 0.0:
        s2 = sigma_att * sigma_att
        for i in range(3):
            out.P_rr_N[i, i] += s2 * dot(r_N, r_N)
            for j in range(3):
                out.P_rr_N[i, j] -= s2 * r_N[i] * r_N[j]


@compiled
def solve_spd(A: F64, b: F64, x: F64) -> bool:
    """x = A^-1 b for a symmetric positive definite A (3, 3), by Cholesky on the matrix scaled to a unit diagonal.

    Returns:
        False, with ``x`` unchanged, if a pivot of the scaled matrix is below 1e-13 or anything is NaN.
    """
    if not (A[0, 0] > 0.0 and A[1, 1] > 0.0 and A[2, 2] > 0.0):
        return False
    s0, s1, s2 = 1.0 / math.sqrt(A[0, 0]), 1.0 / math.sqrt(A[1, 1]), 1.0 / math.sqrt(A[2, 2])
    a, c, e = A[0, 1] * s0 * s1, A[0, 2] * s0 * s2, A[1, 2] * s1 * s2
    p1 = 1.0 - a * a
    if not p1 > 1e-13:
        return False
    l11 = math.sqrt(p1)
    l21 = (e - a * c) / l11
    p2 = 1.0 - c * c - l21 * l21
    if not p2 > 1e-13:
        return False
    l22 = math.sqrt(p2)
    y0 = b[0] * s0
    y1 = (b[1] * s1 - a * y0) / l11
    y2 = (b[2] * s2 - c * y0 - l21 * y1) / l22
    z2 = y2 / l22
    z1 = (y1 - l21 * z2) / l11
    z0 = y0 - a * z1 - c * z2
    x[0], x[1], x[2] = z0 * s0, z1 * s1, z2 * s2
    return True


@compiled
def invert_spd(A: F64, out: F64) -> bool:
    """out = A^-1 by three `solve_spd`; False if A (3, 3) is not safely positive definite."""
    unit, column = np.zeros(3), np.zeros(3)
    for k in range(3):
        unit[0], unit[1], unit[2] = 0.0, 0.0, 0.0
        unit[k] = 1.0
        if not solve_spd(A, unit, column):
            return False
        for i in range(3):
            out[i, k] = column[i]
    for i in range(3):
        for j in range(i):
            out[i, j] = out[j, i] = 0.5 * (out[i, j] + out[j, i])
    return True
