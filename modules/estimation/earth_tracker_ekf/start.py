"""The first guess as in the source, from a place, a heading, and the camera's angles, corrected where it errs."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.attitude import dcm_to_ep
from fsw.math.compiled import plain
from fsw.math.euler import euler_to_dcm
from fsw.math.geodesy import ecef_from_geodetic
from fsw.math.gravity import MU_EARTH
from fsw.math.vectors import mat3
from messages.base import F64


def initial_state(
    lat: float,
    lon: float,
    h: float,
    roll_pitch_yaw: F64,
    dcm_EN: F64,
    dcm_CB: F64,
    omega_CO_C: F64,
    heading: float = math.pi / 2.0,
    mu: float = MU_EARTH,
) -> tuple[F64, F64, F64, F64]:
    """First guess of a circular orbit.

    Args:
        lat: geodetic latitude [rad].
        lon: longitude [rad].
        h: height above the ellipsoid [m].
        roll_pitch_yaw: (3,) angles of the camera relative to the orbit frame about x, y, z, sequence 3-2-1 [rad]; at
            zero the camera looks to nadir with x along the track.
        dcm_EN: (3, 3) orientation of the Earth.
        dcm_CB: (3, 3) mounting of the camera.
        omega_CO_C: (3,) rate of the camera relative to the orbit frame [rad/s].
        heading: of the inertial velocity, from north to east [rad]; east, as in the source, gives an inclination as
            large as the latitude, and any other one a larger one.
        mu: gravitational parameter [m^3/s^2].

    Returns:
        r_BN_N [m], v_BN_N [m/s], beta_BO, omega_BO_B [rad/s], for the parameters of the filter.

    Raises:
        ValueError: if a number is not finite, or the place is a pole, where there is no east.
    """
    numbers = [lat, lon, h, heading, *np.ravel(roll_pitch_yaw), *np.ravel(dcm_EN), *np.ravel(dcm_CB), *omega_CO_C]
    if not np.all(np.isfinite(numbers)):
        raise ValueError("initial_state: expected finite numbers, got NaN or infinity")
    r_E = np.array(plain(ecef_from_geodetic)(lat, lon, h))
    if not math.hypot(r_E[0], r_E[1]) > 1e-9 * float(np.linalg.norm(r_E)):
        raise ValueError(f"initial_state: at latitude {lat:g} rad there is no east; move the place off the pole")
    up = r_E / np.linalg.norm(r_E)
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    way = math.sin(heading) * east + math.cos(heading) * np.cross(up, east)
    r_N, v_N = dcm_EN.T @ r_E, dcm_EN.T @ (math.sqrt(mu / float(np.linalg.norm(r_E))) * way)
    roll, pitch, yaw = (float(a) for a in roll_pitch_yaw)
    dcm_BO = dcm_CB.T @ np.array(plain(euler_to_dcm)(321, (yaw, pitch, roll)))
    beta_BO = plain(dcm_to_ep)(plain(mat3)(dcm_BO))
    return r_N, v_N, np.array(beta_BO), dcm_CB.T @ omega_CO_C
