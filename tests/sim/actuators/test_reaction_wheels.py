"""ReactionWheels against a fully coupled integration, against scipy's friction with events, and Basilisk's wheels."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from fsw import KernelModule, Module, ModuleError, Out, Record, Row, Simulation, Task, ms, publish, s
from messages.base import F64
from messages.control import RWTorqueMsg
from messages.states import SCStatesMsg
from sim.actuators.reaction_wheels import ReactionWheels
from sim.actuators.reaction_wheels.kernel import Bearing, spun
from sim.dynamics.spacecraft import Spacecraft

Criterion = Callable[[str, float], None]
INERTIA = np.array([[900.0, 12.0, -7.0], [12.0, 800.0, 20.0], [-7.0, 20.0, 600.0]])
AXES = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1 / np.sqrt(3)] * 3])
SIGMA, OMEGA = np.array([0.1, 0.2, -0.3]), np.array([0.01, -0.02, 0.03])
SPEEDS = np.array([200.0, -150.0, 300.0, 40.0])
WHEEL = 0.1
"""Inertia of each wheel, kg m^2."""
MOTOR = np.array([0.02, -0.01, 0.015, -0.005])
OFF = 500
"""The motors are switched off then, s."""
VISCOUS, COULOMB = 2e-5, 5e-4


def padded(a: Any) -> F64:
    """Eight places."""
    a = np.asarray(a, float)
    return np.concatenate([a, np.zeros((8 - len(a), *a.shape[1:]))])


class Motors(KernelModule):
    """Constant torques up to `OFF`."""

    class Params(Record):
        """None."""

    out_motor = Out(RWTorqueMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_motor: Row) -> None:
        """Write."""
        on = 1.0 if t_ns < OFF * 1_000_000_000 else 0.0
        for i in range(8):
            out_motor.torque[i] = on * MOTOR[i] if i < 4 else 0.0
        publish(out_motor, t_ns)


def wheel_params(friction: float = 1.0, n: int = 4, **more: Any) -> ReactionWheels.Params:
    level = padded(np.full(n, friction * COULOMB))
    return ReactionWheels.Params(
        axes_B=padded(AXES[:n]),
        inertia=padded(np.full(n, WHEEL)),
        viscous=padded(np.full(n, friction * VISCOUS)),
        coulomb=level,
        static=level,
        **more,
    )


class Case:
    """A spacecraft far from everything, with four wheels and motors."""

    def __init__(self, period_ns: int, friction: float = 1.0, first: bool = False) -> None:
        start = Spacecraft.State(
            r_BN_N=np.array([7e6, 0, 0]), v_BN_N=np.zeros(3), sigma_BN=SIGMA.copy(), omega_BN_B=OMEGA.copy()
        )
        self.craft = Spacecraft("craft", Spacecraft.Params(inertia_B=INERTIA, mu=0.0), start)
        state = ReactionWheels.State(omega=padded(SPEEDS))
        self.wheels = ReactionWheels("wheels", wheel_params(friction), state)
        motors = Motors("motors")
        motors.out_motor.connect(self.wheels.in_motor)
        self.craft.out_state.connect(self.wheels.in_state, delayed=first)
        self.wheels.out_torque.connect(self.craft.in_torque, delayed=not first)
        order: list[Module] = [motors, self.wheels, self.craft] if first else [motors, self.craft, self.wheels]
        self.sim = Simulation([Task("truth", period_ns, order)])

    def total(self) -> F64:
        """Angular momentum of all, N components."""
        state, wheels = self.craft.out_state.latest(), self.wheels.out_wheels.latest()
        assert state is not None
        assert wheels is not None
        return Rotation.from_mrp(state.sigma_BN.copy()).apply(INERTIA @ state.omega_BN_B + wheels.momentum_B)


def coupled(until: float, friction: float = 1.0) -> tuple[Rotation, F64, F64]:
    """Attitude, rate and speeds by DOP853 with the relative speeds as states: the whole mass matrix is solved."""
    mass = np.zeros((7, 7))
    mass[:3, :3] = INERTIA + WHEEL * AXES.T @ AXES
    mass[:3, 3:], mass[3:, :3], mass[3:, 3:] = WHEEL * AXES.T, WHEEL * AXES, WHEEL * np.eye(4)
    inverse = np.linalg.inv(mass)

    def slope(t: float, y: F64, motor: F64) -> F64:
        q, w, speed = y[:4], y[4:7], y[7:]
        qw = np.concatenate([[-q[1:] @ w], q[0] * w + np.cross(q[1:], w)]) / 2.0
        h = INERTIA @ w + WHEEL * AXES.T @ (speed + AXES @ w)
        drag = friction * (COULOMB * np.sign(speed) + VISCOUS * speed)
        return np.concatenate([qw, inverse @ np.concatenate([-np.cross(w, h), motor - drag])])

    y = np.concatenate([Rotation.from_mrp(SIGMA).as_quat(scalar_first=True), OMEGA, SPEEDS])
    for begin, end, motor in [(0.0, min(until, OFF), MOTOR), (min(until, OFF), until, 0.0 * MOTOR)]:
        if end > begin:
            y = solve_ivp(slope, (begin, end), y, "DOP853", args=(motor,), rtol=1e-12, atol=1e-13).y[:, -1]
    return Rotation.from_quat(y[:4], scalar_first=True), y[4:7], y[7:]


def test_momentum_over_an_hour(criterion: Criterion) -> None:
    """Total angular momentum in N at 0.1 s, relative: the largest change from the second step on, and of the first."""
    case = Case(ms(100))
    case.sim.run_until(0)
    start = case.total()
    case.sim.step()
    first = float(np.linalg.norm(case.total() - start) / np.linalg.norm(start))
    case.sim.step()
    worst = 0.0
    states, wheels = case.craft.out_state.record(), case.wheels.out_wheels.record()
    case.sim.run_until(s(3600))
    hub = states["omega_BN_B"] @ INERTIA + wheels["momentum_B"]
    total = Rotation.from_mrp(states["sigma_BN"].copy()).apply(hub)
    worst = float(np.max(np.linalg.norm(total - start, axis=1)) / np.linalg.norm(start))
    criterion("WHEELS-1", worst)
    criterion("WHEELS-2", first)


def errors(period_ns: int, until: int, truth: tuple[Rotation, F64, F64], first: bool = False) -> F64:
    """Of attitude (rad), rate (rad/s), speeds of the wheels (rad/s)."""
    case = Case(period_ns, first=first)
    case.sim.run_until(s(until))
    state = case.craft.out_state.latest()
    assert state is not None
    if first:  # it closes the last interval when it runs next
        case.wheels.step(s(until) + 1)
    speeds = case.wheels.out_speeds.latest()
    assert speeds is not None
    turn = (Rotation.from_mrp(state.sigma_BN.copy()).inv() * truth[0]).magnitude()
    rate, speed = np.linalg.norm(state.omega_BN_B - truth[1]), np.max(np.abs(speeds.omega[:4] - truth[2]))
    return np.array([float(turn), float(rate), float(speed)])


def test_against_a_coupled_integration(criterion: Criterion) -> None:
    """At 0.1 s after 1,000 s, with motors that are switched off half way; and the order over three periods."""
    truth = coupled(1000.0)
    coarse, middle, fine = (errors(ms(p), 1000, truth) for p in (200, 100, 50))
    criterion("WHEELS-3", middle[0])
    criterion("WHEELS-4", middle[2])
    criterion("WHEELS-5", float(np.log2(coarse[0] / fine[0])) / 2.0 - 2.0)


def test_before_or_after_the_spacecraft_in_the_task() -> None:
    """Both orders take the same torque for the same interval, if the motors do not change."""
    truth = coupled(300.0)
    np.testing.assert_allclose(errors(ms(100), 300, truth, first=True), errors(ms(100), 300, truth), rtol=0.01)


def test_against_basilisk(criterion: Criterion) -> None:
    """Four wheels with friction for 400 s at 10 ms; Basilisk integrates spacecraft and wheels together."""
    path = Path(__file__).parents[2] / "data" / "basilisk_reaction_wheels.json"
    theirs: dict[str, Any] = json.loads(path.read_text())
    case = Case(ms(10))
    states, speeds = case.craft.out_state.record(every=s(50)), case.wheels.out_speeds.record(every=s(50))
    case.sim.run_until(s(400))
    turn = Rotation.from_mrp(states["sigma_BN"].copy()).inv() * Rotation.from_mrp(theirs["sigma_BN"])
    criterion("WHEELS-6", float(np.max(turn.magnitude())))
    criterion("WHEELS-7", float(np.max(np.abs(speeds["omega"][:, :4] - theirs["wheel_speeds"]))))


def slowed(start: float, torque: float, b: Bearing, until: float) -> float:
    """Speed of a wheel that goes through standstill or stops there, by LSODA in pieces between the events."""

    def slope(t: float, y: F64, sign: float) -> list[float]:
        level = b.coulomb + (b.static - b.coulomb) * np.exp(-((y[0] / b.stribeck) ** 2))
        return [(torque - sign * level - b.viscous * y[0]) / b.inertia]

    def stop(t: float, y: F64, sign: float) -> float:
        return float(y[0])

    stop.terminal, stop.direction = True, -np.sign(start)  # type: ignore[attr-defined]
    part = solve_ivp(slope, (0, until), [start], "LSODA", args=(np.sign(start),), events=stop, rtol=1e-11, atol=1e-12)
    if part.status == 0 or abs(torque) <= b.static:
        return float(part.y[0, -1]) if part.status == 0 else 0.0
    rest = (part.t[-1], until)
    return float(solve_ivp(slope, rest, [0.0], "LSODA", args=(np.sign(torque),), rtol=1e-11, atol=1e-12).y[0, -1])


def test_friction_through_standstill(criterion: Criterion) -> None:
    """Static, Coulomb and viscous friction; wheels that turn over, stop for good, and go on. In periods of 0.1 s."""
    b = Bearing(0.01, 1e-4, 1e-3, 2e-3, 0.5)
    worst = 0.0
    for start, torque in [(1.0, -4e-3), (-0.6, 3e-3), (0.9, 1.5e-3), (1.0, -1.9e-3), (0.02, 2.2e-3), (30.0, -0.05)]:
        speed = start
        for k in range(1, 101):
            speed = spun(speed, torque, 0.1, b)
            if k % 20 == 0:
                worst = max(worst, abs(speed - slowed(start, torque, b, 0.1 * k)))
    assert spun(1.0, -1.9e-3, 10.0, b) == 0.0, "static friction holds it once it stands"
    criterion("WHEELS-8", worst)


def test_constant_friction_is_exact() -> None:
    """With static equal to Coulomb friction one step is the analytic solution, however long it is."""
    b = Bearing(0.02, 3e-4, 1e-3, 1e-3, 1.0)
    end = (5e-3 - 1e-3) / 3e-4
    expected = end + (2.0 - end) * np.exp(-3e-4 * 50.0 / 0.02)
    np.testing.assert_allclose(spun(2.0, 5e-3, 50.0, b), expected, rtol=1e-14)
    np.testing.assert_allclose(spun(spun(2.0, 5e-3, 20.0, b), 5e-3, 30.0, b), expected, rtol=1e-14)
    assert spun(2.0, 0.0, 50.0, b) == 0.0
    free = Bearing(0.02, 0.0, 0.0, 0.0, 1.0)
    assert spun(-1.0, 0.02, 3.0, free) == 2.0


def test_a_small_spacecraft_stays_stable() -> None:
    """Nutation of 1 rad/s (momentum of the wheels over the inertia) at 0.1 s for an hour does not grow."""
    inertia = np.diag([0.05, 0.06, 0.03])
    start = Spacecraft.State(r_BN_N=np.array([7e6, 0, 0]), v_BN_N=np.zeros(3), sigma_BN=SIGMA, omega_BN_B=OMEGA)
    craft = Spacecraft("craft", Spacecraft.Params(inertia_B=inertia, mu=0.0), start)
    params = ReactionWheels.Params(axes_B=padded(np.eye(3)), inertia=padded([1e-4] * 3))
    wheels = ReactionWheels("wheels", params, ReactionWheels.State(omega=padded([200.0, -150.0, 300.0])))
    craft.out_state.connect(wheels.in_state)
    wheels.out_torque.connect(craft.in_torque, delayed=True)
    sim = Simulation([Task("truth", ms(100), [craft, wheels])])
    states = craft.out_state.record(every=s(1))
    sim.run_until(s(3600))
    rates = np.linalg.norm(states["omega_BN_B"], axis=1)
    energy = np.sum(states["omega_BN_B"] @ inertia * states["omega_BN_B"], axis=1)
    assert rates[-600:].max() < 1.2 * rates[:600].max()
    np.testing.assert_allclose(energy[-1], energy[0], rtol=0.1)


class Still(KernelModule):
    """A body that stands still, and a motor torque."""

    class Params(Record):
        """None."""

    out_state = Out(SCStatesMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_state: Row) -> None:
        """Write."""
        for i in range(3):
            out_state.r_BN_N[i] = out_state.v_BN_N[i] = out_state.sigma_BN[i] = 0.0
            out_state.omega_BN_B[i] = out_state.omegaDot_BN_B[i] = 0.0
        publish(out_state, t_ns)


def still(params: ReactionWheels.Params, torque: list[float], omega: list[float]) -> tuple[Simulation, ReactionWheels]:
    body, wheels = Still("body"), ReactionWheels("wheels", params, ReactionWheels.State(omega=padded(omega)))
    motor = Motors("motor")
    body.out_state.connect(wheels.in_state)
    motor.out_motor.connect(wheels.in_motor)
    motor.out_motor.write(RWTorqueMsg(torque=padded(torque)), 0)
    sim = Simulation([Task("motor", s(1000), [motor], phase=s(1000)), Task("truth", ms(100), [body, wheels])])
    return sim, wheels


def test_torque_limit_and_speed_limit() -> None:
    """A motor gives 0.01 N m at most; at 20 rad/s it only keeps the speed against friction, and can brake."""
    limits = {"max_torque": padded([0.01]), "max_speed": padded([20.0])}
    sim, wheels = still(wheel_params(1.0, 1, **limits), [0.5], [10.0])
    sim.run_until(s(1))
    state = wheels.out_wheels.latest()
    assert state is not None
    assert (state.motor_torque[0], state.saturated) == (0.01, 1)
    drag = COULOMB + VISCOUS * 10.0
    np.testing.assert_allclose(wheels.state.omega[0], 10.0 + (0.01 - drag) / WHEEL, rtol=1e-4)
    sim.run_until(s(200))
    state, torque = wheels.out_wheels.latest(), wheels.out_torque.latest()
    assert state is not None
    assert torque is not None
    assert wheels.state.omega[0] == pytest.approx(20.0, abs=1e-12)
    np.testing.assert_allclose(state.motor_torque[0], COULOMB + VISCOUS * 20.0, rtol=1e-12)
    np.testing.assert_allclose(torque.torque_B, 0.0, atol=1e-15)
    assert state.saturated == 1
    np.testing.assert_allclose(state.momentum_B, [20.0 * WHEEL, 0.0, 0.0], rtol=1e-12)


def test_a_wheel_at_rest_holds_against_a_small_torque() -> None:
    params = wheel_params(1.0, 1)
    sim, wheels = still(params, [0.9 * COULOMB], [0.0])
    sim.run_until(s(10))
    torque = wheels.out_torque.latest()
    assert torque is not None
    assert wheels.state.omega[0] == 0.0
    np.testing.assert_array_equal(torque.torque_B, 0.0)


def test_nan_command_stops_the_run_and_changes_nothing() -> None:
    sim, wheels = still(wheel_params(), [0.0], [5.0])
    sim.run_until(s(1))
    before = wheels.state.omega.copy()
    source = wheels.in_motor.source
    assert source is not None
    source.row["torque"][0, 0] = np.nan
    with pytest.raises(ModuleError, match=r"wheels.*in_motor.torque"):
        sim.run_until(s(2))
    np.testing.assert_array_equal(wheels.state.omega, before)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"axes_B": padded(2.0 * AXES)}, "axes_B: expected unit vectors"),
        ({"static": padded([1e-5] * 4)}, "static: expected at least coulomb"),
        ({"inertia": padded([-1.0])}, ">= 0"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    given = wheel_params()
    fields = {n: getattr(given, n) for n in ("axes_B", "inertia", "coulomb", "static")}
    with pytest.raises(ValueError, match=text):
        ReactionWheels.Params(**{**fields, **change})
