"""Gps against mpmath, differences of positions, and the Allan deviations that its parameters stand for."""

from __future__ import annotations

from typing import Any

import mpmath as _mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Simulation, Task, s
from messages.base import F64
from sim.sensors.gps import Gps
from tests.sim.sensors.sensor_rig import AVERAGES, Criterion, allan_deviation, allan_of, measure, series, wired

mp: Any = _mpmath
PERFECT: dict[str, Any] = {"sigma_r": 0.0, "sigma_v": 0.0, "sigma_slow": 0.0}
SPIN = np.array([1e-7, -2e-7, 7.292115e-5])


def places() -> F64:
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(40, 3))
    direction[0], direction[1] = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
    length = rng.uniform(6.4e6, 4.3e7, 40)
    return length[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]


def geodetic(r: F64) -> tuple[float, float, float]:
    """Latitude, longitude, height with 30 digits (ERFA's are good to 1e-4 m only, high above the ground)."""
    with mp.workdps(30):
        a, f = mp.mpf(6378137), 1 / mp.mpf("298.257223563")
        e2, (x, y, z) = f * (2 - f), (mp.mpf(float(k)) for k in r)
        p = mp.hypot(x, y)
        lat = mp.atan2(z, p * (1 - e2))
        for _ in range(30):
            lat = mp.atan2(z + e2 * a / mp.sqrt(1 - e2 * mp.sin(lat) ** 2) * mp.sin(lat), p)
        h = p * mp.cos(lat) + z * mp.sin(lat) - a * mp.sqrt(1 - e2 * mp.sin(lat) ** 2)
        return float(lat), float(mp.atan2(y, x)), float(h)


def test_geodetic_against_mpmath(criterion: Criterion) -> None:
    """Latitude and longitude as metres on the ground, and height."""
    worst = 0.0
    for r in places():
        message = measure(Gps("gps", Gps.Params(**PERFECT)), r_BN_N=r)
        lat, lon, h = geodetic(r)
        away = [(message.lat - lat) * 6.4e6, (message.lon - lon) * 6.4e6 * np.cos(lat), message.h - h]
        worst = max(worst, float(np.max(np.abs(away))))
        np.testing.assert_array_equal(message.r_AE_E, r)
    criterion("GPS-1", worst)


def test_velocity_against_differences(criterion: Criterion) -> None:
    """Of the antenna's Earth-fixed position, 0.2 s and 0.4 s before and after, with a turning body and Earth."""
    rng, arm, worst = np.random.default_rng(6), np.array([1.2, -0.4, 2.0]), 0.0
    for r in places():
        v, omega, sigma = rng.normal(size=3) * 5e3, rng.normal(size=3) * 0.01, rng.uniform(-0.4, 0.4, 3)
        body, earth = Rotation.from_mrp(sigma), Rotation.random(rng=rng)

        def antenna(t: float, r: F64 = r, v: F64 = v, w: F64 = omega, body: Any = body, earth: Any = earth) -> F64:
            r_N = r + v * t + (body * Rotation.from_rotvec(w * t)).apply(arm)
            return (Rotation.from_rotvec(SPIN * t) * earth).inv().apply(r_N)

        message = measure(
            Gps("gps", Gps.Params(r_AB_B=arm, **PERFECT)),
            r_BN_N=r,
            v_BN_N=v,
            sigma_BN=sigma,
            omega_BN_B=omega,
            dcm_EN=earth.as_matrix().T,
            omega_EN_N=SPIN,
        )
        np.testing.assert_allclose(message.r_AE_E, antenna(0.0), atol=1e-8)
        slope = (8.0 * (antenna(0.2) - antenna(-0.2)) - (antenna(0.4) - antenna(-0.4))) / 2.4
        worst = max(worst, float(np.max(np.abs(message.v_AE_E - slope))))
    criterion("GPS-2", worst)


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_allan_deviation_of_velocity(criterion: Criterion, dt: float) -> None:
    y = series([Gps(f"gps_{k}", Gps.Params(sigma_v=0.05)) for k in range(8)], "v_AE_E", dt, 40_000)
    criterion("GPS-5", max(abs(allan_deviation(y, m) * np.sqrt(m) / 0.05 - 1.0) for m in AVERAGES))


