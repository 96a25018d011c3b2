"""The main job on the real photos: its physics, false photos, one photo, and an orbit that is shifted."""

from __future__ import annotations

import csv
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import erfa
import msgspec
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from sgp4.api import Satrec

from modules.estimation.pose_from_landmarks import FixStatus
from sim.camera.photo_player import read_image
from sim.scenarios.iss_photos.camera_file import read_calibration
from sim.scenarios.iss_photos.graph import build
from sim.scenarios.iss_photos.inputs import read_inputs
from sim.scenarios.iss_photos.options import DATA, parse
from sim.scenarios.iss_photos.run import main

PHOTOS = sorted((DATA / "iss_photos").glob("*.jpg"))
TLE = (DATA / "orbits" / "iss_tle_2023-05-03.txt").read_text().splitlines()


def read(folder: Path) -> list[dict[str, str]]:
    with (folder / "fixes.csv").open() as file:
        return list(csv.DictReader(file))


def orbit(utc: str) -> tuple[np.ndarray, np.ndarray]:
    """Position (m, Earth-fixed) and the axes radial, along, normal, from sgp4 and pyerfa alone."""
    t = datetime.fromisoformat(utc)
    day, fraction = 2451544.5, (t - datetime(2000, 1, 1, tzinfo=t.tzinfo)).total_seconds() / 86400.0
    _, r, v = Satrec.twoline2rv(*TLE).sgp4(day, fraction)
    turn = erfa.rz(erfa.gmst82(day, fraction), np.eye(3))
    r, v = 1e3 * turn @ np.array(r), 1e3 * turn @ np.array(v)
    normal = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    up = r / np.linalg.norm(r)
    return r, np.array([up, np.cross(normal, up), normal])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the run without options, on the ten shipped photos."""
    out = tmp_path_factory.mktemp("iss") / "out"
    assert main(["--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def errors(folder: Path) -> np.ndarray:
    """Fix minus orbit of the valid fixes, (n, 3) m: radial, along, normal."""
    found: list[np.ndarray] = []
    for row in read(folder):
        if row["valid"] == "1":
            r, axes = orbit(row["utc"])
            found.append(axes @ (np.array([float(row[f"r_ecef_{k}_m"]) for k in "xyz"]) - r))
    return np.array(found)


def test_positions_agree_with_the_orbit(errors: np.ndarray) -> None:
    """Half of what was asked for, but along the track, where the orbit itself is known to 1 or 2 km only."""
    length = np.linalg.norm(errors, axis=1)
    rms, scatter = np.sqrt((errors**2).mean(axis=0)), errors.std(axis=0, ddof=1)
    assert len(errors) >= 9
    assert np.median(length) < 3e3 and length.max() < 6e3
    assert rms[0] < 500.0 and rms[2] < 1000.0
    assert scatter[1] < 1200.0


def test_photos_are_not_a_copy_of_the_orbit(errors: np.ndarray) -> None:
    assert np.all(errors.std(axis=0) > 20.0)


def test_sigma_covers_the_errors(folder: Path, errors: np.ndarray) -> None:
    sigma = np.array([float(row["sigma_pos_m"]) for row in read(folder) if row["valid"] == "1"])
    length = np.linalg.norm(errors, axis=1)
    assert not np.any((length > 6e3) & (length > 3.0 * sigma))
    assert np.all(length < 3.0 * sigma) and np.all(sigma < 4e3)


def filtered(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The filter's positions minus orbit and standard deviations, (n, 3) m: radial, along, normal; photos used (n,)."""
    with (folder / "track.csv").open() as file:
        rows = list(csv.DictReader(file))
    away: list[np.ndarray] = []
    for row in rows:
        r, axes = orbit(row["utc"])
        away.append(axes @ (np.array([float(row[f"r_ecef_{k}_m"]) for k in "xyz"]) - r))
    sigma = [[float(row[f"sigma_{k}_m"]) for k in ("radial", "along", "cross")] for row in rows]
    return np.array(away), np.array(sigma), np.array([int(row["photos_used"]) for row in rows])


def test_filter_covers_its_error(folder: Path) -> None:
    """One pass through the filter of pose, lens, mounting and clock; 7.81 is the 95 % point of three errors."""
    error, sigma, used = filtered(folder)
    assert used[-1] >= 9 and len(error) > 100
    assert np.all(np.sum((error / sigma) ** 2, axis=1) < 7.81)
    assert np.all(np.abs(error) < 2.5 * sigma)
    # not covered by being vague: hardly more than what lens and mounting inherit from the orbit
    assert np.all(sigma[-1] < [800.0, 2500.0, 900.0]) and np.all(sigma[-1] <= sigma[0] * 1.05)
    steps = np.abs(np.diff(error, axis=0))
    assert np.median(steps) < 50.0  # a track, and not ten fixes


