"""How the orbit frame O and its rate follow position and velocity, and gravity with its gradient.

O: z to nadir, y against the orbit normal h, x along the track. All derivatives are analytic. With s = h . a, a the
acceleration, omega_ON_O = (0, -h / r^2, -r s / h^2): the last part is small and comes from J2, which turns the orbit.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from fsw.math.compiled import compiled
from fsw.math.gravity import gravity_acceleration
from fsw.math.local_frames import orbit_frame
from fsw.math.vectors import M3, V3, add, axpy, cross, dot, mat_t_vec, matmul, matvec, norm, scale, transpose

Gravity: TypeAlias = tuple[float, float, float, M3]
"""mu [m^3/s^2], reference radius [m], J2, and a matrix from N to a frame whose z axis is the pole."""
Frame: TypeAlias = tuple[M3, V3, M3, M3, M3, M3]
"""dcm_ON, omega_ON_O [rad/s], and derivatives: of the turn of O (O components) and of its rate by r and by v."""


@compiled
def gravity_gradient(r: V3, mu: float, radius: float, j2: float) -> M3:
    """Derivative [1/s^2] of `fsw.math.gravity.gravity_acceleration` by the position; the pole is z."""
    r2 = dot(r, r)
    r5 = r2 * r2 * math.sqrt(r2)
    k, z2 = 1.5 * j2 * mu * radius * radius, r[2] * r[2]
    # -mu r / r^3 and -k (1 - 5 z^2/r^2) r / r^5, -2 k z / r^5 along the pole
    by_r = (3.0 * mu + k * (5.0 - 35.0 * z2 / r2) / r2) / r5
    by_z = 10.0 * k * r[2] / (r5 * r2)
    diagonal = -mu * r2 / r5 - k * (1.0 - 5.0 * z2 / r2) / r5
    x, y, z = r
    xy, xz, yz = by_r * x * y, by_r * x * z + by_z * x, by_r * y * z + by_z * y
    return (
        (diagonal + by_r * x * x, xy, xz),
        (xy, diagonal + by_r * y * y, yz),
        (xz, yz, diagonal + by_r * z2 + 2.0 * by_z * z - 2.0 * k / r5),
    )


@compiled
def gravity_at(r: V3, field: Gravity) -> tuple[V3, M3]:
    """Acceleration [m/s^2] and its gradient [1/s^2], N components."""
    mu, radius, j2, pole = field
    r_P = matvec(pole, r)
    a, G = gravity_acceleration(r_P, mu, radius, j2), gravity_gradient(r_P, mu, radius, j2)
    return mat_t_vec(pole, a), matmul(transpose(pole), matmul(G, pole))


@compiled
def orbit_frame_derivatives(r: V3, v: V3, a: V3, G: M3) -> Frame:
    """The orbit frame with its rate and derivatives; NaN where r and v are parallel.

    Args:
        r: position [m], N.
        v: velocity [m/s], N.
        a: acceleration [m/s^2], N, a function of the position.
        G: its gradient [1/s^2].
    """
    dcm_ON = orbit_frame(r, v)
    x, y, z = dcm_ON
    far, h = norm(r), cross(r, v)
    size, s = norm(h), dot(h, a)
    zero = (0.0, 0.0, 0.0)
    turn_r = (scale(1.0 / far, y), scale(-1.0 / far, x), scale(dot(v, z) / size, y))
    turn_v = (zero, zero, scale(far / size, y))
    # d|h| = (dh_r, dh_v), ds = (ds_r, ds_v), d|r| = -z
    dh_r, dh_v = axpy(dot(v, z), x, scale(-dot(v, x), z)), scale(far, x)
    ds_r, ds_v = add(cross(v, a), matvec(G, h)), cross(a, r)
    f2, h2 = far * far, size * size
    rate_r = (
        zero,
        axpy(-1.0 / f2, dh_r, scale(-2.0 * size / (f2 * far), z)),
        axpy(s / h2, z, axpy(-far / h2, ds_r, scale(2.0 * far * s / (h2 * size), dh_r))),
    )
    rate_v = (
        zero,
        scale(-1.0 / f2, dh_v),
        axpy(-far / h2, ds_v, scale(2.0 * far * s / (h2 * size), dh_v)),
    )
    return dcm_ON, (0.0, -size / f2, -far * s / h2), turn_r, turn_v, rate_r, rate_v
