"""Faults of every sensor: what is published, and that they leave what comes after them alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fsw import Recording, Simulation, Task, s
from sim.sensors import faults
from sim.sensors.accelerometer import Accelerometer
from sim.sensors.css_array import CssArray
from sim.sensors.gps import Gps
from sim.sensors.gyro import Gyro
from sim.sensors.magnetometer import Magnetometer
from sim.sensors.star_tracker import StarTracker
from sim.sensors.star_vectors import StarVectors, catalogue
from tests.sim.sensors.sensor_rig import wired

ONE_STAR = catalogue(np.array([[0.1, 0.0, 1.0]]), np.array([1.0]))
SENSORS: list[tuple[Any, str, dict[str, Any]]] = [
    (Accelerometer, "accel_P", {}),
    (CssArray, "signal", {"low": -9.0}),
    (Gps, "r_AE_E", {}),
    (Gyro, "omega_PN_P", {}),
    (Magnetometer, "B_S", {}),
    (StarTracker, "beta_SN", {}),
    (StarVectors, "s_S", ONE_STAR),
]


def run(cls: Any, params: dict[str, Any], end: float = 30.0) -> Recording[Any]:
    sensor = cls("sensor", cls.Params(**params))
    rig = wired([sensor], r_BN_N=np.array([0.0, 7e6, 0.0]))
    record = sensor.outputs[0].record()
    Simulation([Task("truth", s(1), [rig, sensor])], seed=5).run_until(s(end))
    return record


@pytest.mark.parametrize(("cls", "field", "params"), SENSORS, ids=[c.__name__ for c, _, _ in SENSORS])
@pytest.mark.parametrize("fault", [faults.DEAD, faults.STUCK, faults.NOISY, faults.DROPPING])
def test_fault(cls: Any, field: str, params: dict[str, Any], fault: int) -> None:
    """From 10 s to before 20 s."""
    good = run(cls, params)
    bad = run(cls, {**params, "fault": fault, "fault_start_ns": s(10), "fault_stop_ns": s(20)})
    outside = (good.t_ns < s(10)) | (good.t_ns >= s(20))
    during = (bad.t_ns >= s(10)) & (bad.t_ns < s(20))
    np.testing.assert_array_equal(bad.t_ns[~during], good.t_ns[outside])
    np.testing.assert_array_equal(bad[field][~during], good[field][outside])
    if fault == faults.DEAD:
        assert not during.any()
    elif fault == faults.STUCK:
        held = good[field][good.t_ns == s(9)]
        np.testing.assert_array_equal(bad[field][during], np.repeat(held, 10, axis=0))
    elif fault == faults.NOISY:
        wide, narrow = (np.std(x[field][x.t_ns // s(10) == 1], axis=0) for x in (bad, good))
        assert np.nanmax(wide) > 3.0 * np.nanmax(narrow)
    else:
        assert 0 < during.sum() < 10
        kept = np.isin(good.t_ns, bad.t_ns[during])
        np.testing.assert_array_equal(bad[field][during], good[field][kept])


def test_stuck_from_the_start_has_nothing_to_hold() -> None:
    assert len(run(Magnetometer, {"fault": faults.STUCK})) == 0


def test_rate_of_dropped_samples() -> None:
    """10,000 samples at 0.3: 3000 lost, 4 standard errors are 183."""
    record = run(Magnetometer, {"fault": faults.DROPPING, "fault_drop": 0.3}, end=9999.0)
    assert abs(10_000 - len(record) - 3000) < 183


def test_unknown_fault_is_refused() -> None:
    with pytest.raises(ValueError, match="<= 4"):
        Gps.Params(fault=5)
