"""Rendered disks through LimbFinder and HorizonNav against the bound of the information in their images."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.limb_bound import information
from benchmarks.limb_navigation import Row, measure
from benchmarks.limb_scene import Case, Scene


def test_bound_is_that_of_the_closed_form() -> None:
    """A full disk, its light known: sqrt(2 / N) across, 1 / (tan(rho) sqrt(N)) along, for N edges of the same sigma."""
    scene = Scene(Case(60.0, 0.0, law="lommel_seeliger"), np.random.default_rng(2))
    law, free, known = (np.linalg.inv(f) for f in information(scene))
    slope = math.tan(math.asin(scene.body.axes.mean() / scene.range))
    across, along = math.sqrt(np.trace(known[:2, :2]) / 2.0), math.sqrt(known[2, 2])
    assert across / along == pytest.approx(math.sqrt(2.0) * slope, rel=0.02)
    # the edge of a blurred step of height h in even noise s: sigma^2 = 2 sqrt(pi) blur (s / h)^2 for a pixel along it
    edge = across / scene.range * scene.focal * math.sqrt(math.pi * 60.0)
    assert 0.03 < edge < 0.15
    assert np.all(np.linalg.eigvalsh(law - known) > 0.0)
    assert np.trace(free) > np.trace(known)


SET = (
    Case(20.0, 60.0, 20.0, law="lambert"),
    Case(20.0, 120.0, law="lommel_seeliger"),
    Case(40.0, 0.0, 10.0, law="lommel_seeliger"),
    Case(60.0, 60.0, 20.0, law="lommel_seeliger"),
    Case(60.0, 90.0, 10.0, law="lambert"),
    Case(100.0, 30.0, 10.0, 90.0, law="lambert"),
    Case(100.0, 60.0, 10.0, law="minnaert"),
)
RUNS = 6


def test_errors_are_near_the_bound_and_as_stated() -> None:
    """Over all cases together: error over bound at most 1.3, as far as so few runs can say, and NEES in the band.

    With n squared errors the sampling of their mean leaves 1.3 open up to 1.3 sqrt(chi2(0.975, n) / n).
    """
    rows: list[Row] = [measure(case, RUNS, seed=11, circle=False, bounds_of=1) for case in SET]
    assert all(row.valid == row.runs for row in rows)
    n = len(rows) * RUNS
    across = math.sqrt(np.mean([row.ratio[0] ** 2 for row in rows]))
    along = math.sqrt(np.mean([row.ratio[1] ** 2 for row in rows]))
    assert across < 1.3 * math.sqrt(chi2.ppf(0.975, 2 * n) / (2 * n)), rows
    assert along < 1.3 * math.sqrt(chi2.ppf(0.975, n) / n), rows
    nees = float(np.mean([row.nees for row in rows]))
    assert chi2.ppf(0.025, 3 * n) / n < nees < chi2.ppf(0.975, 3 * n) / n, rows
    for row in rows:  # and none by itself far off
        assert row.nees < chi2.ppf(0.999, 3 * RUNS) / RUNS, row
