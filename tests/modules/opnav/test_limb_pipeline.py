"""Rendered disks through LimbFinder and HorizonNav against the bound of the information in their images."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.limb_navigation import Row, measure
from benchmarks.limb_scene import Case, Scene


def test_bound_is_that_of_the_closed_form() -> None:
    """A full disk, its light known: sqrt(2 / N) across, 1 / (tan(rho) sqrt(N)) along, for N edges of the same sigma."""
    scene = Scene(Case(60.0, 0.0, law="lommel_seeliger"), np.random.default_rng(2))
    unknown, known = (np.linalg.inv(f) for f in scene.information())
    slope = math.tan(math.asin(scene.body.axes.mean() / scene.range))
    across, along = math.sqrt(np.trace(known[:2, :2]) / 2.0), math.sqrt(known[2, 2])
    assert across / along == pytest.approx(math.sqrt(2.0) * slope, rel=0.02)
    # the edge of a blurred step of height h in even noise s: sigma^2 = 2 sqrt(pi) blur (s / h)^2 for a pixel along it
    edge = across / scene.range * scene.focal * math.sqrt(math.pi * 60.0)
    assert 0.03 < edge < 0.15
    assert np.all(np.linalg.eigvalsh(unknown - known) > 0.0)


def _check(row: Row, most: float) -> None:
    """Errors within ``most`` times the bound, and a covariance that is not smaller than they are."""
    assert row.valid == row.runs
    assert max(row.ratio) < most, row
    assert row.nees < chi2.ppf(0.999, 3 * row.runs) / row.runs, row


def test_half_lit_disk() -> None:
    """A guard against getting worse, not the aim: docs/limb_navigation.md says how near to the bound which case is."""
    _check(measure(Case(60.0, 60.0, 10.0), 6, circle=False), 2.5)
