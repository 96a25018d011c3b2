"""The commands ``fsw features``, ``fsw catalogue`` and ``fsw geolocate`` on a made-up region, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

from fsw.imaging.maps import GeoMap
from fsw.tools.cli import main
from messages.base import F64
from modules.opnav.landmark_finder import render_view
from tests.modules.opnav import synthetic_ground as world

CV: Any = cv2


class Files(NamedTuple):
    folder: Path
    shot: world.Shot
    photo: str
    map: str
    dem: str
    camera: str
    catalogue: str


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder, ground, shot = tmp_path_factory.mktemp("photo"), world.region(), world.looking_down()
    names = [str(folder / n) for n in ("photo.png", "map.tif", "dem.tif", "camera.json", "marks.npz")]
    world.write_map(Path(names[1]), ground.texture, ground)
    world.write_map(Path(names[2]), ground.heights.astype(np.float32), ground)
    maps = GeoMap.open([names[1]], names[2])
    CV.imwrite(names[0], render_view(maps, world.lens_of(shot), shot.shape, shot.r_CE_E, shot.dcm_CE).image)
    (rows, columns), k = shot.shape, shot.k
    lens = {"focal_px": [k[0, 0], k[1, 1]], "center_px": k[:2, 2].tolist(), "distortion": shot.distortion.tolist()}
    Path(names[3]).write_text(json.dumps({"width_px": columns, "height_px": rows, **lens}))
    assert main(["catalogue", names[1], "--dem", names[2], "--levels", "2", "-o", names[4]]) == 0
    return Files(folder, shot, *names)


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(list(arguments))
    out = capsys.readouterr()
    return code, out.out, out.err


def test_photo_is_located(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    """From a place 20 km off and any heading; the truth is the photo's own pose, and OpenCV projects corners back."""
    picture = files.folder / "located.png"
    place = ["--lat", "36.1", "--lon", "52.2", "--height", "430"]
    start = ["geolocate", files.photo, "--map", files.catalogue, "--camera", files.camera, *place]
    code, out, _ = said(capsys, *start, "--json", "--overlay", str(picture))
    assert code == 0
    made = json.loads(out)
    assert np.linalg.norm(np.array(made["r_ecef_m"]) - files.shot.r_CE_E) < 500.0
    assert made["lat_deg"] == pytest.approx(world.LAT, abs=0.01)
    assert made["height_m"] == pytest.approx(420e3, abs=500.0)
    assert made["landmarks"] >= 12 and 0.0 < made["sigma_px"] < 0.5 and made["sigma_position_m"] < 1e3
    corners = np.array([made["ground"][n] for n in ("center", "top_left", "bottom_right")])
    pixel = world.pixels_of(files.shot, world.positions(corners[:, 0], corners[:, 1], np.zeros(3)))
    assert np.allclose(pixel, [[159.5, 119.5], [0.0, 0.0], [319.0, 239.0]], atol=0.5)
    drawn = CV.imread(str(picture))
    assert drawn.shape == (240, 320, 3) and (drawn[..., 1] > drawn[..., 2]).sum() > 200
    code, out, _ = said(capsys, *start)
    assert code == 0 and "landmarks of" in out and "camera     36.00" in out and "bottom left" in out


def test_another_photo_is_not(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    mirrored = files.folder / "mirrored.png"
    CV.imwrite(str(mirrored), CV.imread(files.photo)[:, ::-1])
    start = ["geolocate", str(mirrored), "--map", files.catalogue, "--camera", files.camera, "--height", "420"]
    code, out, _ = said(capsys, *start)
    assert code == 1 and "not located" in out
    code, out, _ = said(capsys, *start, "--json")
    assert code == 1 and json.loads(out) == {"located": False}


def test_features_are_counted_and_drawn(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    picture = files.folder / "features.png"
    for detector in ("sift", "surf", "orb"):
        arguments = ["features", files.photo, "--detector", detector, "--limit", "150", "--overlay", str(picture)]
        code, out, _ = said(capsys, *arguments, "--json")
        made = json.loads(out)
        assert code == 0 and made["count"] == len(made["features"]) and 50 < made["count"] <= 150
        places: F64 = np.array([f["place_px"] for f in made["features"]])
        assert (places > -0.5).all() and (places < [319.5, 239.5]).all()
        assert CV.imread(str(picture)).shape == (240, 320, 3)
        code, out, _ = said(capsys, *arguments)
        assert code == 0 and f"{made['count']} features by {detector}" in out
    flat = files.folder / "flat.png"
    CV.imwrite(str(flat), np.full((80, 90), 77, np.uint8))
    assert said(capsys, "features", str(flat))[0] == 1
    deep = files.folder / "deep.tif"
    CV.imwrite(str(deep), CV.imread(files.photo, 0).astype(np.uint16) * 200)
    code, out, _ = said(capsys, "features", str(deep), "--limit", "150", "--json")
    assert code == 0 and json.loads(out)["count"] > 50


def test_what_cannot_be_used_is_said(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and one sentence."""
    no_map, tiny, broken = (files.folder / n for n in ("plain.tif", "tiny.png", "broken.png"))
    CV.imwrite(str(no_map), np.zeros((80, 80), np.uint8))
    CV.imwrite(str(tiny), np.zeros((8, 8), np.uint8))
    broken.write_bytes(Path(files.photo).read_bytes()[:900])
    other = files.folder / "other.json"
    other.write_text('{"width_px": 10, "height_px": 10, "focal_px": [9, 9], "center_px": [4.5, 4.5]}')
    empty = files.folder / "empty.json"
    empty.write_text("{}")
    located = ["geolocate", files.photo, "--map", files.catalogue, "--fov", "64"]
    cases = [
        (["geolocate", str(broken), *located[2:]], "damaged"),
        (["geolocate", str(tiny), *located[2:]], "too few"),
        (["geolocate", "missing.png", *located[2:]], "no such file"),
        (["geolocate", files.photo, "--map", str(no_map), "--fov", "64"], "no georeference"),
        (["geolocate", files.photo, "--map", "missing.tif", "--fov", "64"], "does not exist"),
        (["geolocate", files.photo, "--map", "missing.npz", "--fov", "64"], "does not exist"),
        (["geolocate", files.photo, "--map", files.map, "--dem", str(no_map), "--fov", "64"], "no georeference"),
        ([*located, "--dem", files.dem], "stands alone"),
        ([*located[:4], "--fov", "0"], "--fov"),
        ([*located[:4], "--camera", str(other)], "320 x 240 pixels"),
        ([*located[:4], "--camera", str(empty)], "lacks"),
        ([*located, "--lat", "30"], "--lat and --lon"),
        ([*located, "--lat", "95", "--lon", "0"], "on the Earth"),
        ([*located, "--height", "-3"], "--height"),
        ([*located, "--tle", files.photo], "--utc"),
        ([*located, "--tle", files.camera, "--utc", "2023-05-05T03:28:50"], "two-line elements"),
        ([*located, "--tle", files.camera, "--utc", "noon"], "--utc"),
        (["features", files.photo, "--detector", "eye"], "detector"),
        (["features", files.photo, "--limit", "0"], "limit"),
        (["catalogue", str(no_map), "-o", str(files.folder / "x.npz")], "no georeference"),
        (["catalogue", files.map, "-o", str(files.folder / "x.npz"), "--region", "0", "0", "1", "1"], "no texture"),
    ]
    for arguments, words in cases:
        code, _, err = said(capsys, *arguments)
        assert (code, words in err, err.strip().count("\n")) == (2, True, 0), (arguments, err)
