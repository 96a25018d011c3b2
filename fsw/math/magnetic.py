"""Magnetic fields of a planet: spherical harmonics (IGRF, WMM), centred dipole, tangential field. Compiled.

Positions in m and flux densities in T, both in planet-fixed components E. Gauss coefficients are Schmidt
semi-normalised, as published. The harmonics use the derived Legendre functions of Pines (1973, AIAA Journal 11,
"Uniform representation of the gravitational potential and its derivatives"), which have no singularity at the poles.
"""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, dot, scale
from messages.base import F64

DEGREE = 13
"""Highest degree of the harmonics."""
COUNT = (DEGREE + 1) * (DEGREE + 2) // 2
"""Number of pairs (n, m) with 0 <= m <= n <= 13; they are stored column by column, all n of an order m together."""
RADIUS = 6371200.0
"""Reference radius of IGRF and WMM, m."""


def pair_index(n: int, m: int) -> int:
    """Place of degree ``n`` and order ``m`` in a stored column of coefficients."""
    return m * (DEGREE + 1) - m * (m - 1) // 2 + n - m


def pair_factors() -> F64:
    """Factors (105,) by which published coefficients are multiplied before `harmonic_field` takes them.

    The Schmidt factor sqrt((2 - [m = 0]) (n-m)!/(n+m)!), and 1/(n-m)! that makes the recursion free of divisions.
    """
    factors = np.zeros(COUNT)
    for m in range(DEGREE + 1):
        for n in range(m, DEGREE + 1):
            schmidt = (1.0 if m == 0 else 2.0) * math.factorial(n - m) / math.factorial(n + m)
            factors[pair_index(n, m)] = math.sqrt(schmidt) / math.factorial(n - m)
    return factors


@compiled
def harmonic_field(r: V3, radius: float, degree: int, g: F64, h: F64) -> V3:
    """Flux density at ``r`` of the potential a sum (a/r)^(n+1) (g cos m lon + h sin m lon) P_nm(sin lat).

    Args:
        r: position, m, E components.
        radius: reference radius a, m.
        degree: highest degree, 1 to 13.
        g: cosine coefficients (105,), T, times `pair_factors`.
        h: sine coefficients, likewise.

    Returns:
        Flux density in the unit of the coefficients, E components; NaN at the centre.
    """
    length = math.sqrt(dot(r, r))
    if not length > 0.0:
        return (math.nan, math.nan, math.nan)
    s, t, u = r[0] / length, r[1] / length, r[2] / length
    q = radius / length
    uq, qq = u * q, q * q
    # In column m, f is (a/r)^(n+2) (n-m)! d^m P_n/du^m; (c + i d) = (s + i t)^m, (c1 + i d1) that of m - 1
    diagonal = qq
    c, d, c1, d1 = 1.0, 0.0, 0.0, 0.0
    bx = by = bz = radial = 0.0
    here, left = 0, 0
    for m in range(degree + 1):
        fm = float(m)
        f, before = diagonal, 0.0
        g0 = h0 = gn = hn = gz = hz = 0.0
        for k in range(degree + 1 - m):
            fk = float(k)
            gf, hf = g[here + k] * f, h[here + k] * f
            g0 += gf
            h0 += hf
            gn += fk * gf
            hn += fk * hf
            if m > 0:
                gz += (fk + 1.0) * (g[left + k + 1] * f)
                hz += (fk + 1.0) * (h[left + k + 1] * f)
            # degree n + 1 = m + k + 1
            after = (2.0 * (fm + fk) + 1.0) * uq * f - (2.0 * fm + fk) * fk * qq * before
            before, f = f, after
        bx += fm * (g0 * c1 + h0 * d1)
        by += fm * (h0 * c1 - g0 * d1)
        bz += gz * c1 + hz * d1
        radial += (gn + (2.0 * fm + 1.0) * g0) * c + (hn + (2.0 * fm + 1.0) * h0) * d
        c1, d1 = c, d
        c, d = s * c1 - t * d1, s * d1 + t * c1
        diagonal *= (2.0 * fm + 1.0) * q
        left = here
        here += DEGREE + 1 - m
    radial += u * bz
    return (radial * s - bx, radial * t - by, radial * u - bz)


@compiled
def harmonic_gradient(r: V3, radius: float, degree: int, g: F64, h: F64) -> M3:
    """Derivative of `harmonic_field` by the position, per m: midpoint differences over 2 km, good to 1e-6 of itself.

    The field has neither curl nor divergence, so the matrix is symmetric, its trace is zero, and two of its columns
    are enough.
    """
    step = 1000.0
    a = harmonic_field((r[0] + step, r[1], r[2]), radius, degree, g, h)
    b = harmonic_field((r[0] - step, r[1], r[2]), radius, degree, g, h)
    c = harmonic_field((r[0], r[1] + step, r[2]), radius, degree, g, h)
    d = harmonic_field((r[0], r[1] - step, r[2]), radius, degree, g, h)
    k = 0.5 / step
    xx, xy, xz = k * (a[0] - b[0]), k * (a[1] - b[1]), k * (a[2] - b[2])
    yy, yz = k * (c[1] - d[1]), k * (c[2] - d[2])
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, -xx - yy))


@compiled
def dipole_field(r: V3, radius: float, moment: V3) -> V3:
    """Flux density at ``r`` of a dipole at the centre: (a/r)^3 (3 (m.u) u - m), u = r/abs(r); NaN at the centre.

    Args:
        r: position, m.
        radius: reference radius a, m.
        moment: (g11, h11, g10), T, in the same components as ``r``.
    """
    length = math.sqrt(dot(r, r))
    if not length > 0.0:
        return (math.nan, math.nan, math.nan)
    u = scale(1.0 / length, r)
    q = radius / length
    q3, along = q * q * q, 3.0 * dot(moment, u)
    return (q3 * (along * u[0] - moment[0]), q3 * (along * u[1] - moment[1]), q3 * (along * u[2] - moment[2]))


@compiled
def tangential_field(r: V3, pole: V3, strength: float, dip: float) -> V3:
    """A field of constant strength towards the geographic north, tilted by ``dip`` (rad) below the local horizontal.

    Args:
        r: position, m.
        pole: unit vector along the pole, in the same components.
        strength: magnitude, in the unit of the result.
        dip: angle below the horizontal, rad; positive points down in both hemispheres.

    Returns:
        The field; NaN at the centre and within 1e-6 rad of a pole, where north is not defined.
    """
    radius = math.sqrt(dot(r, r))
    u = scale(1.0 / radius if radius > 0.0 else math.nan, r)
    k = dot(pole, u)
    north = (pole[0] - k * u[0], pole[1] - k * u[1], pole[2] - k * u[2])
    length = math.sqrt(dot(north, north))
    if not length > 1e-6:
        return (math.nan, math.nan, math.nan)
    a, b = strength * math.cos(dip) / length, -strength * math.sin(dip)
    return (a * north[0] + b * u[0], a * north[1] + b * u[1], a * north[2] + b * u[2])
