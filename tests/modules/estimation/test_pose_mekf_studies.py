"""PoseMekf against the Cramer-Rao bound, with errors of the sensors, false landmarks, an outage: Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.scenarios.pose_truth import (
    NARROW,
    NUISANCE,
    WIDE,
    Cached,
    Scene,
    Setup,
    Truth,
    monte_carlo,
    nees,
    pcrb,
)
from messages.base import F64
from modules.estimation.analysis.scores import divergences, efficiency

Criterion = Callable[[str, float], None]
pytestmark = pytest.mark.slow
BAND: Any = chi2
ALL = ("mount", "focal", "map", "gps")
ESTIMATED: dict[str, Any] = {f"{name}_mode": 2 for name in ALL} | {"mount_sigma": NUISANCE["mount"]}
CONSIDERED: dict[str, Any] = {f"{name}_mode": 1 for name in ALL} | {"mount_sigma": NUISANCE["mount"]}
OFF_NADIR = float(np.radians(30.0))


def cached(tilt: float, focal: float, duration: int = 300) -> Cached:
    return Cached(Scene(Truth(float(duration), tilt), focal, np.arange(10.0, duration + 1.0, 10.0)), duration)


def outside(square: F64, n: int = 12) -> float:
    """By how much the mean NEES (runs,) lies outside its 95 % band, by n."""
    m, mean = len(square), float(square.mean())
    low, high = BAND.ppf([0.025, 0.975], m * n) / m
    return max(low - mean, mean - high, 0.0) / n


def etas(errors: F64, bound: F64) -> tuple[float, float]:
    """RMSE over bound of position and attitude, second half."""
    position = efficiency(errors[..., :3], bound[:, :3, :3])
    return position.eta, efficiency(errors[..., 6:9], bound[:, 6:9, 6:9]).eta


@pytest.mark.parametrize(
    ("position_id", "attitude_id", "tilt", "focal", "setup"),
    [
        ("MEKF-10", "MEKF-11", 0.0, NARROW, Setup(star=1)),
        ("MEKF-12", "MEKF-13", 0.0, WIDE, Setup()),
        ("MEKF-14", "MEKF-15", OFF_NADIR, NARROW, Setup()),
    ],
)
def test_at_the_bound(
    criterion: Criterion, position_id: str, attitude_id: str, tilt: float, focal: float, setup: Setup
) -> None:
    """The demonstration of section B6 of the audit: 30 landmarks every 10 s, 0.5 px, 300 s, 100 runs."""
    made = cached(tilt, focal)
    errors, P = monte_carlo(made, setup, 100)
    position, attitude = etas(errors, pcrb(made, setup))
    assert position > 0.85 and attitude > 0.85  # below the bound would be a wrong bound or a wrong simulation
    criterion(position_id, position)
    criterion(attitude_id, attitude)
    criterion("MEKF-16", outside(nees(errors, P)[:, -1]))


def test_nuisance_states(criterion: Criterion) -> None:
    """S10: misalignment 60 arc seconds, focal length 0.1 %, map 5 m, all with a star tracker and no receiver."""
    for name, tilt in (("MEKF-20", 0.0), ("MEKF-21", OFF_NADIR)):
        made, setup = cached(tilt, NARROW), Setup(star=1, nuisance=ALL, params=ESTIMATED)
        errors, P = monte_carlo(made, setup, 100)
        criterion(name, etas(errors, pcrb(made, setup))[0])
        criterion("MEKF-22", outside(nees(errors, P)[:, -1]))
    errors, P = monte_carlo(made, Setup(star=1, nuisance=ALL, params=CONSIDERED), 60)
    criterion("MEKF-22", outside(nees(errors, P)[:, -1]))
    errors, P = monte_carlo(made, Setup(star=1, nuisance=ALL), 20)
    criterion("MEKF-23", 12.0 / float(nees(errors, P)[:, -1].mean()))


@pytest.mark.parametrize(
    ("lost_id", "position_id", "setup"),
    [
        ("MEKF-30", "MEKF-31", Setup(star=1, outliers=0.5)),
        ("MEKF-32", "MEKF-33", Setup(star=1, outliers=0.3, wrong_px=10.0)),
    ],
)
def test_false_landmarks(criterion: Criterion, lost_id: str, position_id: str, setup: Setup) -> None:
    """No consensus has removed them; the bound knows their share."""
    made = cached(0.0, NARROW)
    errors, _ = monte_carlo(made, setup, 100)
    bound = pcrb(made, setup)
    lost = divergences(errors[:, -1, :3], np.array(np.sqrt(np.trace(bound[-1, :3, :3]))), 1e4)
    criterion(lost_id, float(lost.count))
    criterion(position_id, etas(errors, bound)[0])


def test_outage(criterion: Criterion) -> None:
    """Receiver, star tracker and camera; the receiver is silent from 300 to 2100 s."""
    made = cached(0.0, NARROW, 2400)
    setup = Setup(star=1, gps=1, outage=(300.0, 2100.0), nuisance=ALL, params=ESTIMATED)
    errors, P = monte_carlo(made, setup, 20)
    square = nees(errors, P)
    criterion("MEKF-40", float(square[:, 30:210].mean()) / 12.0 - 1.0)
    criterion("MEKF-41", etas(errors[:, 30:210], pcrb(made, setup)[30:210])[0])
