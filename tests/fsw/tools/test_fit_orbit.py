"""The fit of real orbits, of a made one with known answer, the formats, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import erfa
import msgspec
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

from fsw import cache
from fsw.math.compiled import COMPILE
from fsw.math.earth_orientation import EarthParameters, assumed_parameters, gcrf_to_itrf, read_parameters
from fsw.math.epoch import calendar, epoch, julian_dates
from fsw.math.harmonics import SIZE, GravityField, read_icgem
from fsw.tools.cli import main
from fsw.tools.fit_orbit import shipped
from fsw.tools.orbit_files import read_orbit
from fsw.tools.orbit_fit import fit_orbit, inertial
from fsw.tools.orbit_flight import flight_params, fly
from messages.base import F64

ERFA: Any = erfa
ORBITS = Path(__file__).parents[3] / "sim" / "data" / "orbits"
SENTINEL, STATION = ORBITS / "sentinel1a_2023-08-23.EOF", ORBITS / "iss_oem_2023-07-03.txt"
compiled_only = pytest.mark.skipif(not COMPILE, reason="degree 50 as plain Python takes minutes")
MU, RADIUS, J2 = 3.986004415e14, 6378136.3, 1.0826e-3


@pytest.fixture(autouse=True)
def _quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "progress", lambda text: None)


def fitted(file: Path, out: Path, *options: str) -> dict[str, Any]:
    assert main(["fit-orbit", str(file), "-o", str(out), *options]) == 0
    assert out.with_name(out.name + ".png").stat().st_size > 10_000
    return json.loads(out.with_name(out.name + ".json").read_text())


@compiled_only
def test_sentinel_below_a_metre(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Six parameters and a coefficient over 3.3 h; the bar is 10 m, the aim 3 m."""
    made = fitted(SENTINEL, tmp_path / "fit", "--light")
    assert made["residuals"]["rms_m"] < 0.3
    assert 0.01 < made["coefficient_times_area_by_mass_m2_kg"] < 0.06
    # 98.18 deg is the mission's, to the equator of date, which precession has turned by 0.13 deg from that of GCRF
    assert made["osculating_elements"]["inclination_deg"] == pytest.approx(98.18, abs=0.14)
    assert "Sentinel-1A" in capsys.readouterr().out


@compiled_only
def test_station_over_33_hours(tmp_path: Path) -> None:
    """One drag coefficient; the bar is 1 km. The file itself gives 1.90 x 1421.5 m^2 / 454442 kg for its own air."""
    made = fitted(STATION, tmp_path / "fit", "--drag")
    assert made["residuals"]["largest_m"] < 50.0
    assert made["coefficient_times_area_by_mass_m2_kg"] == pytest.approx(1.9 * 1421.5 / 454442.0, rel=0.5)


@compiled_only
def test_part_of_an_arc_predicts_the_rest(tmp_path: Path) -> None:
    """Fitted over the first 20 h, the orbit is within 1 km 13 h later."""
    made = fitted(STATION, tmp_path / "fit", "--drag", "--arc", "2023-07-03T12:00:00", "2023-07-04T08:00:00")
    arc = read_orbit(STATION)
    eop, field = read_parameters(shipped("earth_orientation")[0]), read_icgem(shipped("gravity")[0])
    params = flight_params(made["epoch_tai_ns"], arc.seconds[-1], 415e3, eop, field)
    params = msgspec.structs.replace(params, drag=made["coefficient_times_area_by_mass_m2_kg"])
    states = fly(params, np.array(made["r_N_m"] + made["v_N_m_s"]), arc.epoch_ns.tolist())
    assert np.linalg.norm(states[-1, :3] - inertial(arc, eop)[-1]) < 1000.0


