"""The small closed loop: orbit with J2, rigid body, three sensors with noise, guidance and control, on both sides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.case import Case
from benchmarks.timing import Line, figure, interleaved, timed
from fsw import Simulation, Task, ms
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH
from modules.control.mrp_feedback import MrpFeedback
from modules.guidance.att_tracking_error import AttTrackingError
from modules.guidance.hill_point import HillPoint
from sim.dynamics.spacecraft import Spacecraft
from sim.scenarios import hill_pointing
from sim.sensors.gyro import Gyro
from sim.sensors.simple_nav import SimpleNav
from sim.sensors.star_tracker import StarTracker

SPEED_BAR = 1.0 / 8.0
RECORDING_BAR = 0.15
AGREE_TICKS = 6000


class Side(Protocol):
    """What can be measured and compared, whichever side it is."""

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods."""
        ...

    def final(self) -> dict[str, NDArray[np.float64]]:
        """Position, velocity, attitude and tracking error of the newest tick."""
        ...


def same_case() -> Case:
    """The case of the scenario `sim.scenarios.hill_pointing`."""
    state = hill_pointing.build().spacecraft.state
    return Case(
        r_BN_N=np.array(state.r_BN_N),
        v_BN_N=np.array(state.v_BN_N),
        sigma_BN=np.array(state.sigma_BN),
        omega_BN_B=np.array(state.omega_BN_B),
        inertia_B=hill_pointing.INERTIA_B,
        mu=MU_EARTH,
        radius=RADIUS_EARTH,
        j2=J2_EARTH,
    )


class Ours:
    """The graph with the modules of this repository, one task, in the same order as in Basilisk.

    Args:
        case: initial state and parameters. noise: of the sensors. record: the outputs at each tick.
    """

    def __init__(self, case: Case, *, noise: bool, record: bool) -> None:
        params = Spacecraft.Params(inertia_B=case.inertia_B, mass=case.mass, mu=case.mu, radius=case.radius, j2=case.j2)
        motion = {n: getattr(case, n) for n in ("r_BN_N", "v_BN_N", "sigma_BN", "omega_BN_B")}
        self.craft = craft = Spacecraft("spacecraft", params, Spacecraft.State(**motion))
        nav, gyro, tracker = SimpleNav("nav"), Gyro("gyro"), StarTracker("star_tracker")
        if noise:
            nav = SimpleNav("nav", SimpleNav.Params(sigma_r=1e-3, sigma_v=1e-3, sigma_att=1e-3, sigma_rate=1e-3))
        else:
            gyro = Gyro("gyro", Gyro.Params(arw=0.0, rrw=0.0))
            tracker = StarTracker("star_tracker", StarTracker.Params(sigma_cross=0.0, sigma_roll=0.0))
        hill, self.error = HillPoint("hill_point"), AttTrackingError("tracking_error")
        gains = MrpFeedback.Params(inertia_B=case.inertia_B, K=case.gain_K, P=case.gain_P)
        control = MrpFeedback("feedback", gains)
        for port in (nav.in_state, gyro.in_state, tracker.in_state):
            craft.out_state.connect(port)
        nav.out_trans.connect(hill.in_trans)
        nav.out_att.connect(self.error.in_att)
        hill.out_ref.connect(self.error.in_ref)
        self.error.out_guid.connect(control.in_guid)
        control.out_torque.connect(craft.in_torque, delayed=True)
        self.period_ns = case.period_ns
        modules = [craft, nav, gyro, tracker, hill, self.error, control]
        self.sim = Simulation([Task("t", period=case.period_ns, modules=modules)], seed=1)
        if record:
            recorded: list[Any] = [craft.out_state, nav.out_trans, nav.out_att, gyro.out_imu, tracker.out_attitude]
            recorded += [hill.out_ref, self.error.out_guid, control.out_torque]
            self.recordings = [port.record() for port in recorded]

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods; the instant 0 comes with the first."""
        self.sim.run_for(ticks * self.period_ns)

    def final(self) -> dict[str, NDArray[np.float64]]:
        """Position, velocity (N, m, m/s), attitude and tracking error (MRP) of the newest tick."""
        state, error = self.craft.out_state.latest(), self.error.out_guid.latest()
        assert state is not None
        assert error is not None
        values = {"r_BN_N": state.r_BN_N, "v_BN_N": state.v_BN_N, "sigma_BN": state.sigma_BN}
        return values | {"sigma_BR": error.sigma_BR}


class Scenario:
    """The scenario itself, whose attitude comes from star tracker and gyro; it has no counterpart in Basilisk."""

    def __init__(self) -> None:
        self.loop = hill_pointing.build()

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods."""
        self.loop.sim.run_for(ticks * ms(100))


