"""CssArray against Basilisk, its clamped noise, and earthshine against an integral over the sunlit planet."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages.base import F64
from sim.sensors.css_array import CssArray
from tests.sim.sensors.sensor_rig import AU, AVERAGES, Criterion, allan_deviation, measure, series

PERFECT: dict[str, Any] = {"sigma": 0.0, "albedo": 0.0}
DATA = Path(__file__).parents[2] / "data" / "basilisk_sensors.json"


def test_against_basilisk(criterion: Criterion) -> None:
    """Six copies of each cell.

    Basilisk's astronomical unit is 7 m shorter than that of 2012, so the Sun is moved in proportion.
    """

    def sun(case: Any) -> F64:
        r = np.array(case["r_BN_N"])
        return r + (np.array(case["sun_N"]) - r) * (149597870700.0 / 149597870693.0)

    worst, lit = 0.0, 0
    for case in json.loads(DATA.read_text())["css"]:
        scale = case.get("scaleFactor", 1.0)
        params = CssArray.Params(
            normals_B=np.tile(case["nHat_B"], (6, 1)),
            fov=case["fov"],
            scale_error=np.full(6, scale - 1.0),
            bias=np.full(6, case.get("albedo", 0.0) + case.get("senBias", 0.0)),
            low=case.get("minOutput", -10.0),
            high=case.get("maxOutput", 10.0),
            **PERFECT,
        )
        state: dict[str, Any] = {k: np.array(case[k]) for k in ("r_BN_N", "sigma_BN")}
        message = measure(CssArray("css", params), leave=("in_eclipse",), sun=sun(case), **state)
        worst = max(worst, float(np.max(np.abs(message.signal - case["out"]["sensedValue"]))))
        lit += case["out"]["sensedValue"] > 0.1
    assert lit > 10
    case = json.loads(DATA.read_text())["constellation"]
    for first in (0, 2):
        params = CssArray.Params(normals_B=np.array(case["nHat_B"][first : first + 6]), fov=case["fov"], **PERFECT)
        state: dict[str, Any] = {k: np.array(case[k]) for k in ("r_BN_N", "sigma_BN")}
        message = measure(CssArray("css", params), leave=("in_eclipse",), sun=sun(case), **state)
        worst = max(worst, float(np.max(np.abs(message.signal - case["CosValue"][first : first + 6]))))
    criterion("CSS-1", worst)


def test_dark_faces(criterion: Criterion) -> None:
    """Clamped at 0, the noise of a dark face has mean sigma / sqrt(2 pi) and standard deviation 0.5838 sigma."""
    params = CssArray.Params(sigma=0.05, albedo=0.0)
    signal = series([CssArray("css", params)], "signal", 0.25, 100_000)
    dark, sigma = signal[:, 1:], 0.05
    mean_error = np.mean(dark, axis=0) / (sigma / np.sqrt(2 * np.pi)) - 1.0
    deviation_error = np.std(dark, axis=0) / (sigma * np.sqrt(0.5 - 0.5 / np.pi)) - 1.0
    criterion("CSS-2", float(np.max(np.abs([mean_error, deviation_error]))))


def test_noise_of_lit_faces(criterion: Criterion) -> None:
    """Mean and standard deviation where nothing is clamped."""
    params = CssArray.Params(sigma=0.02, albedo=0.0, normals_B=np.tile([1.0, 1.0, 0.0], (6, 1)))
    signal = series([CssArray("css", params)], "signal", 0.25, 10_000)
    mean = (np.mean(signal) / (AU / (AU - 7e6)) ** 2 - np.sqrt(0.5)) / 0.02
    criterion("CSS-3", max(abs(float(mean)), abs(float(np.std(signal) / 0.02 - 1.0))))


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_allan_deviation(criterion: Criterion, dt: float) -> None:
    """White: sigma / sqrt(m) for 1 to 256 samples, whatever their interval."""
    params = CssArray.Params(sigma=0.02, albedo=0.0, normals_B=np.tile([1.0, 1.0, 0.0], (6, 1)))
    signal = series([CssArray(f"css_{k}", params) for k in range(4)], "signal", dt, 40_000)
    criterion("CSS-5", max(abs(allan_deviation(signal, m) * np.sqrt(m) / 0.02 - 1.0) for m in AVERAGES))


def lambert_sphere(r_B: F64, normal: F64, sun: F64, radius: float) -> float:
    """Irradiance by an integral over the planet: every sunlit element scatters its light evenly (Lambert)."""
    z, phi = np.meshgrid((np.arange(1000) + 0.5) / 500 - 1, (np.arange(500) + 0.5) * 2 * np.pi / 500)
    rho = np.sqrt(1 - z**2)
    up = np.stack([rho * np.cos(phi), rho * np.sin(phi), z], axis=-1).reshape(-1, 3)
    area = 4 * np.pi * radius**2 / len(up)
    to = r_B - radius * up
    d = np.linalg.norm(to, axis=1)
    leaving, arriving = np.sum(up * to, axis=1) / d, -(to @ normal) / d
    seen = (leaving > 0) & (arriving > 0)
    light = np.maximum(up @ sun, 0.0)
    return float(np.sum((light * leaving * arriving / (np.pi * d**2) * area)[seen]))


def test_earthshine(criterion: Criterion) -> None:
    """Against the integral, 500 km above the equator of a sphere, Sun 0 to 45 degrees from the zenith.

    The cells look down and 20 degrees from there, where the whole planet is in front of them.
    """
    worst, r = 0.0, np.array([6.871e6, 0.0, 0.0])
    for angle in np.radians([0.0, 20.0, 45.0]):
        sun = np.array([np.cos(angle), np.sin(angle), 0.0])
        tilt = np.radians(20.0)
        normals = np.tile([-1.0, 0.0, 0.0], (6, 1))
        normals[1] = [-np.cos(tilt), 0.0, np.sin(tilt)]
        params = CssArray.Params(normals_B=normals, sigma=0.0, albedo=1.0, fov=0.01, radius=6.371e6)
        message = measure(CssArray("css", params), r_BN_N=r, sun=AU * sun)
        for k in (0, 1):
            worst = max(worst, abs(message.signal[k] / lambert_sphere(r, normals[k], sun, 6.371e6) - 1.0))
    criterion("CSS-4", worst)


def test_eclipse_takes_the_direct_light() -> None:
    for part in (1.0, 0.25, 0.0):
        message = measure(CssArray("css", CssArray.Params(**PERFECT)), illumination=part)
        np.testing.assert_allclose(message.signal, [part * (AU / (AU - 7e6)) ** 2, 0, 0, 0, 0, 0], rtol=1e-14)


def test_fields_of_view_and_grazing_light() -> None:
    """The cosine ends at the edge of the field, and Kelly's factor bends it before that."""
    for degrees, expected in [(79.9, np.cos(np.radians(79.9))), (80.1, 0.0)]:
        turned = Rotation.from_euler("z", degrees, degrees=True).as_mrp()
        message = measure(CssArray("css", CssArray.Params(**PERFECT)), sigma_BN=turned, sun=np.array([1e30, 0, 0]))
        lit = CssArray.Params(**PERFECT, high=1e300)
        assert message.signal[0] < 1e-30
        message = measure(CssArray("css", lit), sigma_BN=turned, sun=np.array([AU, 0, 0]), r_BN_N=np.array([1.0, 0, 0]))
        assert message.signal[0] == pytest.approx(expected, abs=1e-9)
    kelly = CssArray.Params(**PERFECT, kelly_factor=0.1, kelly_power=2.0)
    turned = Rotation.from_euler("z", 70.0, degrees=True).as_mrp()
    message = measure(CssArray("css", kelly), sigma_BN=turned, r_BN_N=np.array([1.0, 0, 0]))
    x = np.cos(np.radians(70.0))
    assert message.signal[0] == pytest.approx(x * (1 - np.exp(-(x**2) / 0.1)), abs=1e-9)