def simple_orbit(zero: int, times: F64, start: F64, eop: EarthParameters) -> F64:
    """Positions (n, 3) with J2 about the pole of the Earth, the Sun and the Moon, by scipy, in plain vectors."""
    seconds = np.linspace(times[0], times[-1], 8)
    epochs = zero + (seconds * 1e9).astype(np.int64)
    tt, poles = julian_dates(epochs), [gcrf_to_itrf(int(t), eop)[2] for t in epochs]
    axis = BarycentricInterpolator(seconds, np.array(poles))
    au = 149597870700.0
    sun = BarycentricInterpolator(seconds, -ERFA.epv00(*tt)[0]["p"] * au)
    moon = BarycentricInterpolator(seconds, ERFA.moon98(*tt)["p"] * au)

    def slope(t: float, y: F64) -> F64:
        pole = axis(t)
        r, d, z = y[:3], float(np.linalg.norm(y[:3])), float(y[:3] @ pole)
        a = -MU / d**3 * r - 1.5 * MU * J2 * RADIUS**2 / d**5 * ((1 - 5 * z**2 / d**2) * r + 2 * z * pole)
        for at, mu in ((sun(t), 1.32712440041e20), (moon(t), 4.902800118e12)):
            a += mu * ((at - r) / np.linalg.norm(at - r) ** 3 - at / np.linalg.norm(at) ** 3)
        return np.concatenate([y[3:], a])

    tolerance = np.repeat([1e-6, 1e-9], 3)
    return solve_ivp(slope, (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=tolerance).y[:3].T


@compiled_only
def test_flight_against_scipy() -> None:
    """With a field of J2 alone, whose pole is that of the Earth."""
    zero = epoch("2023-08-01T00:00:00Z")
    c = np.zeros((SIZE, SIZE))
    c[0, 0], c[2, 0] = 1.0, -J2 / math.sqrt(5.0)
    field, eop = GravityField("J2", MU, RADIUS, 2, c, np.zeros((SIZE, SIZE)), "none"), assumed_parameters(zero, 0.0)
    start, times = np.array([7e6, 0.0, 0.0, 0.0, 4e3, 6.4e3]), np.linspace(0.0, 10000.0, 51)
    expected = simple_orbit(zero, times, start, eop)
    got = fly(flight_params(zero, 10000.0, 6e5, eop, field), start, [zero + round(t * 1e9) for t in times])[:, :3]
    assert np.linalg.norm(got - expected, axis=1).max() < 1e-3


@compiled_only
def test_made_orbit_is_found_again(tmp_path: Path) -> None:
    """An orbit that the fit's own forces made, with 5 m of noise, as SP3: state within four formal deviations."""
    zero = epoch("2023-08-01T00:00:00", "tai") + 19_000_000_000  # GPS time
    eop = assumed_parameters(zero, 0.0)
    c = np.zeros((SIZE, SIZE))
    c[0, 0], c[2, 0] = 1.0, -4.8e-4
    field = GravityField("J2", MU, RADIUS, 2, c, np.zeros((SIZE, SIZE)), "none")
    params = flight_params(zero, 9000.0, 6e5, eop, field)
    start = np.array([6.9e6, 1e5, 0.0, 0.0, 1.2e3, 7.4e3])
    epochs = [zero + 60_000_000_000 * k for k in range(151)]
    states = fly(params, start, epochs)
    noise = 5.0 * np.random.default_rng(3).normal(size=(151, 3))
    lines = ["#dP2023  8  1  0  0  0.00000000     151 ORBIT IGS20 FIT TEST", "%c L  cc GPS ccc cccc cccc"]
    for t, row, n in zip(epochs, states[:, :3], noise, strict=True):
        day, clock = calendar(t - 19_000_000_000, "tai", 0).split("T")
        words = [int(w) for w in (*day.split("-"), *clock.split(":")[:2])]
        lines.append(
            f"*  {words[0]} {words[1]:2d} {words[2]:2d} {words[3]:2d} {words[4]:2d} {int(clock[6:]):2d}.00000000"
        )
        x = (gcrf_to_itrf(t, eop) @ row + n) / 1e3
        lines += [f"PL51{x[0]:14.6f}{x[1]:14.6f}{x[2]:14.6f} 999999.999999", f"PL52{0:14.6f}{0:14.6f}{0:14.6f}"]
    path = tmp_path / "made.sp3"
    path.write_text("\n".join([*lines, "EOF"]))
    arc = read_orbit(path)
    assert arc.name == "L51" and arc.epoch_ns.tolist() == epochs
    fit = fit_orbit(arc, params, inertial(arc, eop), "none")
    assert fit.rms == pytest.approx(5.0 * math.sqrt(3.0), rel=0.1)
    error = np.concatenate([fit.r_N, fit.v_N]) - start
    assert np.all(np.abs(error) < 4.0 * fit.sigma), error / fit.sigma


def test_formats() -> None:
    sentinel, station = read_orbit(SENTINEL), read_orbit(STATION)
    assert (sentinel.format, sentinel.axes, len(sentinel.epoch_ns)) == ("Sentinel EOF", "ITRF", 199)
    assert (station.format, station.axes, len(station.epoch_ns)) == ("CCSDS OEM", "EME2000", 499)
    assert station.epoch_ns[0] == epoch("2023-07-03T12:00:00Z")
    assert calendar(int(sentinel.epoch_ns[0]), decimals=6) == "2023-08-23T12:31:39.035127Z"


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("CCSDS_OEM_VERS", "NOTHING", "expected an orbit in SP3"),
        ("EME2000", "TEME", "TEME; convert"),
        ("CENTER_NAME          = Earth", "CENTER_NAME          = Moon", "Moon"),
        ("TIME_SYSTEM          = UTC", "TIME_SYSTEM          = UT1", "time system"),
        ("2023-07-03T12:04:00.000 2756", "2023-07-03T12:64:00.000 2756", "line 40"),
        ("2023-07-03T12:04:00.000 2756.411598132200", "2023-07-03T12:04:00.000 nan", "finite"),
        ("2023-07-03T12:04:00.000 2756.411598132200", "2023-07-03T12:04:00.000 2.7", "distances"),
    ],
)
def test_damaged_file(
    old: str, new: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = STATION.read_text()
    assert old in whole
    path = tmp_path / "bad.txt"
    path.write_text(whole.replace(old, new))
    assert main(["fit-orbit", str(path)]) == 1
    message = capsys.readouterr().err
    assert "bad.txt" in message and text in message
    assert not list(tmp_path.glob("orbit_fit*"))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--arc", "2024-01-01", "2024-01-02"], "got 0; the file has 2023-07-03T12:00:00Z to"),
        (["--arc", "2023-07-04", "2023-07-03"], "start before its stop"),
        (["--satellite", "L51"], "no positions of L51; choose one with --satellite: ISS"),
        (["--degree", "70"], "2 to 50"),
        (["--ut1-utc", "5"], "0.9"),
        (["--eop", str(STATION)], "finals2000A"),
        (["--gravity", str(STATION)], "ICGEM"),
    ],
)
def test_refused(options: list[str], text: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["fit-orbit", str(STATION), "-o", str(tmp_path / "x"), *options]) == 1
    assert text in capsys.readouterr().err


def test_a_satellite_that_the_file_lacks() -> None:
    assert read_orbit(str(SENTINEL), "Sentinel-1A").name == "Sentinel-1A"
    with pytest.raises(ValueError, match="no positions of Sentinel-2B"):
        read_orbit(SENTINEL, "Sentinel-2B")


def test_one_damaged_position_is_pointed_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """100 km off: the orbit is pulled away, which the command says."""
    path = tmp_path / "jump.txt"
    path.write_text(STATION.read_text().replace("12:04:00.000 2756.", "12:04:00.000 2656."))
    stop = ["--arc", "2023-07-03T12:00:00", "2023-07-03T18:00:00", "--degree", "8"]
    assert main(["fit-orbit", str(path), *stop, "-o", str(tmp_path / "x")]) == 0
    assert "warning: the position at 2023-07-03T12:04:00Z" in capsys.readouterr().out


def test_no_orientation_of_the_earth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "late.txt"
    path.write_text(STATION.read_text().replace("2023-07-0", "2031-07-0"))
    assert main(["fit-orbit", str(path), "-o", str(tmp_path / "x")]) == 1
    assert "--eop" in capsys.readouterr().err
