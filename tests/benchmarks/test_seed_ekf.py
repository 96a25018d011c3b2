"""The baseline filter: repaired it finds its way at nadir, as written it does not; tuning picks the best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.baselines.seed_ekf import AS_WRITTEN, BUG_FIXED, SeedEkf, Settings, geodetic, tuned
from benchmarks.scenarios.earth_truth import (
    GROUND,
    Camera,
    Motion,
    disturbed,
    earth,
    exact,
    flown,
    nadir_pointing,
    state_of,
    turn_between,
)
from messages.base import F64

INERTIA = np.array([0.04, 0.05, 0.02])


def flight(flavour: str, seconds: int, seed: int = 1, **more: float) -> tuple[float, float]:
    """Position error [m] and attitude error [rad] after some time with camera and stars."""
    rng, nominal, camera = np.random.default_rng(seed), nadir_pointing(), Camera(500e3 / 15.0)
    error = rng.normal(size=(1, 12)) * np.repeat([500.0, 1.0, 1e-3, 1e-6], 3)
    true = disturbed(nominal, error)
    ekf = SeedEkf(state_of(nominal), replace(Settings(flavour), **more))
    stars = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    for k in range(1, seconds + 1):
        true = flown(true, 1.0)
        m = true.at(0)
        ekf.predict(1.0)
        ekf.star_vectors(stars @ m.dcm_BN.T + 5e-5 * rng.normal(size=(3, 3)), stars)
        if k % 10 == 0:
            seen = camera.landmarks(m, 10, k, rng)
            ekf.earth_tracker(camera.pixels(m, seen, k) + 0.5 * rng.normal(size=(10, 2)), seen)
    if not np.all(np.isfinite(ekf.x)):
        return np.inf, np.inf
    away, turn = ekf.x[:3] - true.at(0).r, turn_between(true.at(0).dcm_BN, ekf.dcm_BN())
    return float(np.linalg.norm(away)), float(np.linalg.norm(turn))


def test_repaired_motion() -> None:
    """Ten minutes: an orbit of the right kind where the printed equations are kilometres off."""
    m = nadir_pointing()
    then = exact(m, np.array([600.0]))[0]
    away: dict[str, float] = {}
    for flavour in (BUG_FIXED, AS_WRITTEN):
        ekf = SeedEkf(state_of(m), Settings(flavour))
        for _ in range(600):
            ekf.x = ekf.moved(ekf.x, 1.0)
        away[flavour] = float(np.linalg.norm(ekf.x[:3] - then.r))
    assert away[BUG_FIXED] < 20.0  # its constants are those of WGS84
    assert away[AS_WRITTEN] > 2000.0


def test_flavours() -> None:
    """The repaired one is at the level of its assumed range, the one as written is lost."""
    height = float(np.linalg.norm(nadir_pointing().r)) - GROUND
    position, attitude = flight(BUG_FIXED, 60, altitude=height)
    assert position < 300.0
    assert attitude < 1e-3
    wrong, _ = flight(BUG_FIXED, 60, altitude=height + 1000.0)  # the assumed range comes back as a measured one
    assert 500.0 < wrong < 1300.0
    with np.errstate(all="ignore"):  # it runs away
        lost, _ = flight(AS_WRITTEN, 60)
    assert lost > 1e4


def test_tuning_and_geodetic() -> None:
    """The grid's least cost is taken, NaN never; a place and its height come back."""

    def cost(s: Settings) -> float:
        return np.nan if s.depth == 0.0 else abs(s.depth - 1e3) + abs(s.sigma_px - 0.5) + float(s.Q[0, 0])

    best = tuned(Settings(), cost)
    assert (best.depth, best.sigma_px) == (1e3, 0.5)
    r = earth(0.0) @ np.array([0.0, 6378137.0 + 1000.0, 0.0])
    np.testing.assert_allclose(geodetic(r), [0.0, 90.0, 1000.0], atol=1e-6)
    assert isinstance(best.inertia, np.ndarray)


def test_derivatives_of_the_start() -> None:
    """Both flavours stand for the same attitude at the start."""
    m: Motion = nadir_pointing(0.3)
    found: list[F64] = [SeedEkf(state_of(m), Settings(flavour)).dcm_BN() for flavour in (BUG_FIXED, AS_WRITTEN)]
    for dcm in found:
        np.testing.assert_allclose(dcm, m.dcm_BN, atol=1e-12)
