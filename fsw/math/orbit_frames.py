"""Frames of `local_frames` on arrays, and the way from TEME to the Earth-fixed frame.

All functions are pure. Rotations are passive: ``dcm_ON`` maps N components to O components.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from fsw.math.local_frames import hill_frame, orbit_frame
from fsw.math.vectors import store33, vec3

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
    store33(out, orbit_frame(vec3(r), vec3(v)))


@compiled
def dcm_hill(r: F64, v: F64, out: F64) -> None:
    """Hill frame H: radial, along track, orbit normal (Schaub and Junkins, 2018, section 14.3).

    Args and failure as `dcm_orbit`; ``out`` (3, 3) becomes dcm_HF.
    """
    store33(out, hill_frame(vec3(r), vec3(v)))


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
