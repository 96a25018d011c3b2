"""PointedOrbit: a spacecraft on a Kepler orbit that looks at the planet, a little beside it at times."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, KernelModule, Out, Record, Row, Vec3, publish
from fsw.math.attitude import dcm_to_mrp, rotvec_to_dcm
from fsw.math.kepler import elements_to_rv, mean_motion, mean_to_true
from fsw.math.local_frames import orbit_frame, orbit_rate, orbit_rate_derivative
from fsw.math.vectors import add, cross, matmul, matvec, scale, store3, sub, unit, vec3
from messages.states import SCStatesMsg


class PointedOrbit(KernelModule):
    """Exact two-body motion. B is the orbit frame O (z to the planet), turned to and fro about an axis fixed in O."""

    class Params(Record):
        """Parameters."""

        mu: Annotated[float, "m^3/s^2", "gravitational parameter of the planet", Bound(gt=0)]
        a: Annotated[float, "m", "semi-major axis", Bound(gt=0)]
        e: Annotated[float, "-", "eccentricity", Bound(ge=0, lt=1)]
        inclination: Annotated[float, "rad", "inclination to the x-y plane of N"] = 0.0
        node: Annotated[float, "rad", "right ascension of the ascending node"] = 0.0
        periapsis: Annotated[float, "rad", "argument of periapsis"] = 0.0
        anomaly: Annotated[float, "rad", "mean anomaly at time zero"] = 0.0
        axis_O: Annotated[Vec3, "-", "axis about which the body sways"] = np.array([1.0, 0.0, 0.0])
        sway: Annotated[float, "rad", "largest angle of the sway"] = 0.0
        sway_rate: Annotated[float, "rad/s", "angular frequency of the sway"] = 0.0

    out_state = Out(SCStatesMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_state: Row) -> None:
        """Evaluate orbit and attitude at the time of the step."""
        t = t_ns / 1e9
        mean = params.anomaly + mean_motion(params.a, params.e, params.mu) * t
        angles = (params.inclination, params.node, params.periapsis, mean_to_true(mean, params.e))
        r, v = elements_to_rv((params.a, params.e, angles[0], angles[1], angles[2], angles[3]), params.mu)
        axis, turn = unit(vec3(params.axis_O)), params.sway_rate * t
        dcm_BO = rotvec_to_dcm(scale(params.sway * math.sin(turn), axis))
        omega_BO = scale(params.sway * params.sway_rate * math.cos(turn), axis)  # the axis is the same in B and O
        omega_ON_B = matvec(dcm_BO, orbit_rate(r, v))
        change = matvec(dcm_BO, orbit_rate_derivative(r, v))
        swing = scale(-params.sway * params.sway_rate * params.sway_rate * math.sin(turn), axis)
        store3(out_state.r_BN_N, r)
        store3(out_state.v_BN_N, v)
        store3(out_state.sigma_BN, dcm_to_mrp(matmul(dcm_BO, orbit_frame(r, v))))
        store3(out_state.omega_BN_B, add(omega_BO, omega_ON_B))
        store3(out_state.omegaDot_BN_B, add(swing, sub(change, cross(omega_BO, omega_ON_B))))
        publish(out_state, t_ns)
