"""Basilisk's side of each comparison."""

# pyright: basic, reportMissingImports=false
# Basilisk has no types, and is installed by ``make bench`` only

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.case import Case
from benchmarks.timing import timed

PERIOD_NS = 100_000_000


def new_simulation(period_ns: int = PERIOD_NS) -> Any:
    """A Basilisk simulation with one process "p" and one task "t"."""
    from Basilisk.utilities import SimulationBaseClass

    sim = SimulationBaseClass.SimBaseClass()
    sim.CreateNewProcess("p").addTask(sim.CreateNewTask("t", period_ns))
    return sim


def _module(kind: str, previous: Any) -> Any:
    """One module; a Python relay reads the message ``previous``."""
    from Basilisk.architecture import messaging, sysModel

    if kind == "extForceTorque":
        from Basilisk.simulation import extForceTorque

        return extForceTorque.ExtForceTorque()
    if kind == "rateMsgConverter":
        from Basilisk.fswAlgorithms import rateMsgConverter

        module = rateMsgConverter.rateMsgConverter()
        module.imuRateInMsg.subscribeTo(previous)
        return module

    class Nothing(sysModel.SysModel):
        def UpdateState(self, CurrentSimNanos: int) -> None:
            return

    class Relay(sysModel.SysModel):
        """The pattern that Basilisk's manual gives for Python modules."""

        def __init__(self) -> None:
            super().__init__()
            self.dataInMsg = messaging.CModuleTemplateMsgReader()
            self.dataOutMsg = messaging.CModuleTemplateMsg()

        def UpdateState(self, CurrentSimNanos: int) -> None:
            read: Any = self.dataInMsg
            vector = read().dataVector
            payload = messaging.CModuleTemplateMsgPayload()
            payload.dataVector = [vector[0], vector[1], vector[2]]
            self.dataOutMsg.write(payload, CurrentSimNanos, self.moduleID)

    if kind == "python":
        return Nothing()
    relay = Relay()
    relay.dataInMsg.subscribeTo(previous)
    return relay


def trivial(kind: str, count: int, ticks: int) -> Callable[[], float]:
    """A case: nanoseconds for each tick of ``count`` modules of a kind."""
    from Basilisk.architecture import messaging

    sim = new_simulation()
    if kind == "python_relay":
        previous: Any = messaging.CModuleTemplateMsg().write(messaging.CModuleTemplateMsgPayload())
    else:
        previous = messaging.IMUSensorBodyMsg().write(messaging.IMUSensorBodyMsgPayload())
    keep: list[Any] = [previous]
    for i in range(count):
        module = _module(kind, previous)
        module.ModelTag = f"m{i}"
        sim.AddModelToTask("t", module)
        if kind == "python_relay":
            previous = module.dataOutMsg
        keep.append(module)
    sim.InitializeSimulation()
    end = 10 * PERIOD_NS
    sim.ConfigureStopTime(end)
    sim.ExecuteSimulation()

    def run(more: int) -> None:
        nonlocal end
        assert keep
        end += more * PERIOD_NS
        sim.ConfigureStopTime(end)
        sim.ExecuteSimulation()

    return lambda: timed(run, ticks)


