"""MagneticField against the official WMM2025 values, ppigrf, Basilisk, 30 digits, and a field without sources."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import ppigrf
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, ModuleError, Out, Simulation, Task, s
from fsw.math.epoch import DAY, SECOND, epoch
from messages.base import F64
from messages.environment import PlanetOrientationMsg
from messages.states import SCStatesMsg
from sim.environment.magnetic_field import MagneticField, Model, igrf14, of_model, read_cof, read_shc, wmm2025
from tests.sim.environment.environment_rig import STILL, Criterion, Sky, north_east_down, position_of

ROOT = Path(__file__).parents[3]
DATA = ROOT / "tests/data"
mp: Any = mpmath
PLACES = [(7.0e6, 0.3, 1.2), (6.4e6, 3.0, -2.0), (6.8e6, 1e-4, 0.5), (6.8e6, np.pi - 1e-4, 2.5), (4.2e7, 1.8, -0.4)]


def at_year(year: float) -> int:
    """Epoch of a decimal year."""
    first = epoch(f"{int(year)}-01-01", "tai")
    return first + round((year - int(year)) * (epoch(f"{int(year) + 1}-01-01", "tai") - first))


def sky_of(year: float, model: Model, degree: int = 0) -> Sky:
    sky = Sky(MagneticField("field", of_model(model, at_year(year), degree)))
    sky.turn()
    return sky


def field(sky: Sky, r: Any, t_ns: int = 0) -> F64:
    sky.place(r, t_ns)
    return sky.answer(t_ns).B_N


def by_mpmath(year: float, height: float, lat: float, lon: float) -> list[Any]:
    """North, east, down (nT, geodetic) of WMM2025 with 30 digits: the sum as its report writes it, km and degrees."""
    lines = (ROOT / "sim/data/magnetic/WMM_2025.COF").read_text().splitlines()[1:]
    terms = [line.split() for line in lines if not line.startswith("9999")]
    phi, lam, t = mp.radians(lat), mp.radians(lon), mp.mpf(year) - 2025
    e2 = (2 - 1 / mp.mpf("298.257223563")) / mp.mpf("298.257223563")
    across = mp.mpf("6378.137") / mp.sqrt(1 - e2 * mp.sin(phi) ** 2)
    p, z = (across + height) * mp.cos(phi), (across * (1 - e2) + height) * mp.sin(phi)
    r, theta = mp.hypot(p, z), mp.atan2(p, z)
    cosine, sine = mp.cos(theta), mp.sin(theta)
    legendre: dict[tuple[int, int], Any] = {}
    north = east = up = mp.mpf(0)
    for n in range(13):
        for m in range(n):
            below = legendre.get((n - 2, m), 0)
            legendre[n, m] = ((2 * n - 1) * cosine * legendre[n - 1, m] - (n + m - 1) * below) / (n - m)
        legendre[n, n] = mp.fac2(2 * n - 1) * sine**n if n else mp.mpf(1)
    for words in terms:
        n, m = int(words[0]), int(words[1])
        g, h = (mp.mpf(words[k]) + t * mp.mpf(words[k + 2]) for k in (2, 3))
        factor = mp.sqrt((2 if m else 1) * mp.fac(n - m) / mp.fac(n + m)) * (mp.mpf("6371.2") / r) ** (n + 2)
        slope = (n * cosine * legendre[n, m] - (n + m) * legendre.get((n - 1, m), 0)) / sine
        wave, shifted = g * mp.cos(m * lam) + h * mp.sin(m * lam), g * mp.sin(m * lam) - h * mp.cos(m * lam)
        north += factor * wave * slope
        east += factor * m * shifted * legendre[n, m] / sine
        up += factor * (n + 1) * wave * legendre[n, m]
    turn = phi - (mp.pi / 2 - theta)  # from geocentric to geodetic latitude
    return [north * mp.cos(turn) - up * mp.sin(turn), east, -up * mp.cos(turn) - north * mp.sin(turn)]


def test_official_table(criterion: Criterion) -> None:
    """The table's north is not that of its own coefficients in the last three digits: an exact sum shows the same."""
    north = away = exact = 0.0
    skies = dict[float, Sky]()
    rows = np.loadtxt(DATA / "wmm2025_test_values.txt", comments="#")
    assert rows.shape == (50, 18)
    for year, height, lat_deg, lon_deg, *values in rows:
        if year not in skies:
            skies[year] = sky_of(year, wmm2025())
        lat, lon = np.radians([lat_deg, lon_deg])
        found = north_east_down(lat, lon) @ field(skies[year], position_of(lat, lon, 1e3 * height))
        table = 1e-9 * np.array(values[3:6])
        north = max(north, abs(found[0] - table[0]))
        away = max(away, float(np.abs(found[1:] - table[1:]).max()))
        with mp.workdps(30):
            known = np.array([float(x) for x in by_mpmath(year, height, lat_deg, lon_deg)]) * 1e-9
        exact = max(exact, float(np.linalg.norm(found - known) / np.linalg.norm(known)))
    criterion("MAGNETIC-1", away)
    criterion("MAGNETIC-6", north)
    criterion("MAGNETIC-7", exact)


