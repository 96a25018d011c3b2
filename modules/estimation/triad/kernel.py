"""Covariance of an attitude from two directions, the first of which is met exactly."""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, cross, dot, norm, unit


@compiled
def triad_covariance(anchor: V3, other: V3, sigma_anchor: float, sigma_other: float) -> M3:
    """Covariance of the attitude error in the frame of the directions [rad^2].

    With c, s the cosine and sine of their angle, n = anchor x other / s and p = n x anchor, errors e_n, e_p of the
    anchor and f_n of the other turn the frame by ``(f_n - c e_n) / s`` about the anchor, ``-e_n`` about p, ``e_p``
    about n.
    """
    a, o = unit(anchor), unit(other)
    normal = cross(a, o)
    s, c = norm(normal), dot(a, o)
    p = cross(unit(normal), a)
    va, vo = sigma_anchor * sigma_anchor, sigma_other * sigma_other
    # va (I - a a') + var a a' + cov (a p' + p a')
    along, mixed = (vo + va * c * c) / (s * s) - va, va * c / s
    return (
        (
            va + along * a[0] * a[0] + 2.0 * mixed * a[0] * p[0],
            along * a[0] * a[1] + mixed * (a[0] * p[1] + p[0] * a[1]),
            along * a[0] * a[2] + mixed * (a[0] * p[2] + p[0] * a[2]),
        ),
        (
            along * a[1] * a[0] + mixed * (a[1] * p[0] + p[1] * a[0]),
            va + along * a[1] * a[1] + 2.0 * mixed * a[1] * p[1],
            along * a[1] * a[2] + mixed * (a[1] * p[2] + p[1] * a[2]),
        ),
        (
            along * a[2] * a[0] + mixed * (a[2] * p[0] + p[2] * a[0]),
            along * a[2] * a[1] + mixed * (a[2] * p[1] + p[2] * a[1]),
            va + along * a[2] * a[2] + 2.0 * mixed * a[2] * p[2],
        ),
    )