class ClosedLoop:
    """The graph of `benchmarks.closed_loop` in Basilisk: same order, same values, same delay of the torque.

    Args:
        case: initial state and parameters. noise: of the sensors. record: the outputs at each tick.
    """

    def __init__(self, case: Case, *, noise: bool, record: bool) -> None:
        from Basilisk.architecture import messaging
        from Basilisk.fswAlgorithms import attTrackingError, hillPoint, mrpFeedback
        from Basilisk.simulation import extForceTorque, imuSensor, simpleNav, spacecraft, starTracker

        self.sim = new_simulation(case.period_ns)
        self.end = 0
        self.period_ns = case.period_ns
        self._names = 0
        self.torque = self._add(extForceTorque.ExtForceTorque())
        self.spacecraft = craft = self._add(spacecraft.Spacecraft())
        craft.addDynamicEffector(self.torque)
        craft.hub.mHub = case.mass
        craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        craft.hub.IHubPntBc_B = case.inertia_B.tolist()
        craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = case.r_BN_N, case.v_BN_N
        craft.hub.sigma_BNInit, craft.hub.omega_BN_BInit = case.sigma_BN, case.omega_BN_B
        self._bodies = earth(craft, case)
        nav = self._add(simpleNav.SimpleNav())
        imu = self._add(imuSensor.ImuSensor())
        tracker = self._add(starTracker.StarTracker())
        for sensor in (nav, imu, tracker):
            sensor.scStateInMsg.subscribeTo(craft.scStateOutMsg)
            if noise:
                add_noise(sensor)
        hill = self._add(hillPoint.hillPoint())
        hill.transNavInMsg.subscribeTo(nav.transOutMsg)
        self.error = self._add(attTrackingError.attTrackingError())
        self.error.attNavInMsg.subscribeTo(nav.attOutMsg)
        self.error.attRefInMsg.subscribeTo(hill.attRefOutMsg)
        control = self._add(mrpFeedback.mrpFeedback())
        control.K, control.P, control.Ki = case.gain_K, case.gain_P, -1.0
        control.guidInMsg.subscribeTo(self.error.attGuidOutMsg)
        payload = messaging.VehicleConfigMsgPayload(ISCPntB_B=case.inertia_B.ravel().tolist())
        vehicle = messaging.VehicleConfigMsg().write(payload)
        control.vehConfigInMsg.subscribeTo(vehicle)
        self.torque.cmdTorqueInMsg.subscribeTo(control.cmdTorqueOutMsg)
        self._keep = [nav, imu, tracker, hill, control, vehicle]
        if record:
            messages = [craft.scStateOutMsg, nav.transOutMsg, nav.attOutMsg, imu.sensorOutMsg, tracker.sensorOutMsg]
            messages += [hill.attRefOutMsg, self.error.attGuidOutMsg, control.cmdTorqueOutMsg]
            self._keep += [self._add(message.recorder()) for message in messages]
        self.sim.InitializeSimulation()

    def _add(self, module: Any) -> Any:
        self._names += 1
        module.ModelTag = f"m{self._names}"
        self.sim.AddModelToTask("t", module)
        return module

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods; the instant 0 comes with the first."""
        self.end += ticks * self.period_ns
        self.sim.ConfigureStopTime(self.end)
        self.sim.ExecuteSimulation()

    def final(self) -> dict[str, NDArray[np.float64]]:
        """Position, velocity (N, m, m/s), attitude and tracking error (MRP) of the newest tick."""
        state, error = self.spacecraft.scStateOutMsg.read(), self.error.attGuidOutMsg.read()
        values = {"r_BN_N": state.r_BN_N, "v_BN_N": state.v_BN_N}
        values |= {"sigma_BN": state.sigma_BN, "sigma_BR": error.sigma_BR}
        return {name: np.array(value) for name, value in values.items()}


def earth(craft: Any, case: Case) -> Any:
    """Attach a planet that does not turn, with J2 or the harmonics of the case; Basilisk takes them normalised."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import sphericalHarmonicsGravityModel
    from Basilisk.utilities import simIncludeGravBody

    factory = simIncludeGravBody.gravBodyFactory()
    body = factory.createEarth()
    body.isCentralBody = True
    body.mu = case.mu
    model = sphericalHarmonicsGravityModel.SphericalHarmonicsGravityModel()
    model.radEquator, model.muBody, model.maxDeg = case.radius, case.mu, max(case.degree, 2)
    model.cBar = [[1.0], [0.0, 0.0], [-case.j2 / math.sqrt(5.0), 0.0, 0.0]]
    model.sBar = [[0.0], [0.0, 0.0], [0.0, 0.0, 0.0]]
    if case.C is not None and case.S is not None:
        model.cBar = [case.C[n, : n + 1].tolist() for n in range(case.degree + 1)]
        model.sBar = [case.S[n, : n + 1].tolist() for n in range(case.degree + 1)]
    body.gravityModel = model
    factory.addBodiesTo(craft)
    still = messaging.SpicePlanetStateMsgPayload(J20002Pfix=np.eye(3).tolist())
    message = messaging.SpicePlanetStateMsg().write(still)
    if case.degree:  # Basilisk warns if it is not told how such a field is turned
        body.planetBodyInMsg.subscribeTo(message)
    return factory, message


def add_noise(module: Any) -> None:
    """Switch the noise on if the module is a sensor; its size does not matter here."""
    kind = type(module).__name__
    if kind == "ImuSensor":
        module.PMatrixGyro, module.PMatrixAccel = np.diag([1e-6] * 3).tolist(), np.diag([1e-5] * 3).tolist()
        module.setErrorBoundsGyro([1e-4] * 3)
        module.setErrorBoundsAccel([1e-3] * 3)
    elif kind == "Magnetometer":
        module.senNoiseStd = [[1e-7]] * 3
    elif kind == "CoarseSunSensor":
        module.senNoiseStd = 0.02
    elif kind in {"SimpleNav", "StarTracker"}:
        size = {"SimpleNav": 18, "StarTracker": 3}[kind]
        module.PMatrix, module.walkBounds = np.diag([1e-6] * size).tolist(), [1e-4] * size
