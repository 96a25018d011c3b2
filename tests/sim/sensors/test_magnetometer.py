"""Magnetometer against Basilisk, and its noise, steps and limits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.sensors.magnetometer import Magnetometer
from tests.sim.sensors.sensor_rig import AVERAGES, Criterion, allan_deviation, measure, series

FIELD = np.array([2e-5, -1e-5, 4e-5])


def test_against_basilisk(criterion: Criterion) -> None:
    """All cases without limits; those of Basilisk are not symmetric, ours are."""
    path = Path(__file__).parents[2] / "data" / "basilisk_sensors.json"
    worst, used = 0.0, 0
    for case in json.loads(path.read_text())["tam"]:
        yaw, pitch, roll = case["dcm_SB_321"]
        scale = case["scaleFactor"]
        params = Magnetometer.Params(
            dcm_SB=Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix().T,
            misalignment=(scale - 1.0) * np.eye(3),
            bias_S=scale * np.array(case["senBias"]),
            sigma=0.0,
        )
        sensor = Magnetometer("tam", params)
        message = measure(sensor, B_N=np.array(case["magField_N"]), sigma_BN=np.array(case["sigma_BN"]))
        limited = np.clip(message.B_S, case["minOutput"], case["maxOutput"])
        worst = max(worst, float(np.linalg.norm(limited - case["tam_S"]) / np.linalg.norm(case["tam_S"])))
        used += 1
    assert used == 8
    criterion("TAM-1", worst)


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_noise_is_white(criterion: Criterion, dt: float) -> None:
    """Allan deviation sigma / sqrt(m) for 1 to 256 samples, whatever their interval."""
    sensors = [Magnetometer(f"m{k}", Magnetometer.Params(sigma=1e-7)) for k in range(8)]
    y = series(sensors, "B_S", dt, 40_000)
    ratios = [allan_deviation(y, m) * np.sqrt(m) / 1e-7 for m in AVERAGES]
    criterion("TAM-2", max(abs(r - 1.0) for r in ratios))


def test_errors_in_their_order() -> None:
    """Misalignment and scale, then bias, then steps, then limits."""
    wrong = np.array([[0.01, 0.002, -0.003], [0.004, -0.02, 0.001], [0.0, 0.005, 0.03]])
    bias = np.array([3e-7, -2e-7, 1e-6])
    params = Magnetometer.Params(misalignment=wrong, bias_S=bias, sigma=0.0, resolution=1e-7, max_field=3e-5)
    message = measure(Magnetometer("tam", params), B_N=FIELD)
    exact = (np.eye(3) + wrong) @ FIELD + bias
    np.testing.assert_allclose(message.B_S, np.clip(np.round(exact / 1e-7) * 1e-7, -3e-5, 3e-5), rtol=1e-12)
    assert message.B_S[2] == 3e-5


def test_nothing_without_field() -> None:
    assert measure(Magnetometer("tam"), leave=("in_field",)) is None


def test_wrong_mounting_is_refused() -> None:
    with pytest.raises(ValueError, match="mirror"):
        Magnetometer.Params(dcm_SB=np.diag([1.0, 1.0, -1.0]))
