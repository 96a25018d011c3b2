"""DipoleField against Basilisk, the gradient of its potential, its known inclination and the full field."""

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

from messages.base import F64
from sim.environment.dipole_field import DipoleField
from tests.sim.environment.environment_rig import Criterion, Sky, north_east_down

mp: Any = mpmath
DATA = Path(__file__).parents[2] / "data" / "basilisk_dipole.json"


def sky_of(**change: float) -> Sky:
    sky = Sky(DipoleField("field", DipoleField.Params(**change)))
    sky.turn()
    return sky


def field(sky: Sky, r: Any) -> F64:
    sky.place(r)
    return sky.answer().B_N


def place(colatitude: float, lon: float, distance: float) -> F64:
    sine = np.sin(colatitude)
    return distance * np.array([sine * np.cos(lon), sine * np.sin(lon), np.cos(colatitude)])


def test_against_basilisk(criterion: Criterion) -> None:
    """Its planet may be away from the origin of N, ours is there."""
    worst = 0.0
    for case in json.loads(DATA.read_text())["cases"]:
        sky = sky_of(g10=case["g10"], g11=case["g11"], h11=case["h11"], radius=case["planetRadius"])
        sky.turn(case["J20002Pfix"])
        found = field(sky, np.array(case["r_BN_N"]) - np.array(case["planet_position"]))
        known = np.array(case["magField_N"])
        worst = max(worst, float(np.linalg.norm(found - known) / np.linalg.norm(known)))
    criterion("DIPOLE-1", worst)


def test_gradient_of_the_potential(criterion: Criterion) -> None:
    rng, worst, gauss = np.random.default_rng(4), 0.0, (3e-6, -5e-6, -3.1e-5)
    sky = sky_of(g11=gauss[0], h11=gauss[1], g10=gauss[2], radius=6.4e6)

    def potential(*r: Any) -> Any:
        return mp.mpf(6.4e6) ** 3 * mp.fdot(gauss, r) / mp.sqrt(mp.fdot(r, r)) ** 3

    for _ in range(20):
        turn, r = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 7e6
        sky.turn(turn)
        with mp.workdps(30):
            r_E = (mp.matrix(turn.tolist()) * mp.matrix(r.tolist())).T.tolist()[0]
            slope = [-mp.diff(potential, tuple(r_E), tuple(int(i == k) for i in range(3))) for k in range(3)]
            known = np.array([float(x) for x in mp.matrix(turn.tolist()).T * mp.matrix(slope)])
        worst = max(worst, float(np.linalg.norm(field(sky, r) - known) / np.linalg.norm(known)))
    criterion("DIPOLE-2", worst)


def test_inclination(criterion: Criterion) -> None:
    """A dipole along the axis: down in the north, up in the south."""
    sky, worst = sky_of(g11=0.0, h11=0.0), 0.0
    for lat in np.radians([-89.0, -60.0, -10.0, 0.0, 5.0, 45.0, 80.0]):
        north, east, down = north_east_down(lat, 0.7) @ field(sky, place(np.pi / 2 - lat, 0.7, 7e6))
        assert abs(east) < 1e-20
        assert down * lat >= 0.0
        worst = max(worst, abs(np.arctan2(down, north) - np.arctan(2.0 * np.tan(lat))))
    criterion("DIPOLE-3", worst)


def test_default_is_the_dipole_of_2025() -> None:
    """The geomagnetic north pole of IGRF-14 is at 80.8 degrees north, 72.8 west; the strength there is 59.5 uT."""
    params = DipoleField.Params()
    pole = -np.array([params.g11, params.h11, params.g10])
    strength = float(np.linalg.norm(pole))
    assert np.degrees(np.arcsin(pole[2] / strength)) == pytest.approx(80.8, abs=0.05)
    assert np.degrees(np.arctan2(pole[1], pole[0])) == pytest.approx(-72.8, abs=0.05)
    there = pole / strength
    np.testing.assert_allclose(field(sky_of(), 6371200.0 * there), -2.0 * strength * there, rtol=1e-14)
    assert strength == pytest.approx(2.973e-5, rel=1e-3)


def test_what_the_dipole_leaves_out(criterion: Criterion) -> None:
    sky, distance, worst = sky_of(), 6.8712e6, 0.0
    lat, lon = np.meshgrid(np.arange(-88.0, 89.0, 8.0), np.arange(-180.0, 180.0, 12.0), indexing="ij")
    date = datetime(2025, 1, 1)  # noqa: DTZ001 - ppigrf takes dates without zone
    up, south, east = (x.ravel() for x in ppigrf.igrf_gc(distance / 1e3, 90.0 - lat.ravel(), lon.ravel(), date))
    for k, (phi, lam) in enumerate(zip(np.radians(lat.ravel()), np.radians(lon.ravel()), strict=True)):
        known = 1e-9 * np.array([-south[k], east[k], -up[k]])
        found = north_east_down(phi, lam) @ field(sky, place(np.pi / 2 - phi, lam, distance))
        worst = max(worst, float(np.linalg.norm(found - known)))
    criterion("DIPOLE-4", worst)


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_no_position(bad: float) -> None:
    sky = sky_of()
    sky.place([7e6, 0.0, 0.0])
    sky.out_state.row["r_BN_N"][:] = bad
    with pytest.raises(ValueError, match=r"in_state\.r_BN_N, in_orientation\.dcm_EN: expected finite"):
        sky.answer()
    assert sky.reader.out_field.latest() is None


@pytest.mark.parametrize("missing", ["in_state", "in_orientation"])
def test_nothing_without_an_input(missing: str) -> None:
    sky = Sky(DipoleField("field"))
    if missing == "in_state":
        sky.turn()
    else:
        sky.place([7e6, 0.0, 0.0])
    assert sky.answer() is None


@pytest.mark.parametrize("wrong", [{"radius": 0.0}, {"g10": np.nan}, {"h11": np.inf}])
def test_wrong_parameters(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DipoleField.Params(**wrong)