def by_ppigrf(r: F64, date: datetime) -> F64:
    """Field in Earth-fixed components, T."""
    distance, colatitude, lon = np.linalg.norm(r), np.arccos(r[2] / np.linalg.norm(r)), np.arctan2(r[1], r[0])
    up, south, east = (
        float(x.item()) for x in ppigrf.igrf_gc(distance / 1e3, np.degrees(colatitude), np.degrees(lon), date)
    )
    down_to = north_east_down(np.pi / 2 - colatitude, lon)
    return 1e-9 * down_to.T @ np.array([-south, east, -up])


def place(distance: float, colatitude: float, lon: float) -> F64:
    sine = np.sin(colatitude)
    return distance * np.array([sine * np.cos(lon), sine * np.sin(lon), np.cos(colatitude)])


def test_against_ppigrf(criterion: Criterion) -> None:
    """At dates of the table, one of them where two intervals meet."""
    worst = 0.0
    for year in (1900, 1965, 2000, 2020, 2025):
        sky = sky_of(float(year), igrf14())
        for spot in PLACES:
            r = place(*spot)
            expected = by_ppigrf(r, datetime(year, 1, 1))  # noqa: DTZ001 - ppigrf takes dates without zone
            worst = max(
                worst,
                float(np.linalg.norm(field(sky, r) / np.linalg.norm(expected) - expected / np.linalg.norm(expected))),
            )
    criterion("MAGNETIC-2", worst)


def test_between_the_dates(criterion: Criterion) -> None:
    """A run from 2023.0 to 2027.5 passes the date at which the rates change."""
    worst, sky, r = 0.0, sky_of(2023.0, igrf14()), place(*PLACES[0])
    start = at_year(2023.0)
    nodes = {y: by_ppigrf(r, datetime(y, 1, 1)) for y in (2020, 2025, 2030)}  # noqa: DTZ001 - as above
    for year in (2023.0, 2024.25, 2024.999, 2025.0, 2025.001, 2027.5):
        low = 2020 if year < 2025.0 else 2025
        expected = nodes[low] + (year - low) / 5.0 * (nodes[low + 5] - nodes[low])
        found = field(sky, r, at_year(year) - start)
        worst = max(worst, float(np.linalg.norm(found - expected) / np.linalg.norm(expected)))
    criterion("MAGNETIC-3", worst)


def test_against_basilisk(criterion: Criterion) -> None:
    """Basilisk counts the date in whole seconds; in one the field changes by 1e-11 of itself."""
    worst = 0.0
    for case in json.loads((DATA / "basilisk_wmm.json").read_text())["cases"]:
        start = round(at_year(case["epochDateFractionalYear"]) / SECOND) * SECOND
        sky = Sky(MagneticField("field", of_model(wmm2025(), start)))
        sky.turn(case["J20002Pfix"])
        found = field(sky, case["r_BN_N"], case["callTime"])
        expected = np.array(case["magField_N"])
        worst = max(worst, float(np.linalg.norm(found - expected) / np.linalg.norm(expected)))
    criterion("MAGNETIC-4", worst)


def test_no_sources(criterion: Criterion) -> None:
    """Divergence and curl vanish, also on the axis: the largest element of both against the field's gradient."""
    sky, h, worst = sky_of(2025.0, igrf14()), 2e3, 0.0
    for r in (np.array([1e6, -5e6, 4.2e6]), np.array([0.0, 0.0, 6.8e6]), np.array([0.0, 0.0, -6.8e6])):
        jacobian = np.empty((3, 3))
        for k in range(3):
            # five points: the error is of fourth order in h
            step = h * np.eye(3)[k]
            near, far = field(sky, r + step) - field(sky, r - step), field(sky, r + 2 * step) - field(sky, r - 2 * step)
            jacobian[:, k] = (8.0 * near - far) / (12.0 * h)
        wrong = max(abs(np.trace(jacobian)), float(np.max(np.abs(jacobian - jacobian.T))))
        worst = max(worst, wrong / float(np.linalg.norm(jacobian)))
    criterion("MAGNETIC-5", worst)


def test_turned_planet() -> None:
    """The field turns with the Earth, and only directions are turned back."""
    turn = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    sky, r = sky_of(2024.5, igrf14()), np.array([3e6, -5e6, 4e6])
    fixed = field(sky, turn @ r)
    sky.turn(turn)
    np.testing.assert_allclose(field(sky, r), turn.T @ fixed, rtol=1e-13)


