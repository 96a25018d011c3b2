"""Gyro against Basilisk's delta angles and the variances of random walks in continuous time."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw import Module, Out, Simulation, Task, s
from messages.base import F64
from messages.sensors import IMUSensorMsg
from messages.states import SCStatesMsg
from sim.sensors.gyro import Gyro
from tests.sim.sensors.sensor_rig import allan_deviation, series

Criterion = Callable[[str, float], None]
COUNT = 1000
SIGMA_V, SIGMA_U = 2e-4, 3e-5
TURN_P = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def state_of(sigma: Any, omega: Any = (0.0, 0.0, 0.0)) -> SCStatesMsg:
    still = np.zeros(3)
    return SCStatesMsg(
        r_BN_N=still, v_BN_N=still, sigma_BN=np.array(sigma), omega_BN_B=np.array(omega), omegaDot_BN_B=still
    )


class Truth(Module):
    """A body at rest."""

    out_state = Out(SCStatesMsg)

    def step(self, t_ns: int) -> None:
        self.out_state.write(state_of(np.zeros(3)), t_ns)


def angles(params: Gyro.Params, dt: float, steps: int) -> F64:
    """Integrals of the measured rate of many gyros at rest, (3 COUNT, steps) rad."""
    truth = Truth("truth")
    gyros = [Gyro(f"gyro_{k}", params) for k in range(COUNT)]
    for gyro in gyros:
        truth.out_state.connect(gyro.in_state)
    records = [g.out_imu.record() for g in gyros]
    Simulation([Task("truth", s(dt), [truth, *gyros])], seed=4).run_until(s(dt * steps))
    rates = np.concatenate([r["omega_PN_P"].T for r in records])
    assert rates.shape == (3 * COUNT, steps)
    return np.cumsum(rates, axis=1) * dt


def test_against_basilisk(criterion: Criterion) -> None:
    """Delta angles of Basilisk's IMU, with bias and scale factor, and a case turned by hand."""
    path = Path(__file__).parents[2] / "data" / "basilisk_sensors.json"
    ideal, wrong = json.loads(path.read_text())["imu"]
    worst = 0.0
    for case, dcm in ((ideal, np.eye(3)), (ideal, TURN_P), (wrong, np.eye(3))):
        gain = np.array(case.get("gyroScale", [1.0, 1.0, 1.0]))
        params = Gyro.Params(dcm_PB=dcm, arw=0.0, rrw=0.0, misalignment=np.diag(gain - 1.0))
        start = Gyro.State(bias_P=gain * np.array(case.get("senRotBias", [0.0, 0.0, 0.0])))
        truth, gyro = Truth("truth"), Gyro("gyro", params, start)
        truth.out_state.connect(gyro.in_state)
        steps: list[dict[str, Any]] = case["steps"]
        last = 0
        for k, step in enumerate(steps):
            truth.out_state.write(state_of(step["sc"]["sigma_BN"]), step["t"])
            gyro.step(step["t"])
            message = gyro.out_imu.latest()
            assert (message is None) == (k == 0)
            if message is not None:
                expected = dcm @ np.array(step["DRFramePlatform"]) / ((step["t"] - last) * 1e-9)
                worst = max(worst, float(np.max(np.abs(message.omega_PN_P - expected))))
            last = step["t"]
    criterion("GYRO-1", worst)


def test_angle_random_walk(criterion: Criterion) -> None:
    """The angle's variance is arw^2 T for every interval between samples."""
    worst = 0.0
    for dt, steps in [(1.0, 50), (12.5, 4)]:
        final = angles(Gyro.Params(arw=SIGMA_V, rrw=0.0), dt, steps)[:, -1]
        worst = max(worst, abs(float(np.mean(final**2)) / (SIGMA_V**2 * 50.0) - 1.0))
    criterion("GYRO-2", worst)


