"""Pictures of Mars: what is bright faces the Sun, the limb is where the truth says, and files are what was taken."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from fsw import minutes
from fsw.math.bodies import body
from fsw.math.epoch import epoch
from fsw.math.view_geometry import field_of_view
from messages.base import F64
from sim.scenarios.mars_disk import build
from sim.scenarios.mars_disk.graph import EPOCH, PERIOD_S, camera_config, mars_attitude
from sim.scenarios.mars_disk.run import Picture, main, take

COUNT = 12
EVERY = minutes(round(PERIOD_S / 60.0 / COUNT))


@pytest.fixture(scope="module")
def pictures() -> list[Picture]:
    return take(build(picture_ns=EVERY), COUNT, EVERY)


def test_phases_and_places(pictures: list[Picture]) -> None:
    """Crescents, halves, and a full disk; in the middle and 10 degrees beside it; near and far."""
    phase = np.degrees([p.truth.phase for p in pictures])
    assert phase.min() < 15.0 and phase.max() > 140.0 and np.count_nonzero((phase > 60.0) & (phase < 120.0)) >= 3
    away = [float(np.linalg.norm(p.truth.center_px - 255.5)) for p in pictures]
    assert min(away) < 5.0 and 60.0 < max(away) < 90.0
    distance = [float(np.linalg.norm(p.truth.r_PC_C)) for p in pictures]
    assert min(distance) == pytest.approx(18e6 * 0.8, rel=1e-3) and max(distance) == pytest.approx(18e6 * 1.2, rel=1e-3)
    assert [p.t_ns for p in pictures] == [k * EVERY for k in range(COUNT)]


def test_the_lit_limb_faces_the_sun(pictures: list[Picture]) -> None:
    """Just inside the limb it is bright towards the Sun and dark on the other side; just outside there is space."""
    seen = 0
    for p in pictures:
        if not 20.0 < np.degrees(p.truth.phase) < 140.0:
            continue
        seen += 1
        middle, sun = p.truth.ellipse.center_px, p.truth.sun_px
        edge = p.truth.limb_px[np.argmax((p.truth.limb_px - middle) @ sun)] - middle

        def grey(part: float, way: F64 = edge, middle: F64 = middle, image: Any = p.image) -> int:
            x, y = np.rint(middle + part * way).astype(int)
            return int(image[y, x])

        assert grey(0.95) > 60, f"phase {np.degrees(p.truth.phase):.0f}"
        assert grey(1.05) < 12
        assert grey(-0.95) < 12 or p.truth.phase < 0.8
        assert grey(0.95) > grey(-0.95)
    assert seen >= 8


def test_limb_is_an_edge_where_the_truth_says(pictures: list[Picture]) -> None:
    """On the lit side the grey level along the normal passes half of its rise within 1 px of the exact limb."""
    for p in pictures:
        if np.degrees(p.truth.phase) > 100.0:
            continue
        middle = p.truth.ellipse.center_px
        normal = p.truth.limb_px - middle
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        for k in np.flatnonzero(normal @ p.truth.sun_px > 0.9)[::6]:
            steps = np.arange(-4.0, 4.01, 0.25)
            x, y = (p.truth.limb_px[k] + steps[:, None] * normal[k]).T
            profile = p.image[np.rint(y).astype(int), np.rint(x).astype(int)].astype(float)
            half = 0.5 * (profile[:4].mean() + profile[-4:].mean())
            assert abs(steps[np.argmax(profile < half)]) <= 1.0


def test_field_of_view() -> None:
    assert np.degrees(field_of_view(camera_config())[:2]) == pytest.approx([55.0, 55.0], abs=1e-12)


def test_orbit_and_rates() -> None:
    """Two-body energy; velocity, angular velocity and acceleration against differences of the motion."""
    scenario = build()
    rows: list[Any] = []
    for t in (3_599.0, 3_600.0, 3_601.0):
        scenario.orbit.step(round(t * 1e9))
        rows.append(scenario.orbit.out_state.latest())
    before, now, after = rows
    mu = body("Mars").mu
    assert now.v_BN_N @ now.v_BN_N / 2.0 - mu / np.linalg.norm(now.r_BN_N) == pytest.approx(-mu / 36e6, rel=1e-12)
    np.testing.assert_allclose((after.r_BN_N - before.r_BN_N) / 2.0, now.v_BN_N, atol=1e-3)
    turn = Rotation.from_mrp(before.sigma_BN.copy()).inv() * Rotation.from_mrp(after.sigma_BN.copy())
    np.testing.assert_allclose(turn.as_rotvec() / 2.0, now.omega_BN_B, atol=1e-10)
    change = (after.omega_BN_B - before.omega_BN_B) / 2.0
    np.testing.assert_allclose(change, now.omegaDot_BN_B, atol=1e-12)


def test_attitude_of_mars() -> None:
    """Pole and node as the report defines them, and the latitude below the Sun in that season."""
    dcm = mars_attitude(-32_184_000_000)  # J2000
    ra, dec, w = np.radians([317.68143, 52.88650, 176.630])
    pole = np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    node = np.array([-math.sin(ra), math.cos(ra), 0.0])
    np.testing.assert_allclose(dcm[2], pole, atol=1e-12)
    np.testing.assert_allclose(dcm[0], math.cos(w) * node + math.sin(w) * np.cross(pole, node), atol=1e-12)
    scenario = build()
    scenario.sun.step(0)
    sun = scenario.sun.out_ephemeris.latest()
    assert sun is not None
    height = (mars_attitude(epoch(EPOCH)) @ sun.r_PN_N)[2] / np.linalg.norm(sun.r_PN_N)
    # solar longitude 180 degrees came on 2024-01-12 (Mars year 37): northern autumn, the Sun near the equator
    assert np.degrees(math.asin(height)) == pytest.approx(0.0, abs=2.0)


def test_program(tmp_path: Path, capsys: pytest.CaptureFixture[str], pictures: list[Picture]) -> None:
    folder = tmp_path / "new" / "mars"
    assert main(["--out", str(folder), "--pictures", str(COUNT)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == COUNT + 5 and said[-1] == f"saved {COUNT} pictures, sheet.png and errors.png in {folder}"
    files = [*(p.name for p in pictures), "sheet.png", "errors.png"]
    assert sorted(f.name for f in folder.iterdir()) == sorted(files)
    for p in pictures:
        assert np.array_equal(np.asarray(Image.open(folder / p.name)), p.image)


def test_positions_along_the_orbit(pictures: list[Picture]) -> None:
    """To 120 degrees of phase both ways find Mars, to 0.2 % of the range by the limb and 0.6 % by the circle."""
    tried = 0
    for p in pictures:
        if np.degrees(p.truth.phase) > 120.0:
            continue
        tried += 1
        distance = float(np.linalg.norm(p.truth.r_PC_C))
        limb, circle = p.found("horizon"), p.found("circle")
        assert limb is not None and circle is not None
        assert abs(limb.range) < 0.002 * distance and abs(circle.range) < 0.006 * distance
        assert limb.across < 4e-4 * distance and abs(limb.range) < 4.0 * limb.sigma_range
    assert tried >= 6


@pytest.mark.parametrize(
    ("arguments", "words"), [(["--pictures", "0"], "between 1 and 1000"), (["--out", "/dev/null/x"], "cannot make")]
)
def test_bad_arguments(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert words in capsys.readouterr().err