def test_lower_degree_is_a_shorter_sum() -> None:
    """Degree 1 is the dipole, written out."""
    r = np.array([-2e6, 5e6, 4.5e6])
    found = field(sky_of(2025.0, igrf14(), degree=1), r)
    gauss, distance = 1e-9 * np.array([-1410.3, 4545.5, -29350.0]), float(np.linalg.norm(r))
    expected = (6371200.0 / distance) ** 3 * (3 * r * (gauss @ r) / distance**2 - gauss)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15 * float(np.linalg.norm(expected)))


def test_igrf_is_the_default() -> None:
    default = MagneticField.Params(epoch_tai_ns=at_year(2024.5))
    named = of_model(igrf14(), at_year(2024.5))
    np.testing.assert_array_equal(default.g, named.g)
    assert default.degree == named.degree == 13


@pytest.mark.parametrize(
    ("year", "model", "text"),
    [(2024.99, wmm2025, "WMM-2025 is valid from 2025 to 2030"), (2030.01, wmm2025, "2030"), (2031.0, igrf14, "1900")],
)
def test_epoch_outside_of_the_model(year: float, model: Any, text: str) -> None:
    with pytest.raises(ValueError, match=r"MagneticField.Params.epoch_tai_ns.*" + text):
        sky_of(year, model())


@pytest.mark.parametrize("degree", [13, -1])
def test_degree_that_the_model_lacks(degree: int) -> None:
    with pytest.raises(ValueError, match=r"degree.*WMM-2025 has degree 12"):
        sky_of(2026.0, wmm2025(), degree=degree)


class Still(Module):
    """A spacecraft that stays where it is."""

    out_state = Out(SCStatesMsg)
    out_orientation = Out(PlanetOrientationMsg)

    def step(self, t_ns: int) -> None:
        r = np.array([7e6, 0.0, 0.0])
        self.out_state.write(
            SCStatesMsg(r_BN_N=r, v_BN_N=STILL, sigma_BN=STILL, omega_BN_B=STILL, omegaDot_BN_B=STILL), t_ns
        )
        self.out_orientation.write(PlanetOrientationMsg(dcm_EN=np.eye(3), omega_EN_N=STILL), t_ns)


def run_on(model: Model, year: float, days: int) -> int:
    """Run from ``year`` with one step a day, and say how many fields were published."""
    source, reader = Still("still"), MagneticField("field", of_model(model, at_year(year)))
    source.out_state.connect(reader.in_state)
    source.out_orientation.connect(reader.in_orientation)
    Simulation([Task("truth", s(86400), [source, reader])]).run_until(s(86400) * days)
    return reader.out_field.seq


def test_run_past_the_model() -> None:
    """2029.99 is 3.65 days before the end."""
    assert run_on(wmm2025(), 2029.99, 3) == 4
    with pytest.raises(ModuleError, match="epoch_tai_ns: the time is after"):
        run_on(wmm2025(), 2029.99, 4)


def test_model_that_ends_before_2000() -> None:
    whole = igrf14()
    old = Model("old", whole.epochs[:19], whole.degree, whole.g[:19], whole.h[:19])
    assert old.epochs[-1] == 1990.0
    assert run_on(old, 1989.99, 3) == 4
    with pytest.raises(ModuleError, match="epoch_tai_ns: the time is after"):
        run_on(old, 1989.99, 4)


@pytest.mark.parametrize("r", [0.0, np.nan])
def test_no_position(r: float) -> None:
    sky = sky_of(2025.0, igrf14())
    sky.place([7e6, 0.0, 0.0])
    sky.out_state.row["r_BN_N"][:] = r
    with pytest.raises(ValueError, match=r"in_state\.r_BN_N"):
        sky.answer()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("1  13 27 2 1", "1  14 27 2 1"), "degree"),
        (("1  13 27 2 1", "1  13 27 6 1"), "order"),
        (("-29350.0", "-29x50.0"), "could not convert"),
        ((" 1   1  -2298", " 1   2  -2298"), ""),
    ],
)
def test_wrong_shc(tmp_path: Path, change: tuple[str, str], text: str) -> None:
    path = ROOT / "sim/data/magnetic/IGRF14.shc"
    bad = tmp_path / "bad.shc"
    assert change[0] in path.read_text()
    bad.write_text(path.read_text().replace(*change))
    with pytest.raises(ValueError, match=f"bad.*{text}"):
        read_shc(bad)


def test_wrong_cof(tmp_path: Path) -> None:
    path = ROOT / "sim/data/magnetic/WMM_2025.COF"
    bad = tmp_path / "bad.COF"
    bad.write_text("\n".join(path.read_text().splitlines()[:40]))
    with pytest.raises(ValueError, match="degree 8 has 80 of them, each once; found 70"):
        read_cof(bad)


def test_years_are_calendar_years() -> None:
    """Half of a leap year and half of a common year are 183 and 182.5 days."""
    assert at_year(2028.5) - at_year(2028.0) == 183 * DAY
    assert at_year(2027.5) - at_year(2027.0) == 182.5 * DAY
