"""Spacecraft: the true motion of a rigid body in orbit."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, Vec3, publish, zeros
from fsw.math import geodesy
from fsw.math.attitude import mrp_inner, mrp_to_dcm
from fsw.math.checks import require_inertia
from fsw.math.forces import Scene, field_potential, position_E
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH
from fsw.math.vectors import cross, dot, inverse, mat3, mat_t_vec, matvec, store3, vec3
from messages.control import CmdForceBodyMsg, CmdTorqueBodyMsg
from messages.environment import AtmosphereMsg, EclipseMsg, EphemerisMsg, MagneticFieldMsg, PlanetOrientationMsg
from messages.sensors import SpecificForceMsg
from messages.states import ConservedMsg, SCStatesMsg
from sim.dynamics.spacecraft.kernel import adaptive, angular_acceleration, felt, rk4
from sim.dynamics.spacecraft.scene import World, require_forces, require_loads, require_outside


class Spacecraft(KernelModule):
    """A rigid body under gravity, drag, sunlight, commanded torque and force. See SPEC.md."""

    class Params(Record):
        """Parameters; the defaults are the Earth with J2 and nothing else."""

        inertia_B: Annotated[Mat3, "kg*m^2", "inertia about the centre of mass B, B components"]
        mass: Annotated[float, "kg", "mass", Bound(gt=0)] = 1000.0
        mu: Annotated[float, "m^3/s^2", "gravitational parameter of the planet; 0 for none", Bound(ge=0)] = MU_EARTH
        radius: Annotated[float, "m", "reference radius of the gravity field", Bound(gt=0)] = RADIUS_EARTH
        j2: Annotated[float, "-", "zonal coefficient of degree 2; 0 for a point mass"] = J2_EARTH
        j3: Annotated[float, "-", "zonal coefficient of degree 3"] = 0.0
        j4: Annotated[float, "-", "zonal coefficient of degree 4"] = 0.0
        j5: Annotated[float, "-", "zonal coefficient of degree 5"] = 0.0
        j6: Annotated[float, "-", "zonal coefficient of degree 6"] = 0.0
        degree: Annotated[int, "-", "degree of the spherical harmonics; 0: the zonals", Bound(ge=0, le=50)] = 0
        C: Annotated[F64, Shape(51, 51), "-", "cosine coefficients, fully normalised"] = zeros(51, 51)
        S: Annotated[F64, Shape(51, 51), "-", "sine coefficients, fully normalised"] = zeros(51, 51)
        surface_radius: Annotated[float, "m", "equatorial radius of the planet's surface", Bound(gt=0)] = geodesy.A
        flattening: Annotated[float, "-", "flattening of the planet's surface", Bound(ge=0, lt=1)] = geodesy.F
        drag_coefficient: Annotated[float, "-", "drag coefficient", Bound(ge=0)] = 2.2
        drag_area: Annotated[float, "m^2", "area that meets the air; 0: no drag", Bound(ge=0)] = 0.0
        light_coefficient: Annotated[float, "-", "1 absorbs all light, 2 sends it all back", Bound(ge=0)] = 1.3
        light_area: Annotated[float, "m^2", "area that meets sunlight; 0: no pressure", Bound(ge=0)] = 0.0
        dipole_B: Annotated[Vec3, "A*m^2", "residual magnetic dipole, B components"] = zeros(3)
        gravity_gradient: Annotated[bool, "-", "whether the gradient of gravity turns the body"] = False
        max_step: Annotated[float, "s", "longest step of RK4; a longer period is divided evenly", Bound(gt=0)] = 0.1
        tolerance: Annotated[float, "-", "relative error of a step of DOP853; 0: RK4 instead", Bound(ge=0, le=0.01)] = (
            0.0
        )

        def __post_init__(self) -> None:
            """Check the inertia too, and that harmonics have coefficients."""
            super().__post_init__()
            require_inertia(self, "inertia_B")
            if self.degree > 0 and not self.C.any():
                raise ValueError("Spacecraft.Params.C: expected coefficients, because degree > 0, got zeros")

    class State(Record):
        """The motion and the time at which it holds; the rest is the memory of the adaptive method."""

        r_BN_N: Annotated[Vec3, "m", "position of B relative to the centre of the planet, N components"]
        v_BN_N: Annotated[Vec3, "m/s", "inertial velocity of B, N components"]
        sigma_BN: Annotated[Vec3, "-", "attitude of B relative to N, MRP"]
        omega_BN_B: Annotated[Vec3, "rad/s", "angular velocity of B relative to N, B components"]
        dv_BN_N: Annotated[Vec3, "m/s", "velocity gained by all but gravity, N components"] = zeros(3)
        time_ns: Annotated[int, "ns", "simulation time at which the motion holds"] = 0
        arc_start_ns: Annotated[int, "ns", "begin of the last adaptive step"] = 0
        arc_end_ns: Annotated[int, "ns", "end of the last adaptive step"] = 0
        next_step: Annotated[float, "s", "what the error allows for the next adaptive step; 0: not known"] = 0.0
        work: Annotated[F64, Shape(29, 15), "-", "interpolant, stages and loads of the last adaptive step"] = zeros(
            29, 15
        )

    in_torque = In(CmdTorqueBodyMsg, optional=True)
    in_force = In(CmdForceBodyMsg, optional=True)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    in_sun = In(EphemerisMsg, optional=True)
    in_moon = In(EphemerisMsg, optional=True)
    in_atmosphere = In(AtmosphereMsg, optional=True)
    in_eclipse = In(EclipseMsg, optional=True)
    in_field = In(MagneticFieldMsg, optional=True)
    out_state = Out(SCStatesMsg)
    out_force = Out(SpecificForceMsg)
    out_conserved = Out(ConservedMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_torque: Row,
        in_force: Row,
        in_orientation: Row,
        in_sun: Row,
        in_moon: Row,
        in_atmosphere: Row,
        in_eclipse: Row,
        in_field: Row,
        out_state: Row,
        out_force: Row,
        out_conserved: Row,
    ) -> None:
        """Integrate up to ``t_ns`` with the newest inputs."""
        if t_ns < state.time_ns:
            raise ValueError("State.time_ns: expected a time up to that of the first step, got a later one")
        moving = t_ns > state.time_ns
        scene = Scene(state.time_ns, params, in_orientation, in_sun, in_moon, in_atmosphere, in_eclipse)
        inertia = mat3(params.inertia_B)
        dragged = params.drag_area > 0.0 and in_atmosphere.seq > 0
        lit = params.light_area > 0.0 and in_sun.seq > 0
        pushed = dragged or lit or in_force.seq > 0
        world = World(scene, in_torque, in_force, in_field, inverse(inertia), pushed)
        require_forces(scene, moving)
        require_loads(world, moving)
        sigma, dv = mrp_inner(vec3(state.sigma_BN)), vec3(state.dv_BN_N)
        y = (vec3(state.r_BN_N), vec3(state.v_BN_N), sigma, vec3(state.omega_BN_B), dv)
        duration = (t_ns - state.time_ns) / 1e9
        if params.tolerance > 0.0:
            if moving:
                y = adaptive(y, t_ns, state, params.tolerance, world)
                y = (y[0], y[1], mrp_inner(y[2]), y[3], y[4])
        else:
            steps: int = math.ceil(duration / params.max_step - 1e-9)
            h = duration / max(steps, 1)
            for i in range(steps):
                require_outside(y[0], i * h, scene)
                y = rk4(y, i * h, h, world)
                y = (y[0], y[1], mrp_inner(y[2]), y[3], y[4])
        r, v, sigma, omega, dv = y
        if not math.isfinite(dot(r, v) + dot(sigma, omega)):
            raise ValueError("the motion is no longer finite: it met the planet's centre, or max_step is far too long")
        require_outside(r, duration, scene)
        state.time_ns = t_ns
        store3(state.r_BN_N, r)
        store3(state.v_BN_N, v)
        store3(state.sigma_BN, sigma)
        store3(state.omega_BN_B, omega)
        store3(state.dv_BN_N, dv)

        store3(out_state.r_BN_N, r)
        store3(out_state.v_BN_N, v)
        store3(out_state.sigma_BN, sigma)
        store3(out_state.omega_BN_B, omega)
        store3(out_state.omegaDot_BN_B, angular_acceleration(r, sigma, omega, world))
        publish(out_state, t_ns)

        accel_N = felt(y, duration, world) if pushed else (0.0, 0.0, 0.0)
        dcm_BN = mrp_to_dcm(sigma)
        store3(out_force.accel_BN_B, matvec(dcm_BN, accel_N))
        store3(out_force.dv_BN_N, dv)
        publish(out_force, t_ns)

        momentum = matvec(inertia, omega)
        out_conserved.energy_orbit = 0.5 * dot(v, v) + field_potential(position_E(r, duration, scene), params)
        store3(out_conserved.momentum_orbit_N, cross(r, v))
        out_conserved.energy_rotation = 0.5 * dot(omega, momentum)
        store3(out_conserved.momentum_rotation_N, mat_t_vec(dcm_BN, momentum))
        publish(out_conserved, t_ns)
