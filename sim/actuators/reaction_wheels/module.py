"""ReactionWheels: speeds, friction and limits of wheels, and the torque that the spacecraft feels of them."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Out, Record, Row, Shape, Vec3, publish, zeros
from fsw.math.attitude import mrp_to_dcm
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, add, axpy, cross, dot, mat_t_vec, matvec, scale, store3, sub, vec3
from messages.control import MAX_WHEELS, CmdTorqueBodyMsg, RWSpeedMsg, RWStateMsg, RWTorqueMsg
from messages.states import SCStatesMsg
from sim.actuators.reaction_wheels.kernel import Bearing, drag, held_impulse, spun


@compiled
def bearing(params: Row, i: int) -> Bearing:
    """Inertia and friction of wheel ``i``."""
    return Bearing(params.inertia[i], params.viscous[i], params.coulomb[i], params.static[i], params.stribeck)


@compiled
def momentum(params: Row, state: Row, omega: V3) -> V3:
    """Angular momentum of the wheels about their axes relative to N, N m s, B components (Eq. 1)."""
    total = (0.0, 0.0, 0.0)
    for i in range(MAX_WHEELS):
        axis = vec3(params.axes_B[i])
        total = axpy(params.inertia[i] * (state.omega[i] + dot(axis, omega)), axis, total)
    return total


@compiled
def settle(params: Row, state: Row, sigma: V3, omega: V3, dt: float) -> None:
    """Move the wheels on by ``dt`` (s) to the attitude and rate given; note what the spacecraft is owed (Eq. 4, 5)."""
    rate0 = vec3(state.omega_BN_B)
    dcm0, dcm1 = mrp_to_dcm(vec3(state.sigma_BN)), mrp_to_dcm(sigma)
    before = mat_t_vec(dcm0, momentum(params, state, rate0))
    for i in range(MAX_WHEELS):
        if params.inertia[i] > 0.0:
            axis = vec3(params.axes_B[i])
            state.omega[i] += state.torque[i] * dt / params.inertia[i] - dot(axis, sub(omega, rate0))
    gain = sub(mat_t_vec(dcm1, momentum(params, state, omega)), before)
    given = held_impulse(dcm0, dcm1, rate0, omega, vec3(state.torque_B), dt)
    store3(state.owed_N, sub(vec3(state.owed_N), add(gain, given)))


@compiled
def work(params: Row, state: Row, in_motor: Row, out_wheels: Row) -> None:
    """The mean torque on each wheel over the coming interval, ``state.torque`` (Eq. 2, 3)."""
    dt = state.interval
    saturated = 0
    for i in range(MAX_WHEELS):
        state.torque[i] = out_wheels.motor_torque[i] = out_wheels.friction_torque[i] = 0.0
        if not params.inertia[i] > 0.0:
            continue
        command = in_motor.torque[i] if in_motor.seq > 0 else 0.0
        if not math.isfinite(command):
            raise ValueError("in_motor.torque: expected finite numbers (N m), got NaN or infinity; look at its writer")
        speed, limit, most = state.omega[i], params.max_torque[i], params.max_speed[i]
        motor = command
        if limit > 0.0:
            motor = max(-limit, min(limit, command))
        full = motor != command
        b = bearing(params, i)
        friction = drag(speed, motor, b)
        total = friction + motor
        after = speed
        if dt > 0.0:
            after = spun(speed, motor, dt, b)
            total = params.inertia[i] * (after - speed) / dt
            friction = total - motor
        outward = total * speed > 0.0
        if most > 0.0 and outward and math.fabs(after) >= most:
            # the motor does as much as keeps the wheel at its limit
            held = math.copysign(max(most, math.fabs(speed)), speed)
            total = params.inertia[i] * (held - speed) / dt if dt > 0.0 else 0.0
            friction = drag(held, 0.0, b)
            motor = total - friction
            full = True
        state.torque[i] = total
        out_wheels.motor_torque[i], out_wheels.friction_torque[i] = motor, friction
        saturated += 1 if full else 0
    out_wheels.saturated = saturated


class ReactionWheels(KernelModule):
    """Up to eight reaction wheels with friction and limits. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        axes_B: Annotated[F64, Shape(MAX_WHEELS, 3), "-", "axes of the wheels, unit vectors, B components"] = zeros(
            MAX_WHEELS, 3
        )
        inertia: Annotated[F64, Shape(MAX_WHEELS), "kg*m^2", "about the axes; 0 for no wheel", Bound(ge=0)] = zeros(
            MAX_WHEELS
        )
        max_torque: Annotated[F64, Shape(MAX_WHEELS), "N*m", "largest torque of a motor; 0 for any", Bound(ge=0)] = (
            zeros(MAX_WHEELS)
        )
        max_speed: Annotated[F64, Shape(MAX_WHEELS), "rad/s", "largest speed; 0 for any", Bound(ge=0)] = zeros(
            MAX_WHEELS
        )
        viscous: Annotated[F64, Shape(MAX_WHEELS), "N*m*s", "friction for each rad/s", Bound(ge=0)] = zeros(MAX_WHEELS)
        coulomb: Annotated[F64, Shape(MAX_WHEELS), "N*m", "friction at any speed", Bound(ge=0)] = zeros(MAX_WHEELS)
        static: Annotated[
            F64, Shape(MAX_WHEELS), "N*m", "friction that holds a wheel at rest; not below `coulomb`", Bound(ge=0)
        ] = zeros(MAX_WHEELS)
        stribeck: Annotated[float, "rad/s", "speed over which static friction falls to Coulomb's", Bound(gt=0)] = 1.0

        def __post_init__(self) -> None:
            """Check axes and friction too."""
            super().__post_init__()
            there = self.inertia > 0.0
            length = np.linalg.norm(self.axes_B[there], axis=1)
            if np.any(np.abs(length - 1.0) > 1e-9):
                text = "expected unit vectors for the wheels with an inertia, got lengths"
                raise ValueError(f"ReactionWheels.Params.axes_B: {text} {length.tolist()}; divide by them")
            if np.any(self.static < self.coulomb):
                text = f"expected at least coulomb = {self.coulomb.tolist()}, got {self.static.tolist()}"
                raise ValueError(f"ReactionWheels.Params.static: {text}; set it equal for no static friction")

    class State(Record):
        """Speeds, and what has to be remembered of the coming interval to close it; begin with ``omega`` only."""

        omega: Annotated[F64, Shape(MAX_WHEELS), "rad/s", "speed of each wheel relative to the body"] = zeros(
            MAX_WHEELS
        )
        torque: Annotated[F64, Shape(MAX_WHEELS), "N*m", "mean torque on each wheel over the interval"] = zeros(
            MAX_WHEELS
        )
        torque_B: Annotated[Vec3, "N*m", "torque given to the spacecraft for the interval"] = zeros(3)
        gyroscopic_B: Annotated[Vec3, "N*m", "omega x h at the begin of the interval"] = zeros(3)
        before_B: Annotated[Vec3, "N*m", "omega x h at the begin of the interval before"] = zeros(3)
        owed_N: Annotated[Vec3, "N*m*s", "impulse that the spacecraft has not got yet, N components"] = zeros(3)
        sigma_BN: Annotated[Vec3, "-", "attitude at the begin of the interval, MRP"] = zeros(3)
        omega_BN_B: Annotated[Vec3, "rad/s", "rate at the begin of the interval"] = zeros(3)
        begin_ns: Annotated[int, "ns", "begin of the interval; -1 before the first"] = -1
        interval: Annotated[float, "s", "length of the last interval; 0 before its end"] = 0.0

    in_state = In(SCStatesMsg)
    in_motor = In(RWTorqueMsg, optional=True)
    out_torque = Out(CmdTorqueBodyMsg)
    out_speeds = Out(RWSpeedMsg)
    out_wheels = Out(RWStateMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_state: Row,
        in_motor: Row,
        out_torque: Row,
        out_speeds: Row,
        out_wheels: Row,
    ) -> None:
        """Close the interval up to the time of the state, and say what torque holds in the next."""
        if in_state.seq == 0:
            return
        sigma, omega = vec3(in_state.sigma_BN), vec3(in_state.omega_BN_B)
        if not math.isfinite(dot(sigma, sigma) + dot(omega, omega)):
            raise ValueError("in_state: expected finite attitude and rate, got NaN or infinity; look at its writer")
        first = state.begin_ns < 0
        if first or in_state.t_ns > state.begin_ns:
            if not first:
                state.interval = (in_state.t_ns - state.begin_ns) / 1e9
                settle(params, state, sigma, omega, state.interval)
            state.begin_ns = in_state.t_ns
            store3(state.sigma_BN, sigma)
            store3(state.omega_BN_B, omega)
            store3(state.before_B, vec3(state.gyroscopic_B))
            store3(state.gyroscopic_B, cross(omega, momentum(params, state, omega)))
        work(params, state, in_motor, out_wheels)
        torque = scale(-1.0, vec3(state.gyroscopic_B))
        if state.interval > 0.0:
            # the mean over the interval to come, by a line through the last two, and what is still owed
            torque = axpy(-0.5, sub(vec3(state.gyroscopic_B), vec3(state.before_B)), torque)
            owed_B = matvec(mrp_to_dcm(sigma), vec3(state.owed_N))
            torque = axpy(1.0 / state.interval, owed_B, torque)
        for i in range(MAX_WHEELS):
            torque = axpy(-state.torque[i], vec3(params.axes_B[i]), torque)
            out_speeds.omega[i] = state.omega[i]
        store3(state.torque_B, torque)
        store3(out_torque.torque_B, torque)
        store3(out_wheels.momentum_B, momentum(params, state, omega))
        publish(out_torque, t_ns)
        publish(out_speeds, t_ns)
        publish(out_wheels, t_ns)
