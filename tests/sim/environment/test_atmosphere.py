"""Atmosphere against 30 digits, the standard atmosphere, and air that turns with the planet."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw.math.atmosphere import EARTH_BANDS, height_above_spheroid
from fsw.math.compiled import plain
from messages.base import F64
from sim.environment.atmosphere import Atmosphere
from tests.sim.environment.environment_rig import Criterion, Sky, position_of

mp: Any = mpmath
SPIN = np.array([1e-6, -2e-6, 7.29e-5])
STANDARD = {100: 5.604e-7, 200: 2.541e-10, 300: 1.916e-11, 400: 2.803e-12, 500: 5.215e-13, 600: 1.137e-13,
            700: 3.070e-14, 800: 1.136e-14, 900: 5.759e-15, 1000: 3.561e-15}  # fmt: skip
"""US Standard Atmosphere 1976, table I: km and kg/m^3."""


def sky_of(**change: Any) -> Sky:
    sky = Sky(Atmosphere("air", Atmosphere.Params(**change)))
    sky.turn(omega=SPIN)
    return sky


def air(sky: Sky, r: Any) -> Any:
    sky.place(r)
    return sky.answer()


def exact_density(r_E: F64) -> float:
    """With the distance of the ellipsoid along the radius from its equation, and the band by looking through all."""
    x, y, z = (mp.mpf(float(k)) for k in r_E)
    a = mp.mpf(6378137)
    b = a * (1 - 1 / mp.mpf("298.257223563"))
    height = mp.sqrt(x * x + y * y + z * z) * (1 - 1 / mp.sqrt((x * x + y * y) / a**2 + z * z / b**2)) / 1000
    base, density, scale = [band for band in EARTH_BANDS.tolist() if band[0] <= max(height, 0)][-1]
    return float(density * mp.exp(-(height - base) / scale)) if height >= 0 else density


def test_density_against_mpmath(criterion: Criterion) -> None:
    rng, worst = np.random.default_rng(11), 0.0
    sky = sky_of()
    for _ in range(200):
        turn = Rotation.random(rng=rng).as_matrix()
        u = rng.normal(size=3)
        r = (6.378e6 + rng.uniform(0.0, 2e6)) * u / np.linalg.norm(u)
        sky.turn(turn, SPIN)
        found = air(sky, r).density
        with mp.workdps(30):
            worst = max(worst, abs(found / exact_density(turn @ r) - 1.0))
    criterion("ATMOSPHERE-1", worst)


def test_published_example() -> None:
    """Vallado, example 8-4: 747.2119 km above the ellipsoid, on the equator."""
    assert air(sky_of(), [6378137.0 + 747211.9, 0.0, 0.0]).density == pytest.approx(2.1219854e-14, rel=2e-8)


def test_bands_meet(criterion: Criterion) -> None:
    base, density, scale = EARTH_BANDS.T
    below = density[:-1] * np.exp(-np.diff(base) / scale[:-1])
    worst = float(np.max(np.abs(below / density[1:] - 1.0)))
    criterion("ATMOSPHERE-2", worst)
    sky = sky_of()
    for km in base[1:]:
        under, over = (air(sky, [6378137.0 + 1e3 * km + d, 0.0, 0.0]).density for d in (-1e-3, 1e-3))
        assert abs(under / over - 1.0) < worst + 1e-6


def test_against_the_standard_atmosphere(criterion: Criterion) -> None:
    sky = sky_of()
    ratios = [air(sky, [6378137.0 + 1e3 * km, 0.0, 0.0]).density / rho for km, rho in STANDARD.items()]
    criterion("ATMOSPHERE-3", max(abs(x - 1.0) for x in ratios))


def test_air_turns_with_the_planet(criterion: Criterion) -> None:
    worst, r = 0.0, np.array([4.1e6, -3.3e6, 4.6e6])
    for axis in (SPIN, np.array([0.0, 0.0, -3e-7])):
        sky = sky_of()
        sky.turn(Rotation.random(rng=np.random.default_rng(2)).as_matrix(), axis)
        slope = (Rotation.from_rotvec(0.2 * axis).apply(r) - Rotation.from_rotvec(-0.2 * axis).apply(r)) / 0.4
        worst = max(worst, float(np.abs(air(sky, r).v_AN_N - slope).max()))
    criterion("ATMOSPHERE-4", worst)


def test_height_is_nearly_geodetic(criterion: Criterion) -> None:
    worst = 0.0
    for lat in np.linspace(-np.pi / 2, np.pi / 2, 20):
        for height in (0.0, 2e5, 5e5):
            r = position_of(lat, 1.0, height)
            found = plain(height_above_spheroid)(float(r @ r), r[2], 6378137.0, 1 / 298.257223563)
            worst = max(worst, abs(found - height))
    criterion("ATMOSPHERE-5", worst)


def test_bands_of_another_planet() -> None:
    """Two bands: below, within, and above both."""
    base, density, scale = np.zeros((3, 28))
    base[:2], density[:2], scale[:2] = [1e4, 5e4], [0.02, 1e-4], [1e4, 2e4]
    sky = sky_of(radius=3e6, flattening=0.0, bands=2, base_height=base, density=density, scale_height=scale)
    found = [air(sky, [0.0, 3e6 + h, 0.0]).density for h in (0.0, 2e4, 5e4, 9e4)]
    np.testing.assert_allclose(found, [0.02, 0.02 * np.exp(-1.0), 1e-4, 1e-4 * np.exp(-2.0)], rtol=1e-13)


def test_bands_are_checked() -> None:
    base, full = np.arange(28.0), np.ones(28)
    with pytest.raises(ValueError, match=r"Atmosphere\.Params\.base_height: expected ascending"):
        Atmosphere.Params(base_height=base[::-1].copy(), density=full, scale_height=full)
    with pytest.raises(ValueError, match=r"Atmosphere\.Params\.scale_height: expected > 0"):
        Atmosphere.Params(base_height=base, density=full, scale_height=np.where(base < 5, full, 0.0))
    Atmosphere.Params(bands=5, base_height=base, density=full, scale_height=np.where(base < 5, full, 0.0))
    with pytest.raises(ValueError, match="scale_height"):
        Atmosphere.Params(base_height=base, density=full)
    wrongs: list[dict[str, Any]] = [
        {"radius": 0.0},
        {"flattening": 1.0},
        {"bands": 29},
        {"bands": 0},
        {"density": -full},
    ]
    for wrong in wrongs:
        with pytest.raises(ValueError, match=next(iter(wrong))):
            Atmosphere.Params(**wrong)


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_no_position(bad: float) -> None:
    sky = sky_of()
    sky.place([7e6, 0.0, 0.0])
    sky.out_state.row["r_BN_N"][:] = bad
    with pytest.raises(ValueError, match=r"in_state\.r_BN_N, in_orientation: expected finite"):
        sky.answer()
    assert sky.reader.out_atmosphere.latest() is None


@pytest.mark.parametrize("missing", ["in_state", "in_orientation"])
def test_nothing_without_an_input(missing: str) -> None:
    sky = Sky(Atmosphere("air"))
    if missing == "in_state":
        sky.turn()
    else:
        sky.place([7e6, 0.0, 0.0])
    assert sky.answer() is None
