"""What ``fsw catalogue``, ``fsw features`` and ``fsw geolocate`` make of other kinds of files; elements; the cache."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from fsw.math.geodesy import ecef_from_geodetic
from fsw.tools.cli import main
from messages.opnav import CameraConfigMsg
from modules.opnav.earth_tracker import geolocate
from modules.opnav.earth_tracker.ground import looking_down
from modules.opnav.landmark_catalogue import kept, read_catalogue
from modules.opnav.landmark_finder import render_view
from tests.modules.opnav import synthetic_ground as world

CV: Any = cv2
RASTERIO: Any = rasterio
SIM = Path(__file__).parents[3] / "sim" / "data"
CASPIAN = SIM / "earth" / "blue_marble_z8_caspian.tif"
GSD = "1400"


@pytest.fixture(scope="module")
def ground() -> world.Region:
    return world.region(pixels=256)


def write(path: Path, bands: NDArray[Any], ground: world.Region, **more: Any) -> Path:
    """A map (bands, rows, columns) of the region."""
    left, top = ground.lon_deg[0] - ground.pixel_deg / 2, ground.lat_deg[0] + ground.pixel_deg / 2
    place = RASTERIO.Affine(ground.pixel_deg, 0.0, left, 0.0, -ground.pixel_deg, top)
    count, rows, columns = bands.shape
    shape = {"height": rows, "width": columns, "count": count, "dtype": bands.dtype}
    with RASTERIO.open(path, "w", driver="GTiff", crs="EPSG:4326", transform=place, **shape, **more) as out:
        out.write(bands)
    return path


def marks(path: Path) -> Any:
    """The landmarks that ``fsw catalogue`` finds."""
    file = path.with_suffix(".npz")
    arguments = ["catalogue", str(path), "--gsd", GSD, "--levels", "1", "--detector", "orb", "-o", str(file)]
    assert main(arguments) == 0
    return read_catalogue(file).landmarks


def test_bands_depths_and_gaps(ground: world.Region, tmp_path: Path) -> None:
    """One, three and four bands, 16 bits, floats: the same landmarks; none where there is no data."""
    grey = ground.texture
    plain = marks(write(tmp_path / "grey.tif", grey[None], ground))
    assert len(plain.lat) > 20
    colour = marks(write(tmp_path / "colour.tif", np.stack([grey] * 3), ground))
    assert np.array_equal(colour.chips, plain.chips)
    for name, bands in (
        ("deep", (grey.astype(np.uint16) * 200 + 77)[None]),
        ("real", (grey / 255.0).astype(np.float32)[None]),
    ):
        found = marks(write(tmp_path / f"{name}.tif", bands, ground))
        same = np.linalg.norm(found.r_LE_E[:, None] - plain.r_LE_E, axis=2).min(axis=1) < 4.0 * float(GSD)
        assert same.mean() > 0.9
    half = grey.shape[1] // 2
    alpha = np.full(grey.shape, 255, np.uint8)
    alpha[:, half:] = 0
    holed = np.where(alpha > 0, np.maximum(grey, 1), 0)
    with_alpha = write(tmp_path / "alpha.tif", np.stack([grey] * 3 + [alpha]), ground, photometric="RGB", alpha="yes")
    for file in (with_alpha, write(tmp_path / "gap.tif", holed[None], ground, nodata=0)):
        found = marks(file)
        assert 5 < len(found.lat) < len(plain.lat)
        assert np.degrees(found.lon).max() < ground.lon_deg[half]


def test_damaged_and_tiny_maps_are_refused(
    ground: world.Region, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = write(tmp_path / "whole.tif", ground.texture[None], ground, compress="deflate")
    cut, junk = tmp_path / "cut.tif", tmp_path / "junk.tif"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    junk.write_bytes(bytes(range(256)) * 40)
    tiny = write(tmp_path / "tiny.tif", ground.texture[None, :8, :8], ground)
    void = write(tmp_path / "void.tif", np.zeros((1, 128, 128), np.uint8), ground, nodata=0)
    for file, words in ((cut, "cannot be read"), (junk, "cannot be read"), (tiny, "no texture"), (void, "no texture")):
        capsys.readouterr()
        assert main(["catalogue", str(file), "--levels", "1", "-o", str(tmp_path / "x.npz")]) == 2
        said = capsys.readouterr().err
        assert words in said and file.name in said + words + file.name and said.strip().count("\n") == 0
    assert not (tmp_path / "x.npz").exists()


def test_photos_of_other_kinds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Transparency, 16 bits and one band give the same features; a cut file is named."""
    grey = world.region(pixels=200).texture
    names = [tmp_path / n for n in ("plain.png", "alpha.png", "deep.png")]
    CV.imwrite(str(names[0]), grey)
    CV.imwrite(str(names[1]), np.dstack([grey, grey, grey, np.full_like(grey, 200)]))
    CV.imwrite(str(names[2]), grey.astype(np.uint16) * 256)
    counts: list[int] = []
    for name in names:
        capsys.readouterr()
        assert main(["features", str(name), "--limit", "5000", "--json"]) == 0
        counts.append(json.loads(capsys.readouterr().out)["count"])
    assert counts[1] == counts[0] > 50 and abs(counts[2] - counts[0]) < 0.1 * counts[0]
    cut = tmp_path / "cut.png"
    cut.write_bytes(names[0].read_bytes()[:2000])
    for command in (["features", str(cut)], ["geolocate", str(cut), "--map", str(CASPIAN), "--fov", "60"]):
        assert main(command) == 2
        assert "cut.png" in capsys.readouterr().err


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Caspian's south as the space station saw it at the last photo, 300 x 400 pixels, no lens distortion."""
    camera = CameraConfigMsg(
        width_px=400, height_px=300, focal_px=np.full(2, 320.0), center_px=np.array([199.5, 149.5])
    )
    r_CE_E, dcm_CE = looking_down(np.radians(34.8848), np.radians(53.1493), 423.45e3, np.radians(131.0))
    view = render_view(GeoMap.open([CASPIAN]), lens_vector(camera), (300, 400), r_CE_E, dcm_CE)
    file = tmp_path_factory.mktemp("station") / "photo.png"
    CV.imwrite(str(file), np.clip(0.8 * view.image + 20, 0, 255).astype(np.uint8))
    return file