def test_rate_random_walk(criterion: Criterion) -> None:
    """The angle's variance is rrw^2 T^3 / 3, and its correlation with the angle at T/2 is exact too: 5 T^3 / 48."""
    worst = 0.0
    for dt, steps in [(1.0, 50), (12.5, 4)]:
        path = angles(Gyro.Params(arw=0.0, rrw=SIGMA_U), dt, steps)
        final, middle = path[:, -1], path[:, steps // 2 - 1]
        worst = max(worst, abs(float(np.mean(final**2)) / (SIGMA_U**2 * 50.0**3 / 3.0) - 1.0))
        worst = max(worst, abs(float(np.mean(final * middle)) / (SIGMA_U**2 * 50.0**3 * 5.0 / 48.0) - 1.0))
    criterion("GYRO-3", worst)


def test_repeated_state_gives_no_sample() -> None:
    truth, gyro = Truth("truth"), Gyro("gyro")
    truth.out_state.connect(gyro.in_state)
    gyro.step(0)
    truth.step(0)
    gyro.step(0)
    gyro.step(s(1))
    assert gyro.out_imu.latest() is None
    truth.step(s(2))
    gyro.step(s(2))
    message = gyro.out_imu.latest()
    assert isinstance(message, IMUSensorMsg)
    assert np.isnan(message.accel_P).all()


def test_bad_state_is_no_sample() -> None:
    """The next sample spans the whole interval."""
    truth, gyro = Truth("truth"), Gyro("gyro", Gyro.Params(arw=0.0, rrw=0.0))
    truth.out_state.connect(gyro.in_state)
    for t, angle in [(0, 0.0), (1, np.nan), (2, 0.3)]:
        truth.out_state.write(state_of([0.0, 0.0, 0.0]), s(t))
        truth.out_state.row["sigma_BN"][0, 2] = np.tan(angle / 4.0)
        gyro.step(s(t))
        assert (gyro.out_imu.latest() is None) == (t < 2)
    np.testing.assert_allclose(gyro.out_imu.row["omega_PN_P"][0], [0.0, 0.0, 0.15], rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"arw": -1.0}, ">= 0"),
        ({"rrw": np.inf}, "infinity"),
        ({"dcm_PB": np.diag([1.0, 1.0, -1.0])}, "mirror"),
        ({"dcm_PB": 1.1 * np.eye(3)}, "orthonormal"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Gyro.Params(**change)


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_allan_deviation(criterion: Criterion, dt: float) -> None:
    """sqrt(arw^2 / tau + rrw^2 tau / 3) from 1 s to 256 s."""
    sensors = [Gyro(f"gyro_{k}", Gyro.Params(arw=2e-4, rrw=2.2e-5)) for k in range(8)]
    y = series(sensors, "omega_PN_P", dt, round(40_000 / dt))
    worst = 0.0
    for tau in 2.0 ** np.arange(9):
        expected = np.sqrt(2e-4**2 / tau + 2.2e-5**2 * tau / 3.0)
        worst = max(worst, abs(allan_deviation(y, round(tau / dt)) / expected - 1.0))
    criterion("GYRO-4", worst)


def test_scale_bias_and_saturation() -> None:
    """Misalignment, then the bias, then the limit, against the matrix product."""
    wrong = np.array([[0.01, 0.002, -0.003], [0.004, -0.02, 0.001], [0.0, 0.005, 0.03]])
    bias, angle = np.array([0.01, -0.02, 0.03]), np.array([0.2, -0.3, 0.25])
    params = Gyro.Params(dcm_PB=TURN_P, misalignment=wrong, arw=0.0, rrw=0.0, max_rate=0.26)
    truth, gyro = Truth("truth"), Gyro("gyro", params, Gyro.State(bias_P=bias))
    truth.out_state.connect(gyro.in_state)
    for t, turned in [(0, 0.0), (1, 1.0)]:
        size = np.linalg.norm(angle)
        truth.out_state.write(state_of(np.tan(turned * size / 4.0) * angle / size), s(t))
        gyro.step(s(t))
    expected = (np.eye(3) + wrong) @ TURN_P @ angle + bias
    message = gyro.out_imu.latest()
    assert message is not None
    np.testing.assert_allclose(message.omega_PN_P, np.clip(expected, -0.26, 0.26), rtol=1e-14)


def test_counts_lose_no_angle() -> None:
    """With counts of 1e-3 rad, the sum of the angles stays within half a count of that of the same gyro without."""
    counted, exact = (
        series([Gyro("gyro", Gyro.Params(arw=1e-3, resolution=r))], "omega_PN_P", 0.1, 2000) for r in (1e-3, 0.0)
    )
    counts = counted * 0.1 / 1e-3
    assert np.max(np.abs(counts - np.round(counts))) < 1e-9
    assert np.max(np.abs(np.cumsum(counted - exact, axis=0) * 0.1)) < 0.5001e-3
