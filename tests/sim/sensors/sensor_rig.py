"""A source of everything that sensors read, and an Allan deviation that shares nothing with the noise models."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np

from fsw import KernelModule, Mat3, Module, Out, Record, Row, Simulation, Task, Vec3, eye, publish, s, zeros
from messages.base import F64
from messages.environment import EclipseMsg, EphemerisMsg, MagneticFieldMsg, PlanetOrientationMsg
from messages.sensors import SpecificForceMsg
from messages.states import SCStatesMsg

Criterion = Callable[[str, float], None]
AU = 1.495978707e11
AVERAGES = [2**k for k in range(9)]
"""Numbers of samples in an average for Allan deviations: more than two decades."""


class Rig(KernelModule):
    """Publishes constants at each step; the velocity gained grows evenly."""

    class Params(Record):
        """What is published."""

        r_BN_N: Annotated[Vec3, "m", "position"] = np.array([7e6, 0.0, 0.0])
        v_BN_N: Annotated[Vec3, "m/s", "velocity"] = np.array([0.0, 7500.0, 0.0])
        sigma_BN: Annotated[Vec3, "-", "attitude"] = zeros(3)
        omega_BN_B: Annotated[Vec3, "rad/s", "rate"] = zeros(3)
        accel_BN_N: Annotated[Vec3, "m/s^2", "non-gravitational acceleration, N components"] = zeros(3)
        sun: Annotated[Vec3, "m", "position of the Sun"] = np.array([AU, 0.0, 0.0])
        v_sun: Annotated[Vec3, "m/s", "velocity of the Sun"] = zeros(3)
        moon: Annotated[Vec3, "m", "position of the Moon"] = np.array([0.0, 3.8e8, 0.0])
        dcm_EN: Annotated[Mat3, "-", "orientation of the Earth"] = eye(3)
        omega_EN_N: Annotated[Vec3, "rad/s", "rotation of the Earth"] = zeros(3)
        illumination: Annotated[float, "-", "visible part of the Sun"] = 1.0
        B_N: Annotated[Vec3, "T", "magnetic field"] = np.array([2e-5, -1e-5, 4e-5])

    out_state = Out(SCStatesMsg)
    out_force = Out(SpecificForceMsg)
    out_sun = Out(EphemerisMsg)
    out_moon = Out(EphemerisMsg)
    out_orientation = Out(PlanetOrientationMsg)
    out_eclipse = Out(EclipseMsg)
    out_field = Out(MagneticFieldMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        out_state: Row,
        out_force: Row,
        out_sun: Row,
        out_moon: Row,
        out_orientation: Row,
        out_eclipse: Row,
        out_field: Row,
    ) -> None:
        """Write all outputs."""
        for i in range(3):
            out_state.r_BN_N[i], out_state.v_BN_N[i] = params.r_BN_N[i], params.v_BN_N[i]
            out_state.sigma_BN[i], out_state.omega_BN_B[i] = params.sigma_BN[i], params.omega_BN_B[i]
            out_state.omegaDot_BN_B[i] = 0.0
            out_force.accel_BN_B[i], out_force.dv_BN_N[i] = 0.0, params.accel_BN_N[i] * t_ns * 1e-9
            out_sun.r_PN_N[i], out_sun.v_PN_N[i] = params.sun[i], params.v_sun[i]
            out_moon.r_PN_N[i], out_moon.v_PN_N[i] = params.moon[i], 0.0
            out_orientation.omega_EN_N[i] = params.omega_EN_N[i]
            out_field.B_N[i] = params.B_N[i]
            for j in range(3):
                out_orientation.dcm_EN[i, j] = params.dcm_EN[i, j]
        out_sun.body_id, out_sun.mu, out_sun.radius = 10, 1.3e20, 7e8
        out_moon.body_id, out_moon.mu, out_moon.radius = 301, 4.9e12, 1.7e6
        out_eclipse.illumination = params.illumination
        publish(out_state, t_ns)
        publish(out_force, t_ns)
        publish(out_sun, t_ns)
        publish(out_moon, t_ns)
        publish(out_orientation, t_ns)
        publish(out_eclipse, t_ns)
        publish(out_field, t_ns)


def wired(sensors: list[Any], leave: tuple[str, ...] = (), **truth: Any) -> Rig:
    """A rig with the given constants that feeds every input of the sensors by its name, except those in ``leave``."""
    rig = Rig("rig", Rig.Params(**truth))
    for sensor in sensors:
        for port in sensor.inputs:
            if port.name not in leave:
                vars(rig)[port.name.replace("in_", "out_")].connect(port)
    return rig


def measure(sensor: Module, leave: tuple[str, ...] = (), at: tuple[int, ...] = (0,), **truth: Any) -> Any:
    """The newest message of the first output of a sensor that was run at the times ``at`` (ns)."""
    rig = wired([sensor], leave, **truth)
    for t in at:
        rig.step(t)
        sensor.step(t)
    return sensor.outputs[0].latest()


def series(sensors: list[Any], field: str, dt: float, steps: int, seed: int = 1, **truth: Any) -> F64:
    """Samples of a field of the first output of sensors of one kind, all side by side, (steps, columns)."""
    rig = wired(sensors, **truth)
    records = [x.outputs[0].record() for x in sensors]
    Simulation([Task("truth", s(dt), [rig, *sensors])], seed=seed).run_until(s(dt * steps))
    return np.concatenate([r[field].reshape(len(r), -1) for r in records], axis=1)


def allan_deviation(y: F64, m: int) -> float:
    """Overlapping Allan deviation of columns of equally spaced numbers, for averages over ``m`` of them."""
    total = np.vstack([np.zeros(y.shape[1]), np.cumsum(y - y.mean(axis=0), axis=0)])
    mean = (total[m:] - total[:-m]) / m
    return float(np.sqrt(0.5 * np.mean((mean[m:] - mean[:-m]) ** 2)))


def allan_of(covariance: Callable[[F64, F64], F64], m: int) -> float:
    """The expected Allan deviation of a process, from the covariance of its samples i and j."""
    i: F64 = np.arange(2.0 * m)
    weight = np.repeat([-1.0, 1.0], m) / m
    return float(np.sqrt(0.5 * weight @ covariance(i[:, None], i[None, :]) @ weight))