def test_light_from_behind() -> None:
    """Beyond a right angle the current is negative, and 0 is the lowest reading unless told otherwise."""
    turned = Rotation.from_euler("z", 100.0, degrees=True).as_mrp()
    for low, expected in [(-1.0, np.cos(np.radians(100.0))), (0.0, 0.0)]:
        params = CssArray.Params(**PERFECT, fov=2.0, low=low)
        message = measure(CssArray("css", params), sigma_BN=turned, r_BN_N=np.array([1.0, 0, 0]))
        assert message.signal[0] == pytest.approx(expected, abs=1e-9)


def test_misaligned_cells_and_steps() -> None:
    """A cell turned by 0.1 rad about z loses 1 - cos(atan 0.1) of its light; readings are multiples of the step."""
    turn = np.zeros((6, 3))
    turn[0, 2] = 0.1
    params = CssArray.Params(**PERFECT, misalignment_B=turn)
    message = measure(CssArray("css", params), r_BN_N=np.array([1.0, 0, 0]))
    assert message.signal[0] == pytest.approx(1.0 / np.sqrt(1.01), rel=1e-9)
    coarse = measure(CssArray("css", CssArray.Params(**PERFECT, misalignment_B=turn, resolution=0.125)))
    assert coarse.signal[0] == 1.0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"normals_B": np.zeros((6, 3))}, "six vectors"),
        ({"high": -1.0}, "more than low"),
        ({"fov": 3.2}, "<= 3.14159"),
        ({"albedo": 1.5}, "<= 1"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        CssArray.Params(**change)


@pytest.mark.parametrize("port", ["in_state", "in_sun"])
def test_nothing_without_its_inputs(port: str) -> None:
    assert measure(CssArray("css"), leave=(port,)) is None
