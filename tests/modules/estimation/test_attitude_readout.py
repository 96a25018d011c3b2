"""AttitudeReadout on motions with a known solution, late and lost measurements, and the theory of a fixed gain."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, s
from messages.base import F64
from messages.sensors import IMUSensorMsg, STAttMsg
from messages.states import NavAttMsg
from modules.estimation.attitude_readout import AttitudeReadout

Criterion = Callable[[str, float], None]
OMEGA_B = np.array([0.02, -0.05, 0.03])
START = Rotation.from_mrp([0.1, 0.6, -0.3])
DCM_SB = Rotation.from_euler("xyz", [20.0, -70.0, 110.0], degrees=True).as_matrix()
DCM_PB = Rotation.from_euler("xyz", [-35.0, 10.0, 65.0], degrees=True).as_matrix()


class Sensors(Module):
    """A star tracker and a gyro whose measurements a test writes."""

    out_star = Out(STAttMsg)
    out_imu = Out(IMUSensorMsg)

    def step(self, t_ns: int) -> None:
        """Write nothing."""


class Bench:
    """A read-out with its sensors, on a body that turns at a constant rate."""

    def __init__(self, **params: Any) -> None:
        self.sensors = Sensors("sensors")
        self.readout = AttitudeReadout("readout", AttitudeReadout.Params(dcm_SB=DCM_SB, dcm_PB=DCM_PB, **params))
        self.sensors.out_star.connect(self.readout.in_star)
        self.sensors.out_imu.connect(self.readout.in_imu)

    def truth(self, t: float) -> Rotation:
        return START * Rotation.from_rotvec(OMEGA_B * t)

    def gyro(self, t: float, rate: F64 = OMEGA_B) -> None:
        none = np.full(3, np.nan)
        self.sensors.out_imu.write(IMUSensorMsg(omega_PN_P=DCM_PB @ rate, accel_P=none), s(t))

    def star(self, t: float, exposed: float, valid: bool = True, error: F64 | None = None) -> None:
        case = self.truth(exposed) * Rotation.from_matrix(DCM_SB.T)
        if error is not None:
            case = case * Rotation.from_rotvec(error)
        beta = case.as_quat(scalar_first=True)
        self.sensors.out_star.write(STAttMsg(exposure_ns=s(exposed), valid=valid, beta_SN=beta), s(t))

    def step(self, t: float) -> NavAttMsg | None:
        before = self.readout.out_att.seq
        self.readout.step(s(t))
        return self.readout.out_att.latest() if self.readout.out_att.seq > before else None

    def error(self, t: float) -> float:
        message = self.step(t)
        assert message is not None
        np.testing.assert_allclose(message.omega_BN_B, OMEGA_B, rtol=0, atol=1e-16)
        return float((Rotation.from_mrp(message.sigma_BN.copy()).inv() * self.truth(t)).magnitude())


def test_perfect_sensors(criterion: Criterion) -> None:
    """Star tracker every second, gyro every 0.1 s, read-out at 20 Hz; then 100 s without the star tracker."""
    bench, worst = Bench(), 0.0
    for k in range(2400):
        t = k / 20
        if k % 2 == 0:
            bench.gyro(t)
        if k % 20 == 0 and t <= 20.0:
            bench.star(t, t)
        worst = max(worst, bench.error(t))
    criterion("READOUT-1", worst)


def test_late_measurements(criterion: Criterion) -> None:
    """Exposures 0.7 s old that arrive between gyro samples."""
    bench, worst = Bench(), 0.0
    for k in range(200):
        t = 1.0 + k * 0.1
        if k % 3 == 0:
            bench.gyro(t)
        if k % 5 == 1:
            bench.star(t, t - 0.7)
        if k >= 1:
            worst = max(worst, bench.error(t))
    criterion("READOUT-2", worst)


def test_fixed_gain(criterion: Criterion) -> None:
    """White errors of the star tracker pass with the variance k / (2 - k) of their own (exact for a perfect gyro)."""
    rng, gain, sigma, count = np.random.default_rng(5), 0.2, 1e-4, 12_000
    bench = Bench(gain=gain)
    truth = START * Rotation.from_rotvec(np.outer(np.arange(count) / 10, OMEGA_B))
    case = truth * Rotation.from_matrix(DCM_SB.T) * Rotation.from_rotvec(sigma * rng.normal(size=(count, 3)))
    seen = np.empty((count, 3))
    for k, beta in enumerate(case.as_quat(scalar_first=True)):
        bench.gyro(k / 10)
        bench.sensors.out_star.write(STAttMsg(exposure_ns=s(k / 10), valid=True, beta_SN=beta), s(k / 10))
        bench.readout.step(s(k / 10))
        seen[k] = bench.readout.out_att.row["sigma_BN"][0]
    errors = (Rotation.from_mrp(seen).inv() * truth).as_rotvec()[50:]
    criterion("READOUT-3", float(np.mean(errors**2)) / (sigma**2 * gain / (2.0 - gain)) - 1.0)


def test_nothing_before_both_sensors() -> None:
    bench = Bench()
    assert bench.step(0.0) is None
    bench.star(0.0, 0.0)
    assert bench.step(0.0) is None
    bench.gyro(0.1)
    assert bench.error(0.1) < 1e-15


@pytest.mark.parametrize("fault", ["invalid", "future", "old", "not unit"])
def test_refused_exposures(fault: str) -> None:
    """A measurement that is lost, from the future, too old or no attitude changes nothing."""
    bench = Bench()
    bench.gyro(0.0)
    bench.star(0.0, 0.0)
    assert bench.error(0.0) < 1e-15
    bench.gyro(0.5)
    wrong = np.full(3, 0.5)
    if fault == "future":
        bench.star(0.5, 0.6, error=wrong)
    elif fault == "old":
        assert bench.error(0.5) < 1.5e-15
        bench.gyro(1.2)
        bench.star(1.2, 0.1, error=wrong)
    else:
        bench.star(0.5, 0.5, valid=fault != "invalid", error=wrong)
        if fault == "not unit":
            bench.sensors.out_star.row["beta_SN"] *= 1.01
    assert bench.error(1.2 if fault == "old" else 0.5) < 1.5e-15


def test_gyro_gap_and_bad_gyro_lose_the_attitude() -> None:
    for bad in (True, False):
        bench = Bench()
        bench.gyro(0.0)
        bench.star(0.0, 0.0)
        assert bench.error(0.0) < 1e-15
        assert bench.error(0.9) < 1e-15  # carried forward by the last rate
        assert bench.step(1.1) is None  # the last rate is too old
        bench.gyro(1.5)
        if bad:
            bench.sensors.out_imu.row["omega_PN_P"] = np.nan
        assert bench.step(1.5) is None
        bench.gyro(1.6)
        bench.star(1.6, 1.6)
        assert bench.error(1.6) < 1e-15
