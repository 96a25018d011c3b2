"""One orbit with all sensors: errors of the size that the parameters state, and what the Sun does to each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import minutes
from sim.scenarios.leo_sensors import build
from sim.scenarios.leo_sensors.errors import Compared, Flight
from sim.scenarios.leo_sensors.graph import SUN_EXCLUSION
from sim.scenarios.leo_sensors.run import IN_SPECS, ORBIT_MIN, SENSORS, main


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight(build(), ORBIT_MIN)


@pytest.fixture(scope="module")
def results(flight: Flight) -> dict[str, Compared]:
    return flight.compared()


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("gps", 0.15),  # some 19 independent values of the slow error on each axis, a quarter of the variance
        ("gyro", 0.02),  # and the bias walks by up to 1 deg/h
        ("accelerometer", 0.01),
        ("star_tracker", 0.03),
        ("star_vectors", 0.01),
        ("magnetometer", 0.01),
        ("css_array", 0.01),
        ("simple_nav", 0.5),  # three random walks make up half of the variance
    ],
)
def test_errors_are_those_of_the_parameters(results: dict[str, Compared], name: str, tolerance: float) -> None:
    assert results[name].rms == pytest.approx(results[name].expected_rms, rel=tolerance)


def test_samples_come_at_the_rates_of_the_tasks(results: dict[str, Compared]) -> None:
    rates = {name: round(x.rate_hz, 3) for name, x in results.items()}
    assert [rates[n] for n in ("gyro", "accelerometer", "star_tracker", "gps", "css_array")] == [10, 10, 2, 1, 1]


def test_orbit_and_attitude(flight: Flight) -> None:
    """Sun-synchronous inclination, 500 km, and the gravity gradient keeps the z axis within 30 degrees of nadir."""
    r, v = flight.records["state"]["r_BN_N"], flight.records["state"]["v_BN_N"]
    h = np.cross(r, v)
    assert np.degrees(np.arccos(h[:, 2] / np.linalg.norm(h, axis=1))) == pytest.approx(97.4, abs=0.05)
    height = np.linalg.norm(r, axis=1) / 1e3 - 6378.137
    assert 480.0 < height.min() < height.max() < 530.0
    z_N = Rotation.from_mrp(flight.records["state"]["sigma_BN"]).apply([0.0, 0.0, 1.0])
    down = -np.sum(z_N * r, axis=1) / np.linalg.norm(r, axis=1)
    assert np.degrees(np.arccos(down)).max() < 30.0


def test_sun_blinds_the_tracker_that_looks_up(flight: Flight) -> None:
    """Exactly while it is within the exclusion angle, an angle computed here from the recorded truth."""
    record = flight.records["star_vectors"]
    r = flight.at("state", "r_BN_N", record.t_ns)
    to_sun = flight.sun_before(record.t_ns, "r_PN_N") - r
    up = flight.body(record.t_ns).apply([0.0, 0.0, -1.0])
    angle = np.arccos(np.sum(up * to_sun, axis=1) / np.linalg.norm(to_sun, axis=1))
    assert np.array_equal(record["valid"], angle >= SUN_EXCLUSION)
    assert 0.05 < np.mean(~record["valid"]) < 0.5
    assert record["count"][~record["valid"]].max() == 0
    assert record["count"].max() == 16


def test_sun_sensors_are_dark_in_the_shadow(flight: Flight, results: dict[str, Compared]) -> None:
    """The shadow lasts a third of the orbit; then every cell reads clamped noise, and outside one reads more."""
    light = flight.records["light"]["illumination"]
    assert 0.3 < np.mean(light == 0.0) < 0.4
    signal = results["css_array"].measured
    mean = 0.02 / np.sqrt(2 * np.pi)
    assert signal[light == 0.0].mean() == pytest.approx(mean, rel=0.03)
    assert signal[light == 1.0].max(axis=1).min() > 0.5


def test_burn_is_felt(flight: Flight) -> None:
    """0.02 N on 12 kg for five minutes give 0.5 m/s, by the accelerometer and by the velocity it counts."""
    record = flight.records["accelerometer"]
    burning = (record.t_ns > minutes(30)) & (record.t_ns <= minutes(35))
    assert record["accel_P"][burning, 0].mean() == pytest.approx(0.02 / 12.0, rel=2e-3)
    assert np.sum(record["accel_P"][burning, 0]) * 0.1 == pytest.approx(0.5, rel=2e-3)


def test_same_seed_same_run() -> None:
    first, again, other = (Flight(build(seed=seed), 0.2).records["gps"]["r_AE_E"] for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.any(first == other)


def test_main_prints_a_table_and_saves_plots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--minutes", "0.2", "--out", str(tmp_path / "new")]) == 0
    shown = capsys.readouterr().out
    assert "rms error" in shown
    assert len(list((tmp_path / "new").glob("*.png"))) == 8
    assert (tmp_path / "new" / "gps.png").stat().st_size > 10_000


def test_main_says_what_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "gps.png").mkdir()
    assert main(["--minutes", "0.1", "--out", str(tmp_path)]) == 1
    assert "cannot save" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--minutes", "-1"], ["--minutes", "nan"], ["--seed", "x"]])
def test_main_refuses_nonsense(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert arguments[0] in capsys.readouterr().err


def test_pictures_of_the_specs_are_there() -> None:
    """And the specs show them."""
    for name in IN_SPECS:
        assert (SENSORS / name / f"{name}.png").is_file()
        assert f"]({name}.png)" in (SENSORS / name / "SPEC.md").read_text()