def located(photo: Path, *more: str) -> list[str]:
    fov = str(2.0 * np.degrees(np.arctan(200.0 / 320.0)))
    return ["geolocate", str(photo), "--map", str(CASPIAN), "--fov", fov, *more]


@pytest.mark.slow
def test_place_by_two_line_elements(
    station: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The station's own elements, two days old, and the time of the photo; the heading is known to some degrees."""
    monkeypatch.setenv("FSW_CACHE_DIR", str(tmp_path))
    elements = ["--tle", str(SIM / "orbits" / "iss_tle_2023-05-03.txt"), "--utc", "2023-05-05T03:30:39"]
    picture = tmp_path / "found.png"
    arguments = located(station, *elements, "--heading", "128", "--json", "--overlay", str(picture))
    assert main(arguments) == 0
    made = json.loads(capsys.readouterr().out)
    truth = np.array(ecef_from_geodetic(np.radians(34.8848), np.radians(53.1493), 423.45e3))
    assert np.linalg.norm(np.array(made["r_ecef_m"]) - truth) < 2e3
    assert made["heading_deg"] == pytest.approx(131.0, abs=0.3)
    drawn = CV.imread(str(picture)).astype(int)
    for blue, green, red in (geolocate.GREEN, geolocate.RED, geolocate.ORANGE):
        assert (np.abs(drawn - [blue, green, red]).max(axis=2) < 60).sum() > 10

    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("made again")

    monkeypatch.setattr(kept, "build_catalogue", never)
    assert len(list((tmp_path / "catalogues").glob("*.npz"))) == 1
    assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out) == made
    wrong_time = [*elements[:3], "2023-05-05T02:30:39", "--heading", "128"]
    assert main(located(station, *wrong_time)) == 1
    assert "not located" in capsys.readouterr().out


def test_a_map_elsewhere_locates_nothing(station: Path, capsys: pytest.CaptureFixture[str]) -> None:
    over_paris = ["--lat", "48.5", "--lon", "2.0", "--height", "420"]
    assert main(located(station, *over_paris)) == 1
    assert "not located" in capsys.readouterr().out
