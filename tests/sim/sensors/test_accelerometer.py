"""Accelerometer against Basilisk's velocity increments, and its noise against the theory of random walks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, s
from messages.sensors import SpecificForceMsg
from messages.states import SCStatesMsg
from sim.sensors.accelerometer import Accelerometer
from tests.sim.sensors.sensor_rig import Criterion, allan_deviation, measure, series

VRW, BRW = 1e-3, 1.1e-4
"""Both contribute the same at 16 s."""


class Truth(Module):
    """States from a list."""

    out_state = Out(SCStatesMsg)
    out_force = Out(SpecificForceMsg)

    def feed(self, sc: dict[str, Any], t_ns: int) -> None:
        self.out_state.write(
            SCStatesMsg(
                r_BN_N=np.zeros(3),
                v_BN_N=np.zeros(3),
                sigma_BN=np.array(sc["sigma_BN"]),
                omega_BN_B=np.array(sc["omega_BN_B"]),
                omegaDot_BN_B=np.zeros(3),
            ),
            t_ns,
        )
        dv_BN_N = Rotation.from_mrp(sc["sigma_BN"]).apply(sc["TotalAccumDV_BN_B"])
        self.out_force.write(SpecificForceMsg(accel_BN_B=np.zeros(3), dv_BN_N=dv_BN_N), t_ns)


def test_against_basilisk(criterion: Criterion) -> None:
    """Velocity gained between samples, at B and away from it, with bias and scale factor error."""
    path = Path(__file__).parents[2] / "data" / "basilisk_sensors.json"
    worst = 0.0
    for case in json.loads(path.read_text())["imu"]:
        gain = np.array(case.get("accelScale", [1.0, 1.0, 1.0]))
        params = Accelerometer.Params(
            r_PB_B=np.array(case.get("sensorPos_B", [0.0, 0.0, 0.0])),
            misalignment=np.diag(gain - 1.0),
            vrw=0.0,
            brw=0.0,
        )
        start = Accelerometer.State(bias_P=gain * np.array(case.get("senTransBias", [0.0, 0.0, 0.0])))
        truth, sensor = Truth("truth"), Accelerometer("accelerometer", params, start)
        truth.out_state.connect(sensor.in_state)
        truth.out_force.connect(sensor.in_force)
        last = 0
        for k, step in enumerate(case["steps"]):
            truth.feed(step["sc"], step["t"])
            sensor.step(step["t"])
            message = sensor.out_accel.latest()
            assert (message is None) == (k == 0)
            if message is not None:
                mine = message.accel_P * (step["t"] - last) * 1e-9
                worst = max(worst, float(np.max(np.abs(mine - step["DVFramePlatform"]))))
            last = step["t"]
    criterion("ACC-1", worst)


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_allan_deviation(criterion: Criterion, dt: float) -> None:
    """sqrt(vrw^2 / tau + brw^2 tau / 3) from 1 s to 256 s."""
    sensors = [Accelerometer(f"a{k}", Accelerometer.Params(vrw=VRW, brw=BRW)) for k in range(8)]
    y = series(sensors, "accel_P", dt, round(40_000 / dt))
    worst = 0.0
    for tau in 2.0 ** np.arange(9):
        expected = np.sqrt(VRW**2 / tau + BRW**2 * tau / 3.0)
        worst = max(worst, abs(allan_deviation(y, round(tau / dt)) / expected - 1.0))
    criterion("ACC-2", worst)


def test_counts_lose_nothing() -> None:
    """With counts of 0.25 m/s the velocity is right to half a count after any time."""
    y = series(
        [Accelerometer("a", Accelerometer.Params(vrw=0.0, brw=0.0, resolution=0.25))],
        "accel_P",
        0.1,
        1000,
        accel_BN_N=np.array([0.37, -1.1, 0.002]),
    )
    counts = y * 0.1 / 0.25
    assert np.max(np.abs(counts - np.round(counts))) < 1e-9
    gained = np.cumsum(y * 0.1, axis=0)
    true = np.arange(1, len(y) + 1)[:, None] * 0.1 * np.array([0.37, -1.1, 0.002])
    assert np.max(np.abs(gained - true)) < 0.1251


def test_saturation_and_misalignment() -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix()
    wrong = np.array([[0.01, 0.002, -0.003], [0.004, -0.02, 0.001], [0.0, 0.005, 0.03]])
    force = np.array([3.0, -8.0, 1.0])
    params = Accelerometer.Params(dcm_PB=turn, misalignment=wrong, vrw=0.0, brw=0.0, max_accel=5.0)
    message = measure(Accelerometer("a", params), at=(0, s(2)), accel_BN_N=force)
    expected = (np.eye(3) + wrong) @ turn @ force
    assert np.max(np.abs(expected)) > 5.0
    np.testing.assert_allclose(message.accel_P, np.clip(expected, -5.0, 5.0), rtol=1e-14)


def test_nothing_without_force() -> None:
    assert measure(Accelerometer("a"), leave=("in_force",), at=(0, s(1))) is None
