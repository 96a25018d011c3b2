"""Spacecraft: the true motion of a rigid body in orbit."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, In, KernelModule, Mat3, Out, Record, Row, Vec3, publish
from fsw.math.attitude import mrp_inner, mrp_to_dcm
from fsw.math.checks import require_inertia
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH, gravity_potential
from fsw.math.vectors import cross, dot, inverse, mat3, mat_t_vec, matvec, scale, store3, vec3
from messages.control import CmdForceBodyMsg, CmdTorqueBodyMsg
from messages.states import ConservedMsg, SCStatesMsg
from sim.dynamics.spacecraft.kernel import angular_acceleration, rk4


class Spacecraft(KernelModule):
    """A rigid body under two-body and J2 gravity, a commanded torque and a commanded force. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        inertia_B: Annotated[Mat3, "kg*m^2", "inertia about the centre of mass B, B components"]
        mass: Annotated[float, "kg", "mass", Bound(gt=0)] = 1000.0
        mu: Annotated[float, "m^3/s^2", "gravitational parameter of the planet; 0 for none", Bound(ge=0)] = MU_EARTH
        radius: Annotated[float, "m", "reference radius of J2", Bound(gt=0)] = RADIUS_EARTH
        j2: Annotated[float, "-", "zonal coefficient of degree 2; 0 for a point mass"] = J2_EARTH
        max_step: Annotated[float, "s", "longest integration step; a longer period is divided evenly", Bound(gt=0)] = (
            0.1
        )

        def __post_init__(self) -> None:
            """Check the inertia too."""
            super().__post_init__()
            require_inertia(self, "inertia_B")

    class State(Record):
        """The motion, and the time at which it holds."""

        r_BN_N: Annotated[Vec3, "m", "position of B relative to the centre of the planet, N components"]
        v_BN_N: Annotated[Vec3, "m/s", "inertial velocity of B, N components"]
        sigma_BN: Annotated[Vec3, "-", "attitude of B relative to N, MRP"]
        omega_BN_B: Annotated[Vec3, "rad/s", "angular velocity of B relative to N, B components"]
        time_ns: Annotated[int, "ns", "simulation time at which the motion holds"] = 0

    in_torque = In(CmdTorqueBodyMsg, optional=True)
    in_force = In(CmdForceBodyMsg, optional=True)
    out_state = Out(SCStatesMsg)
    out_conserved = Out(ConservedMsg)

    @staticmethod
    def kernel(
        t_ns: int, params: Row, state: Row, in_torque: Row, in_force: Row, out_state: Row, out_conserved: Row
    ) -> None:
        """Integrate up to ``t_ns`` with the newest torque and force."""
        torque = push = (0.0, 0.0, 0.0)
        if in_torque.seq > 0:
            torque = vec3(in_torque.torque_B)
        if in_force.seq > 0:
            push = scale(1.0 / params.mass, vec3(in_force.force_B))
        if not math.isfinite(torque[0] + torque[1] + torque[2]):
            raise ValueError(
                "in_torque.torque_B: expected finite numbers (N m), got NaN or infinity; look at its writer"
            )
        if not math.isfinite(push[0] + push[1] + push[2]):
            raise ValueError("in_force.force_B: expected finite numbers (N), got NaN or infinity; look at its writer")
        if t_ns < state.time_ns:
            raise ValueError("State.time_ns: expected a time up to that of the first step, got a later one")
        inertia = mat3(params.inertia_B)
        body = (inertia, inverse(inertia))
        planet = (params.mu, params.radius, params.j2)
        y = (vec3(state.r_BN_N), vec3(state.v_BN_N), mrp_inner(vec3(state.sigma_BN)), vec3(state.omega_BN_B))
        duration = (t_ns - state.time_ns) / 1e9
        steps: int = math.ceil(duration / params.max_step - 1e-9)
        for _ in range(steps):
            y = rk4(y, duration / steps, torque, push, body, planet)
            y = (y[0], y[1], mrp_inner(y[2]), y[3])
        r, v, sigma, omega = y
        if not math.isfinite(dot(r, v) + dot(sigma, omega)):
            raise ValueError("the motion is no longer finite: it met the planet's centre, or max_step is far too long")
        state.time_ns = t_ns
        store3(state.r_BN_N, r)
        store3(state.v_BN_N, v)
        store3(state.sigma_BN, sigma)
        store3(state.omega_BN_B, omega)

        store3(out_state.r_BN_N, r)
        store3(out_state.v_BN_N, v)
        store3(out_state.sigma_BN, sigma)
        store3(out_state.omega_BN_B, omega)
        store3(out_state.omegaDot_BN_B, angular_acceleration(omega, torque, body))
        publish(out_state, t_ns)

        momentum = matvec(inertia, omega)
        potential = gravity_potential(r, params.mu, params.radius, params.j2)
        out_conserved.energy_orbit = 0.5 * dot(v, v) + potential
        store3(out_conserved.momentum_orbit_N, cross(r, v))
        out_conserved.energy_rotation = 0.5 * dot(omega, momentum)
        store3(out_conserved.momentum_rotation_N, mat_t_vec(mrp_to_dcm(sigma), momentum))
        publish(out_conserved, t_ns)
