"""StarTracker against Basilisk and scipy without noise, and against its stated covariance with noise."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from messages.base import F64
from messages.states import SCStatesMsg
from sim.sensors.star_tracker import StarTracker
from tests.sim.sensors.sensor_rig import AVERAGES, allan_deviation, series

Criterion = Callable[[str, float], None]
MOUNTING = Rotation.from_euler("xyz", [30.0, -50.0, 110.0], degrees=True).as_matrix()
SIGMA = np.array([0.1, -0.4, 0.5])


class Truth(Module):
    """A body with a constant attitude."""

    out_state = Out(SCStatesMsg)
    sigma, omega = SIGMA, np.zeros(3)

    def step(self, t_ns: int) -> None:
        still = np.zeros(3)
        state = SCStatesMsg(r_BN_N=still, v_BN_N=still, sigma_BN=self.sigma, omega_BN_B=self.omega, omegaDot_BN_B=still)
        self.out_state.write(state, t_ns)


def perfect(dcm_SB: F64) -> tuple[Truth, StarTracker]:
    truth = Truth("truth")
    star = StarTracker("star", StarTracker.Params(dcm_SB=dcm_SB, sigma_cross=0.0, sigma_roll=0.0))
    truth.out_state.connect(star.in_state)
    return truth, star


def test_against_basilisk(criterion: Criterion) -> None:
    cases: list[dict[str, Any]] = json.loads(
        (Path(__file__).parents[2] / "data" / "basilisk_star_tracker.json").read_text()
    )["cases"]
    worst = 0.0
    for case in cases:
        truth, star = perfect(np.array(case["dcm_CB"]).reshape(3, 3))
        truth.sigma = np.array(case["sigma_BN"])
        truth.step(case["stateTimeWritten"])
        star.step(case["callTime"])
        message = star.out_attitude.latest()
        assert message is not None
        assert message.valid
        assert message.exposure_ns == case["timeTag"]
        worst = max(worst, float(np.max(np.abs(message.beta_SN - case["qInrtl2Case"]))))
    criterion("STAR-1", worst)


def test_noise(criterion: Criterion) -> None:
    """Errors in the case's axes, taken out with scipy: covariance against the parameters, and mean."""
    truth = Truth("truth")
    params = StarTracker.Params(dcm_SB=MOUNTING, sigma_cross=2e-5, sigma_roll=1.5e-4)
    star = StarTracker("star", params)
    truth.out_state.connect(star.in_state)
    record = star.out_attitude.record()
    Simulation([Task("truth", s(1), [truth, star])], seed=3).run_until(s(9999))
    true_SN = Rotation.from_mrp(SIGMA) * Rotation.from_matrix(MOUNTING.T)
    error = (true_SN.inv() * Rotation.from_quat(record["beta_SN"], scalar_first=True)).as_rotvec()
    unit = error / np.array([2e-5, 2e-5, 1.5e-4])
    assert abs(unit.mean(axis=0)).max() < 4 / np.sqrt(len(unit))
    criterion("STAR-2", float(np.max(np.abs(unit.T @ unit / len(unit) - np.eye(3)))))


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_allan_deviation(criterion: Criterion, dt: float) -> None:
    """White about each axis of the case, whatever the interval; 24 trackers side by side."""
    params = StarTracker.Params(sigma_cross=2e-5, sigma_roll=1.5e-4)
    y = series([StarTracker(f"star_{k}", params) for k in range(24)], "beta_SN", dt, 40_000)
    turn = 2.0 * y.reshape(len(y), 24, 4)[:, :, 1:]  # small angles about an attitude of zero
    worst = 0.0
    for axis, sigma in enumerate((2e-5, 2e-5, 1.5e-4)):
        ratios = [allan_deviation(turn[:, :, axis], m) * np.sqrt(m) / sigma for m in AVERAGES]
        worst = max(worst, *(abs(r - 1.0) for r in ratios))
    criterion("STAR-3", worst)


def test_turning_too_fast() -> None:
    truth, star = perfect(np.eye(3))
    truth.omega = np.array([0.04, 0.04, 0.0])
    star.step(0)
    assert star.out_attitude.latest() is None
    truth.step(0)
    star.step(0)
    message = star.out_attitude.latest()
    assert message is not None
    assert not message.valid
    assert np.isnan(message.beta_SN).all()


def test_lost_measurements_leave_later_noise_alone() -> None:
    def run(lose: bool) -> F64:
        truth, star = Truth("truth"), StarTracker("star")
        truth.out_state.connect(star.in_state)
        record = star.out_attitude.record()
        sim = Simulation([Task("truth", s(1), [truth, star])], seed=3)
        truth.omega = np.full(3, 1.0 if lose else 0.0)
        sim.run_until(s(3))
        truth.omega = np.zeros(3)
        sim.run_until(s(6))
        return record["beta_SN"]

    assert np.array_equal(run(lose=True)[4:], run(lose=False)[4:])
    assert np.isnan(run(lose=True)[:4]).all()


def test_misalignment_and_steps() -> None:
    """The case turned by a rotation vector in S, and Euler parameters in steps of 2^-20, unit length again."""
    turn = np.array([0.01, -0.02, 0.05])
    star = StarTracker(
        "star",
        StarTracker.Params(dcm_SB=MOUNTING, misalignment_S=turn, sigma_cross=0.0, sigma_roll=0.0, resolution=2.0**-20),
    )
    truth = Truth("truth")
    truth.out_state.connect(star.in_state)
    truth.step(0)
    star.step(0)
    message = star.out_attitude.latest()
    assert message is not None
    true_SN = Rotation.from_mrp(SIGMA) * Rotation.from_matrix(MOUNTING.T) * Rotation.from_rotvec(turn)
    expected = true_SN.as_quat(scalar_first=True, canonical=True)
    assert 0 < np.max(np.abs(message.beta_SN - expected)) < 2.0**-20
    assert abs(np.linalg.norm(message.beta_SN) - 1.0) < 1e-15
