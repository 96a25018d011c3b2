"""From where a disk is lit: shading, disks that the frame cuts off, and light beyond an outline."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from modules.opnav.disks import DiskStatus, find_disks
from modules.opnav.disks.ellipse import Ellipse
from modules.opnav.disks.shading import shading
from tests.modules.opnav import disk_scenes as scenes

CV: Any = cv2
CASSINI = Path(__file__).parents[3] / "sim" / "data" / "cassini_limb"


@pytest.mark.parametrize("law", ["lambert", "lunar"])
def test_azimuth_of_the_sun_by_shading(law: str) -> None:
    """Rendered spheres, whole and in part: to half a step of its grid, 7.5 degrees; to 25 with a circle 4 % off."""
    rng = np.random.default_rng(1)
    for phase in (20.0, 50.0, 80.0, 120.0):
        sun = float(rng.uniform(-180.0, 180.0))
        light = scenes.lit_disk((300, 260), (120.0, 140.0), 90.0, phase, sun, law)
        image = scenes.exposed(light, rng).astype(np.float32)
        for left in (0, 60):  # the frame cuts a part off
            for wrong, most in ((0.0, 7.5), (0.04, 25.0)):
                e = Ellipse(120.0 - left + wrong * 90.0, 140.0, 90.0 * (1.0 + wrong))
                found = shading(np.ascontiguousarray(image[:, left:]), e, 4.0)
                assert found is not None
                error = (math.degrees(found.azimuth) - sun + 180.0) % 360.0 - 180.0
                assert abs(error) < most, (phase, sun, left, wrong)
                assert wrong or abs(math.degrees(found.phase) - phase) <= 12.0


def test_no_shading_without_light_or_disk() -> None:
    dark = np.zeros((100, 100), np.float32)
    assert shading(dark, Ellipse(50.0, 50.0, 30.0), 0.0) is None
    assert shading(dark + 9.0, Ellipse(-60.0, 50.0, 50.0), 0.0) is None


def test_moons_of_saturn_cut_by_the_frame() -> None:
    """Gibbous moons whose terminator lies close to the limb: the frame cuts half off; within 1 px or 3 sigma."""
    with (CASSINI / "truth.csv").open() as file:
        moons = {row["image"][:11]: row for row in csv.DictReader(file)}
    errors: list[float] = []
    for name, way in (("N1572105349", 0), ("N1572105349", 2), ("N1488823805", 1), ("W1637520502", 3)):
        row = moons[name]
        x, y, radius = (float(row[k]) for k in ("cx", "cy", "r_overlay_px"))
        image = CV.imread(str(CASSINI / row["image"]), cv2.IMREAD_GRAYSCALE)
        for share in (-0.2, 0.3):  # how far the edge is from the centre, to the radius
            at = round((x, y)[way % 2] + share * radius * (1.0 if way < 2 else -1.0))
            left, upper = (at if way == 0 else 0), (at if way == 1 else 0)
            right, lower = (at if way == 2 else 1024), (at if way == 3 else 1024)
            status, disks = find_disks(np.ascontiguousarray(image[upper:lower, left:right]))
            if status != DiskStatus.FOUND:
                continue
            error = np.abs(np.array(disks[0].ellipse[:3]) - (x - left, y - upper, radius))
            sigma = np.sqrt(np.diag(disks[0].P)[:3])
            assert (error < np.maximum(1.0 if radius < 300.0 else 3.0, 3.0 * sigma)).all(), (
                name,
                way,
                share,
                error,
                sigma,
            )
            errors.append(float(error.max()))
    assert len(errors) >= 6
    assert np.median(errors) < 1.0


def test_light_beyond_an_outline() -> None:
    """Lit nearly head on: both halves show the limb, and both are used."""
    rng = np.random.default_rng(3)
    light = scenes.lit_disk((400, 400), (201.3, 195.8), 147.0, 4.0, 10.0, "lunar", over=3)
    bright = 1.0 + 0.5 * np.linspace(-1.0, 1.0, 400)  # an albedo that looks like a Sun from the right
    status, disks = find_disks(scenes.exposed(light * bright, rng, level=120.0))
    assert status == DiskStatus.FOUND
    assert np.abs(np.array(disks[0].ellipse[:3]) - (201.3, 195.8, 147.0)).max() < 0.6


def test_saturated_limb() -> None:
    """Four times too bright: the limb looks farther out, and sigma says so."""
    rng = np.random.default_rng(4)
    light = scenes.lit_disk((300, 300), (151.2, 148.9), 80.0, 60.0, 200.0, "lunar")
    _, (clear,) = find_disks(scenes.exposed(light, rng, level=180.0))
    _, (bright,) = find_disks(scenes.exposed(light, rng, level=900.0))
    error = np.abs(np.array(bright.ellipse[:3]) - (151.2, 148.9, 80.0))
    sigma = np.sqrt(np.diag(bright.P)[:3])
    assert error.max() > 0.3  # so it does
    assert (error < 3.0 * sigma).all()
    assert math.sqrt(clear.P[2, 2]) < 0.5 < sigma[2]
