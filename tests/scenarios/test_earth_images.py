"""The scenario of the Earth camera's effects, small, and its command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fsw.math.geodesy import geodetic_from_ecef
from sim.camera.earth_camera import Pose
from sim.scenarios.earth_images import build
from sim.scenarios.earth_images.graph import viewpoint
from sim.scenarios.earth_images.run import main
from sim.scenarios.earth_images.scenes import DATA, SCENES, Scene, effects
from tests.sim.camera.earth_rig import camera, ecef, project_cv


@pytest.mark.parametrize("off", [0.0, 30.0, 60.0])
def test_camera_looks_at_the_place(off: float) -> None:
    """From the height and at the angle that were asked for, with the azimuth up in the picture."""
    scene = Scene("a", "a", (), None, 48.0, 3.0, 420.0, 1000.0, 4000.0, (0.0, 0.0), "", off, 90.0)
    r, dcm_CE = viewpoint(scene)
    lat, lon, h = geodetic_from_ecef(float(r[0]), float(r[1]), float(r[2]))
    assert h == pytest.approx(420e3, abs=300.0)
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    assert np.degrees(np.arccos(-dcm_CE[2] @ up)) == pytest.approx(off, abs=0.2)
    pose, cam = Pose(r[None], dcm_CE[None], np.eye(3)[None]), camera(1000.0)
    middle, east = project_cv(ecef([48.0, 48.0], [3.0, 3.1]), pose, cam)
    np.testing.assert_allclose(middle, 255.5, atol=1e-6)
    assert east[1] < middle[1] - 2.0 and abs(east[0] - middle[0]) < 1.0


def test_one_picture_shows_the_pyramids_region() -> None:
    """Through the simulation: the Nile's green is darker than the desert west of it."""
    one = build(SCENES["cairo"], effects(SCENES["cairo"])[10], 128)
    one.sim.run_until(0)
    message = one.eye.out_image.latest()
    assert message is not None
    image = message.image.astype(float)
    assert image[20:40, 60:80].mean() + 30.0 < image[70:110, 20:40].mean()


@pytest.mark.slow
def test_all_pictures_of_all_scenes(tmp_path: Path) -> None:
    assert main(["--size", "96", "--out", str(tmp_path)]) == 0
    names = {p.stem for p in tmp_path.glob("*.png")}
    assert names == {"overview", *(f"{s.name}_{e.name}" for s in SCENES.values() for e in effects(s))}
    for path in tmp_path.glob("*_*.png"):
        picture = np.asarray(Image.open(path))[20:]
        assert picture.std() > 3.0, path.name


def test_a_map_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    landsat = DATA / "landsat" / "landsat8_itaipu_20200518_rgb.tif"
    place = [
        "--map",
        str(landsat),
        "--lat",
        "-25.36",
        "--lon",
        "-54.55",
        "--time",
        "2020-05-18T13:30:00Z",
        "--focal",
        "9000",
    ]
    assert (
        main([*place, "--time", "2020-05-18T13:30:00Z", "--size", "32", "--off-nadir", "20", "--out", str(tmp_path)])
        == 0
    )
    assert "own_03_haze.png" in capsys.readouterr().out
    assert np.asarray(Image.open(tmp_path / "own_01_map.png"))[20:].std() > 5.0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--lat", "1"], "--map, --lat and --lon belong together"),
        (["--map", "x.tif", "--lat", "1", "--lon", "1", "--scene", "paris"], "leave it out with --map"),
        (["--size", "4"], "expected 16 to 8192 pixels, got 4"),
        (["--off-nadir", "200"], "expected 0 to 180 degrees"),
        (["--height", "-3"], "--height: expected a number above 0, got -3"),
    ],
)
def test_wrong_options(arguments: list[str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--map", "nowhere.tif", "--lat", "1", "--lon", "1"], "map file nowhere.tif does not exist"),
        (["--scene", "itaipu", "--time", "yesterday"], "yesterday"),
    ],
)
def test_wrong_files_and_times(
    arguments: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--size", "16", "--out", str(tmp_path)]) == 1
    assert text in capsys.readouterr().err