@pytest.mark.parametrize("dt", [1.0, 0.5])
@pytest.mark.parametrize("kind", ["white", "slow", "walk", "all"])
def test_allan_deviation(criterion: Criterion, kind: str, dt: float) -> None:
    """Each error alone and all together, averages over 1 to 256 samples (0.05 to 13 correlation times at 1 s)."""
    sizes: dict[str, float] = {"sigma_r": 2.0, "sigma_slow": 3.0, "walk": 0.1}
    names = {"white": ["sigma_r"], "slow": ["sigma_slow"], "walk": ["walk"], "all": list(sizes)}[kind]
    used: dict[str, Any] = {n: sizes[n] if n in names else 0.0 for n in sizes}
    sensors = [Gps(f"gps_{k}", Gps.Params(**used, tau=20.0)) for k in range(8)]
    y = series(sensors, "r_AE_E", dt, 40_000, seed=2)

    def covariance(i: F64, j: F64) -> F64:
        slow = used["sigma_slow"] ** 2 * np.exp(-np.abs(i - j) * dt / 20.0)
        return slow + used["sigma_r"] ** 2 * (i == j) + used["walk"] ** 2 * dt * np.minimum(i, j)

    ratios = [allan_deviation(y, m) / allan_of(covariance, m) for m in AVERAGES]
    criterion("GPS-3", max(abs(r - 1.0) for r in ratios))


def test_variance_is_the_same_from_the_first_fix(criterion: Criterion) -> None:
    """Of 1,500 errors at the first and the fifth fix, at two rates: sigma_r^2 + sigma_slow^2."""
    worst = 0.0
    for dt in (10.0, 5.0):
        sensors = [Gps(f"gps_{k}") for k in range(500)]
        y = series(sensors, "r_AE_E", dt, 4, seed=3).reshape(5, -1, 3) - np.array([7e6, 0.0, 0.0])
        for k in (0, 4):
            worst = max(worst, abs(float(np.mean(y[k] ** 2)) / 34.0 - 1.0))
    criterion("GPS-4", worst)


def test_orientation_of_another_time_is_turned_on() -> None:
    """State 100 s younger than the orientation: 46 km on the ground, which must not be missing."""
    gps = Gps("gps", Gps.Params(**PERFECT))
    earth = Rotation.from_euler("zyx", [1.0, 0.2, -0.1])
    rig = wired([gps], dcm_EN=earth.as_matrix().T, omega_EN_N=SPIN)
    rig.step(0)
    state = rig.out_state.latest()
    assert state is not None
    rig.out_state.write(state, s(100))
    gps.step(s(100))
    expected = (Rotation.from_rotvec(100.0 * SPIN) * earth).inv().apply([7e6, 0.0, 0.0])
    message = gps.out_fix.latest()
    assert message is not None
    np.testing.assert_allclose(message.r_AE_E, expected, atol=1e-8)
    assert message.fix_ns == s(100)


def test_steps_and_limits() -> None:
    coarse = Gps("gps", Gps.Params(**PERFECT, resolution_r=0.5, resolution_v=0.25, bias_E=np.array([0.0, 1.2, -3.0])))
    message = measure(coarse, r_BN_N=np.array([7e6 + 0.3, 0.0, 0.0]), v_BN_N=np.array([0.3, 7500.1, -0.1]))
    np.testing.assert_array_equal(message.r_AE_E, [7e6 + 0.5, 1.0, -3.0])
    np.testing.assert_array_equal(message.v_AE_E, [0.25, 7500.0, 0.0])
    assert measure(Gps("gps", Gps.Params(max_speed=515.0))) is None
    assert measure(Gps("gps", Gps.Params(max_height=18e3))) is None
    assert measure(Gps("gps", Gps.Params(max_height=1e6, max_speed=1e4))) is not None


def test_lost_fixes_leave_later_errors_alone() -> None:
    """A receiver that sees NaN for a while makes the same errors afterwards."""

    def run(lose: bool) -> F64:
        gps = Gps("gps")
        rig = wired([gps])
        record = gps.out_fix.record()
        sim = Simulation([Task("truth", s(1), [rig, gps])], seed=3)
        sim.run_until(s(2))
        kept = rig.rows()[0]["r_BN_N"].copy()
        if lose:
            rig.rows()[0]["r_BN_N"] = np.nan
        sim.run_until(s(4))
        rig.rows()[0]["r_BN_N"] = kept
        sim.run_until(s(9))
        return record["r_AE_E"]

    assert len(run(lose=True)) == len(run(lose=False)) - 2
    assert np.array_equal(run(lose=True)[3:], run(lose=False)[5:])


@pytest.mark.parametrize("port", ["in_state", "in_orientation"])
def test_nothing_without_its_inputs(port: str) -> None:
    assert measure(Gps("gps"), leave=(port,)) is None
