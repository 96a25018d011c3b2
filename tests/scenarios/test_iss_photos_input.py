"""Bad input to the scenario: exit code 2, one clear sentence, no traceback, nothing written."""

from __future__ import annotations

import errno
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from PIL import Image

from sim.scenarios.iss_photos.camera_file import (
    BadInputError,
    calibration_json,
    read_calibration,
    read_camera,
)
from sim.scenarios.iss_photos.inputs import read_inputs
from sim.scenarios.iss_photos.options import DATA, parse
from sim.scenarios.iss_photos.run import main
from sim.scenarios.iss_photos.writing import output_folder

PHOTOS = sorted((DATA / "iss_photos").glob("*.jpg"))
TLE = DATA / "orbits" / "iss_tle_2023-05-03.txt"
CAMERA: dict[str, Any] = {"width_px": 1296, "height_px": 972, "focal_px": [1040.0, 1040.0], "center_px": [647.5, 485.5]}
CALIBRATION: dict[str, Any] = {
    "camera": {**CAMERA, "distortion": [0.03, -0.02, 0.0, 0.0, 0.0]},
    "dcm_CO": [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    "sigma_focal_px": 1.0,
    "sigma_center_px": [1.0, 1.0],
    "sigma_distortion": [0.001, 0.001, 0.001, 0.001, 0.0],
    "sigma_mounting_rad": [0.001, 0.001, 0.001],
    "sigma_common_m": [300.0, 2000.0, 500.0],
    "shutter_period_s": 12.12,
    "shutter_sigma_s": 0.005,
    "photos": 10,
    "rms_px": 1.0,
}


def refused(capsys: pytest.CaptureFixture[str], out: Path, *arguments: str | Path) -> str:
    """The sentence with which the scenario refuses its arguments."""
    code = main([str(a) for a in arguments] + ["--out", str(out)])
    text = capsys.readouterr()
    assert code == 2
    assert "Traceback" not in text.err + text.out
    assert text.err.count("\n") == 1 and text.err.startswith("error: ")
    assert not out.exists() and not list(out.parent.glob(f".{out.name}*"))
    return text.err


def photo(path: Path, source: Path | None = PHOTOS[0], size: tuple[int, int] = (1296, 972), stamp: str = "") -> Path:
    picture = Image.new("RGB", size, (90, 80, 70))
    exif = Image.Exif()
    if source is not None:
        with Image.open(source) as original:
            exif.load(original.info["exif"])
    if stamp:
        exif.get_ifd(0x8769)[0x9003] = stamp
    picture.save(path, exif=exif)
    return path


def test_photo_that_is_no_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.jpg").write_text("text")
    assert "a.jpg: it is no image" in refused(capsys, tmp_path / "out", "--photos", tmp_path / "a.jpg")


def test_photo_without_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, tmp_path / "out", "--photos", photo(tmp_path / "a.jpg", source=None))
    assert "has no time in its EXIF data" in said


def test_photo_of_another_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, tmp_path / "out", "--photos", photo(tmp_path / "a.jpg", size=(640, 480)))
    assert "640 x 480 px" in said and "1296 x 972" in said


def test_no_photos_at_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "holds no photos" in refused(capsys, tmp_path / "out", "--photos", tmp_path)
    assert "there is no photo file" in refused(capsys, tmp_path / "out", "--photos", tmp_path / "none")


def test_map_without_georeference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.new("RGB", (64, 64)).save(tmp_path / "map.png")
    assert "no georeference" in refused(capsys, tmp_path / "out", "--map", tmp_path / "map.png")


def test_map_that_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "does not exist" in refused(capsys, tmp_path / "out", "--map", tmp_path / "map.tif")


def test_map_of_another_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.tif"
    profile: dict[str, Any] = {"driver": "GTiff", "width": 64, "height": 64, "count": 3, "dtype": "uint8"}
    with rasterio.open(
        path, "w", crs="EPSG:4326", transform=Affine(0.01, 0.0, 2.0, 0.0, -0.01, 49.0), **profile
    ) as data:
        data.write(np.full((3, 64, 64), 90, np.uint8))
    said = refused(capsys, tmp_path / "out", "--map", path)
    assert "covers nothing within sight" in said and "39.3 deg N 46.8 deg E" in said


def test_elements_that_are_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tle.txt").write_text(TLE.read_text().replace("51.6420", "51.6421"))
    assert "checksum of line 2" in refused(capsys, tmp_path / "out", "--tle", tmp_path / "tle.txt")


def test_elements_that_are_too_old(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    late = photo(tmp_path / "a.jpg", stamp="2023:06:05 03:28:50")
    assert "days older than the photos" in refused(capsys, tmp_path / "out", "--photos", late)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"focal_px": [-1040.0, 1040.0]}, "focal_px"),
        ({"focal_px": [1040.0]}, "shape (1,)"),
        ({"focal_px": "long"}, "focal_px"),
        ({"width_px": 0}, "width_px"),
        ({"center_px": [5000.0, 485.5]}, "outside an image"),
        ({"distortion": [0.0] * 4}, "shape (4,)"),
        ({"zoom": 2}, "zoom"),
    ],
)
def test_camera_with_a_bad_value(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], words: str
) -> None:
    (tmp_path / "lens.json").write_text(json.dumps({**CAMERA, **changes}))
    said = refused(capsys, tmp_path / "out", "--camera", tmp_path / "lens.json")
    assert words in said and "lens.json" in said