def agreement(ticks: int = AGREE_TICKS, case: Case | None = None) -> dict[str, float]:
    """Greatest difference of both sides without noise after ``ticks`` periods, by quantity.

    Positions in m, velocities in m/s, attitudes as MRP components. Also "pointing_error", the angle of ours, rad.
    """
    from benchmarks.basilisk import ClosedLoop

    case = case or same_case()
    sides: list[Side] = [Ours(case, noise=False, record=False), ClosedLoop(case, noise=False, record=False)]
    for side in sides:
        side.run(ticks)
    own, other = (side.final() for side in sides)
    found = {name: float(np.max(np.abs(own[name] - other[name]))) for name in own}
    return found | {"pointing_error": float(4.0 * np.arctan(np.linalg.norm(own["sigma_BR"])))}


def measure(repeats: int = 7, scale: float = 1.0, *, basilisk: bool = True) -> list[Line]:
    """Time a tick, plain and with every output recorded.

    Args:
        repeats: how often. scale: of the number of ticks, below 1 for a trial. basilisk: measure that side too.
    """
    case = same_case()
    fast, slow = max(int(50_000 * scale), 10), max(int(10_000 * scale), 10)

    def fresh(make: Callable[[], Side], ticks: int) -> Callable[[], float]:
        """A new graph each time; what it records goes to memory that the system has yet to hand out."""

        def run() -> float:
            side = make()
            side.run(10)
            return timed(side.run, ticks)

        return run

    def again(side: Ours, ticks: int) -> Callable[[], float]:
        """The same graph, reset each time; what it records goes to memory that it has used before."""

        def run() -> float:
            side.sim.reset()
            side.run(10)
            return timed(side.run, ticks)

        return run

    cases: dict[str, Callable[[], float]] = {
        "plain": again(Ours(case, noise=True, record=False), fast),
        "recorded": again(Ours(case, noise=True, record=True), fast),
        "recorded fresh": fresh(lambda: Ours(case, noise=True, record=True), fast),
        "scenario": lambda: timed(Scenario().run, fast),
    }
    if basilisk:
        from benchmarks.basilisk import ClosedLoop

        cases["their plain"] = fresh(lambda: ClosedLoop(case, noise=True, record=False), slow)
        cases["their recorded fresh"] = fresh(lambda: ClosedLoop(case, noise=True, record=True), slow)
    own = {name: figure(values) for name, values in interleaved(cases, repeats).items()}
    plain, theirs, recorded = own["plain"], own.get("their plain"), own["recorded"]
    speed = plain.least / theirs.least if theirs else None
    cost = recorded.least / plain.least - 1.0
    return [
        Line("closed loop, one tick", "ns", plain, theirs, "at least 8 times faster", speed, SPEED_BAR),
        Line("the same, 8 outputs recorded each tick", "ns", recorded, None, "costs below 15 %", cost, RECORDING_BAR),
        Line("the same, into memory new to the process", "ns", own["recorded fresh"], own.get("their recorded fresh")),
        Line("scenario hill_pointing, one tick", "ns", own["scenario"], None),
    ]