def test_attitude_is_repeatable(folder: Path) -> None:
    q = np.array([[float(row[f"q_CO_{k}"]) for k in range(4)] for row in read(folder) if row["valid"] == "1"])
    rotations = Rotation.from_quat(q, scalar_first=True)
    away = (rotations.mean().inv() * rotations).as_rotvec()
    assert np.degrees(away.std(axis=0, ddof=1)).max() * 60.0 < 10.0


def test_all_result_files_are_there(folder: Path) -> None:
    names = {p.name for p in folder.iterdir()}
    files = {"fixes.csv", "track.csv", "calibration.json", "errors.png", "ground_track.png", "overlays"}
    assert names == files
    overlays = sorted((folder / "overlays").iterdir())
    assert [p.name for p in overlays] == [f"{p.stem}_overlay.jpg" for p in PHOTOS]
    assert all(cv2.imread(str(p)) is not None for p in [*overlays, folder / "errors.png", folder / "ground_track.png"])


def test_calibration_is_that_of_the_lens(folder: Path) -> None:
    """The data sheet's lens of 5 mm gives 1010 to 1070 px; the boresight is some degrees off nadir, aft and left."""
    camera, accuracy, cadence = read_calibration(folder / "calibration.json")
    assert 1020.0 < camera.focal_px[0] < 1045.0
    assert accuracy.photos >= 9 and accuracy.sigma_focal_px < 3.0
    boresight = camera.dcm_CB[2]
    assert 7.0 < np.degrees(np.arccos(boresight[2])) < 10.0 and boresight[0] < 0.0 and boresight[1] < 0.0
    assert cadence is not None and abs(cadence.period_s - 12.12) < 0.06


def false_photos(folder: Path) -> None:
    """Write photos with true times and false pictures."""
    pictures = {
        "mirrored": read_image(PHOTOS[9])[:, ::-1],
        "elsewhere": read_image(PHOTOS[0]),
        "black": np.zeros((972, 1296, 3), np.uint8),
    }
    for k, (name, pixels) in enumerate(pictures.items()):
        with Image.open(PHOTOS[9 - k]) as original:
            exif = original.info["exif"]
        Image.fromarray(np.ascontiguousarray(pixels)).save(folder / f"{name}.jpg", exif=exif)


def test_false_photos_give_no_fix(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    false_photos(tmp_path)
    out = tmp_path / "out"
    assert main(["--photos", str(tmp_path), "--calibration", str(folder / "calibration.json"), "--out", str(out)]) == 1
    rows = read(out)
    assert len(rows) == 3
    for row in rows:
        assert row["valid"] == "0" and row["reason"] and row["r_ecef_x_m"] == row["sigma_pos_m"] == row["q_CO_0"] == ""
    assert "no photo could be located" in capsys.readouterr().out


def test_one_photo_with_a_calibration_and_the_same_again(folder: Path, tmp_path: Path) -> None:
    files = ["--photos", str(PHOTOS[7]), "--calibration", str(folder / "calibration.json")]
    for name in ("out", "again"):
        assert main([*files, "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "out" / "fixes.csv").read_bytes() == (tmp_path / "again" / "fixes.csv").read_bytes()
    (row,) = read(tmp_path / "out")
    r, _ = orbit(row["utc"])
    assert row["valid"] == "1"
    assert np.linalg.norm(np.array([float(row[f"r_ecef_{k}_m"]) for k in "xyz"]) - r) < 6e3


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_fixes_do_not_follow_a_shifted_orbit(folder: Path, axis: int) -> None:
    camera, accuracy, _ = read_calibration(folder / "calibration.json")
    inputs = msgspec.structs.replace(read_inputs(parse([])), camera=camera, accuracy=accuracy)
    offset = np.zeros(3)
    offset[axis] = 20e3
    run = build(inputs, inputs.orbit.shifted(offset), sigma_shift_m=20e3)
    done = run.round([8], lambda: None)
    assert done[8] is FixStatus.VALID
    before: dict[str, Any] = read(folder)[8]
    moved = run.fixes.rows()[-1]["r_CE_E"] - np.array([float(before[f"r_ecef_{k}_m"]) for k in "xyz"])
    assert np.linalg.norm(moved) < 0.03 * 20e3


@pytest.mark.slow
def test_photos_held_out_of_the_calibration(tmp_path: Path) -> None:
    even, odd = [str(p) for p in PHOTOS[::2]], [str(p) for p in PHOTOS[1::2]]
    assert main(["--photos", *odd, "--out", str(tmp_path / "odd")]) == 0
    calibration = str(tmp_path / "odd" / "calibration.json")
    assert main(["--photos", *even, "--calibration", calibration, "--out", str(tmp_path / "even")]) == 0
    found: list[np.ndarray] = []
    for row in read(tmp_path / "even"):
        assert row["valid"] == "1"
        r, axes = orbit(row["utc"])
        found.append(axes @ (np.array([float(row[f"r_ecef_{k}_m"]) for k in "xyz"]) - r))
    assert np.linalg.norm(found, axis=1).max() < 6e3
    assert np.sqrt((np.array(found)[:, 0] ** 2).mean()) < 1e3
