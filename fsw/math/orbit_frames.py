"""Frames of an orbit: local-vertical (O), Hill (H), and the way from TEME to the Earth-fixed frame.

All functions are pure. Rotations are passive: ``dcm_ON`` maps N components to O components.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled

F64 = NDArray[np.float64]

OMEGA_EARTH = 7.292115146706979e-5
"""Rotation rate of the Earth relative to the stars, rad/s (Vallado, 2013, section 3.5)."""

_ARCSEC = math.pi / 648000.0


@compiled
def dcm_orbit(r: F64, v: F64, out: F64) -> None:
    """Orbit frame O: z to nadir, y against the orbit normal, x along the track (CCSDS "LVLH").

    Args:
        r: (3,) position relative to the Earth's centre, m, components of any frame F.
        v: (3,) inertial velocity, m/s, components of the same F. (The velocity relative to the rotating Earth
            differs in direction by up to 4 degrees and must not be used.)
        out: (3, 3) written: dcm_OF. NaN if r and v are parallel or either is zero: there is no orbit plane.
    """
    hx = r[1] * v[2] - r[2] * v[1]
    hy = r[2] * v[0] - r[0] * v[2]
    hz = r[0] * v[1] - r[1] * v[0]
    h = math.sqrt(hx * hx + hy * hy + hz * hz)
    d = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not h > 1e-12 * d * speed:
        out[:] = math.nan
        return
    yx, yy, yz = -hx / h, -hy / h, -hz / h
    zx, zy, zz = -r[0] / d, -r[1] / d, -r[2] / d
    out[0, 0] = yy * zz - yz * zy
    out[0, 1] = yz * zx - yx * zz
    out[0, 2] = yx * zy - yy * zx
    out[1, 0], out[1, 1], out[1, 2] = yx, yy, yz
    out[2, 0], out[2, 1], out[2, 2] = zx, zy, zz


@compiled
def dcm_hill(r: F64, v: F64, out: F64) -> None:
    """Hill frame H: radial, along track, orbit normal (Schaub and Junkins, 2018, section 14.3).

    Args and failure as `dcm_orbit`; ``out`` (3, 3) becomes dcm_HF.
    """
    dcm_orbit(r, v, out)
    for j in range(3):
        along, down, left = out[0, j], out[2, j], out[1, j]
        out[0, j] = -down
        out[1, j] = along
        out[2, j] = -left


@compiled
def dcm_earth_teme(gmst: float, polar_x: float, polar_y: float, out: F64) -> None:
    """From SGP4's frame TEME to the Earth-fixed frame E.

    Args:
        gmst: Greenwich mean sidereal time of the IAU 1982 model (the one TEME goes with), rad.
        polar_x, polar_y: pole coordinates, arc seconds; left at 0, a point of low Earth orbit moves by at most 20 m.
        out: (3, 3) written: dcm_E_TEME = polar motion times rotation about z by gmst (Vallado et al., 2006, eq. C-1).
    """
    c, s = math.cos(gmst), math.sin(gmst)
    x, y = polar_x * _ARCSEC, polar_y * _ARCSEC
    cx, sx, cy, sy = math.cos(x), math.sin(x), math.cos(y), math.sin(y)
    p01, p02 = sx * sy, sx * cy
    out[0, 0], out[0, 1], out[0, 2] = cx * c - p01 * s, cx * s + p01 * c, p02
    out[1, 0], out[1, 1], out[1, 2] = -cy * s, cy * c, -sy
    out[2, 0], out[2, 1], out[2, 2] = -sx * c - cx * sy * s, -sx * s + cx * sy * c, cx * cy