@pytest.mark.parametrize("text", ['{"width_px": NaN}', "", "{", "\x80"])
def test_camera_that_is_no_json(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    (tmp_path / "lens.json").write_bytes(text.encode("latin-1"))
    assert "no valid JSON" in refused(capsys, tmp_path / "out", "--camera", tmp_path / "lens.json")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"dcm_CO": [[1.0, 0.0, 0.0]] * 3}, "no rotation matrix"),
        ({"dcm_CO": [[1.0, 0.0], [0.0, 1.0]]}, "dcm_CB"),
        ({"sigma_focal_px": -1.0}, "sigma_focal_px"),
        ({"sigma_mounting_rad": [0.0, 0.1, 0.1]}, "sigma_mounting"),
        ({"shutter_period_s": -12.0}, "shutter_period_s"),
        ({"camera": CAMERA | {"height_px": -3}}, "height_px"),
    ],
)
def test_calibration_with_a_bad_value(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], words: str
) -> None:
    (tmp_path / "cal.json").write_text(json.dumps({**CALIBRATION, **changes}))
    said = refused(capsys, tmp_path / "out", "--calibration", tmp_path / "cal.json")
    assert words in said and "cal.json" in said


def test_out_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert main(["--photos", str(PHOTOS[0]), "--out", str(out)]) == 2
        said = capsys.readouterr().err
        assert "cannot be written" in said and said.count("\n") == 1
    assert (tmp_path / "file").read_text() == "mine"


def write_and_fail(out: Path, error: BaseException) -> None:
    with output_folder(out) as folder:
        (folder / "a.txt").write_text("new")
        raise error


def test_full_disk_leaves_the_old_results(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with output_folder(out) as folder:
        (folder / "a.txt").write_text("old")
    with pytest.raises(BadInputError, match="No space left"):
        write_and_fail(out, OSError(errno.ENOSPC, "No space left on device"))
    assert [p.name for p in tmp_path.iterdir()] == ["out"] and (out / "a.txt").read_text() == "old"


def test_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        write_and_fail(tmp_path / "out", KeyboardInterrupt())
    assert not list(tmp_path.iterdir())


def test_new_results_replace_old_ones_and_keep_other_files(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "overlays").mkdir(parents=True)
    (out / "overlays" / "stale.jpg").write_text("old")
    (out / "mine.txt").write_text("mine")
    (out / "a.txt").write_text("old")
    with output_folder(out) as folder:
        (folder / "a.txt").write_text("new")
        (folder / "overlays").mkdir()
        (folder / "overlays" / "fresh.jpg").write_text("new")
    assert (out / "a.txt").read_text() == "new" and (out / "mine.txt").read_text() == "mine"
    assert [p.name for p in (out / "overlays").iterdir()] == ["fresh.jpg"]
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_debug_shows_the_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--tle", str(tmp_path / "none.txt"), "--debug", "--out", str(tmp_path / "out")]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_unknown_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--fotos", "x"])
    assert stop.value.code == 2 and "--fotos" in capsys.readouterr().err


def test_help_has_an_example_and_the_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    text = capsys.readouterr().out
    assert stop.value.code == 0
    for word in ("--photos", "--map", "--dem", "--tle", "--camera", "--calibration", "--out", "examples", "exit code"):
        assert word in text


def test_one_bad_photo_among_good_ones_is_left_out(tmp_path: Path) -> None:
    shutil.copy(PHOTOS[0], tmp_path)
    (tmp_path / "a.jpg").write_text("text")
    photo(tmp_path / "b.jpg", stamp="2023:05:05 04:28:50")
    inputs = read_inputs(parse(["--photos", str(tmp_path)]))
    assert [p.path.name for p in inputs.photos] == [PHOTOS[0].name]
    reasons = {Path(k).name: v for k, v in inputs.refused.items()}
    assert "it is no image" in reasons["a.jpg"] and "covers nothing within sight" in reasons["b.jpg"]


def test_calibration_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "cal.json").write_text(json.dumps(CALIBRATION))
    first = read_calibration(tmp_path / "cal.json")
    (tmp_path / "again.json").write_bytes(calibration_json(*first, "note"))
    second = read_calibration(tmp_path / "again.json")
    np.testing.assert_array_equal(first[0].dcm_CB, second[0].dcm_CB)
    np.testing.assert_array_equal(first[0].distortion, second[0].distortion)
    np.testing.assert_array_equal(first[1].sigma_common_H, second[1].sigma_common_H)
    assert first[2] == second[2]
    without = json.loads((tmp_path / "cal.json").read_text()) | {"shutter_period_s": None}
    (tmp_path / "cal.json").write_text(json.dumps(without))
    assert read_calibration(tmp_path / "cal.json")[2] is None


def test_shipped_camera_file_is_valid() -> None:
    assert read_camera(parse([]).camera).width_px == 1296
