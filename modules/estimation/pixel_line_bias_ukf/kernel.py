"""What a state sees of the body: the circle through its limb, minus the bias."""

from __future__ import annotations

from typing import TypeAlias

from fsw.math.camera import undistort_point
from fsw.math.compiled import compiled
from fsw.math.square_root import OK
from fsw.math.two_body import two_body_motion
from fsw.math.vectors import M3, V3, matvec
from messages.base import F64
from modules.estimation.pixel_line_bias_ukf.limb import limb_circle
from modules.estimation.relative_od_ukf import status

Scene: TypeAlias = tuple[F64, V3, M3, M3, F64, F64]
"""Lens (11,), semi-axes [m], dcm_CN, dcm_EC, work for the limb, and the first position looked from with its circle.

The last is (9,): 1 if there is one, position, circle, start of the search for the next. Most sigma points differ from
the middle in velocity or bias only and see the same circle.
"""


Flight: TypeAlias = tuple[float, F64]
"""Gravitational parameter [m^3/s^2], and the last middle point with where it went: (13,), calls first."""


@compiled
def orbit_and_bias(point: F64, dt: float, args: Flight) -> int:
    """Motion of a sigma point (9,); those that differ from the middle one in bias only go the same way."""
    mu, middle = args
    first = int(middle[0]) % 19 == 0
    middle[0] += 1.0
    same = not first
    for i in range(6):
        same = same and point[i] == middle[1 + i]
    if same:
        for i in range(6):
            point[i] = middle[7 + i]
        return OK
    if first:
        for i in range(6):
            middle[1 + i] = point[i]
    code = two_body_motion(point, dt, mu)
    if first:
        for i in range(6):
            middle[7 + i] = point[i]
    return code


@compiled
def measure_circle(point: F64, seen: F64, scene: Scene) -> int:
    """Column, row and radius [px] that a state (9,) expects: those of the limb minus the bias."""
    lens, axes, dcm_CN, dcm_EC, limb, first = scene
    if first[0] == 1.0 and first[1] == point[0] and first[2] == point[1] and first[3] == point[2]:
        circle = (first[4], first[5], first[6])
    else:
        r_C = matvec(dcm_CN, (point[0], point[1], point[2]))
        good, circle = limb_circle(lens, axes, dcm_EC, r_C, limb, first[7:])
        if not good:
            return status.OUTSIDE_LENS
        if first[0] == 0.0:
            first[0] = 1.0
            for i in range(3):
                first[1 + i], first[4 + i] = point[i], circle[i]
    for i in range(3):
        seen[i] = circle[i] - point[6 + i]
    return OK


@compiled
def add_attitude_noise(lens: F64, column: float, row: float, sigma: float, R: F64) -> None:
    """Add to R (3, 3) [px^2] what an attitude error of sigma [rad] about each axis does to a centre [px]."""
    x, y = undistort_point(lens, column, row)
    s2 = sigma * sigma
    R[0, 0] += s2 * lens[0] * lens[0] * (x * x * y * y + (1.0 + x * x) ** 2 + y * y)
    R[1, 1] += s2 * lens[1] * lens[1] * (x * x * y * y + (1.0 + y * y) ** 2 + x * x)
    R[0, 1] += s2 * lens[0] * lens[1] * x * y * (1.0 + x * x + y * y)
    R[1, 0] = R[0, 1]
