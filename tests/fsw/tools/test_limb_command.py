"""The command ``fsw limb``: numbers against the stored truth, exit codes, kinds of files, and the picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fsw.tools.cli import main

CV: Any = cv2
ROOT = Path(__file__).parents[3]
IMAGE = ROOT / "sim" / "data" / "cassini_limb" / "N1572472169_1.png"
"""Tethys and the rings: centre (568.39, 581.94), radius 31.11 px, good to 1 px."""


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(["limb", *arguments])
    out = capsys.readouterr()
    return code, out.out, out.err


def test_json_and_picture(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    picture = tmp_path / "limb.png"
    code, out, _ = said(capsys, str(IMAGE), "--json", "--points", "--overlay", str(picture))
    made = json.loads(out)
    assert code == 0 and made["valid"] is True and made["status"] == "found" and made["count"] == 1
    assert np.allclose([*made["center_px"], made["radius_px"]], [568.39, 581.94, 31.11], atol=1.0)
    assert made["ellipse"]["center"] == made["center_px"]
    long, short = made["ellipse"]["semi_axes"]
    assert long * short == pytest.approx(made["radius_px"] ** 2)
    # more than half of this limb is saturated, which hides up to a pixel of its place
    assert 0.0 < min(made["sigma"]["center_px"]) < 0.5
    assert 0.5 < max(*made["sigma"]["center_px"], made["sigma"]["radius_px"]) < 1.5
    assert made["arc_deg"] > 100 and made["points"] == len(made["limb"]) > 60
    assert np.array(made["limb"])[:, :2].max(axis=0).tolist() < [610, 620]
    assert made["disks"][0]["radius_px"] == made["radius_px"]
    drawn = CV.imread(str(picture))
    green = np.argwhere((drawn[..., 1] > 200) & (drawn[..., 0] < 150))
    assert drawn.shape == (1024, 1024, 3)
    assert abs(np.hypot(*(green - (581.94, 568.39)).T) - 31.11).max() < 4.0


def test_text(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = said(capsys, str(IMAGE), "--sun", "180")
    assert code == 0
    assert "1 disk (found)" in out and "centre   568." in out and "lit from 180 deg" in out


def test_no_disk(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    CV.imwrite(str(tmp_path / "black.png"), np.zeros((300, 300), np.uint8))
    code, out, _ = said(capsys, str(tmp_path / "black.png"), "--json")
    made = json.loads(out)
    assert code == 1 and made["valid"] is False and made["status"] == "no_edges" and "center_px" not in made
    code, out, _ = said(capsys, str(IMAGE), "--min-radius", "40")
    assert code == 1 and "0 disks" in out


@pytest.mark.parametrize("kind", ["grey 16.png", "colour.png", "colour 16.tif", "alpha.png", "float.tif", "jpeg.jpg"])
def test_kinds_of_files(kind: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grey = CV.imread(str(IMAGE), cv2.IMREAD_GRAYSCALE)
    made: Any = {
        "grey 16.png": grey.astype(np.uint16) * 200,
        "colour.png": np.repeat(grey[..., None], 3, axis=2),
        "colour 16.tif": np.repeat(grey[..., None], 3, axis=2).astype(np.uint16) * 200,
        "alpha.png": np.dstack([grey, grey, grey, np.full_like(grey, 255)]),
        "float.tif": grey.astype(np.float32) / 255.0,
        "jpeg.jpg": grey,
    }[kind]
    CV.imwrite(str(tmp_path / kind), made)
    code, out, _ = said(capsys, str(tmp_path / kind), "--json")
    found = json.loads(out)
    assert code == 0
    assert np.allclose([*found["center_px"], found["radius_px"]], [568.39, 581.94, 31.11], atol=1.0)


def test_bad_files_and_options(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    whole = IMAGE.read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.png").write_text("no image")
    (tmp_path / "empty.png").write_bytes(b"")
    CV.imwrite(str(tmp_path / "tiny.png"), np.zeros((8, 8), np.uint8))
    header = b"P5 60000 60000 255\n"
    (tmp_path / "huge.pgm").write_bytes(header + bytes(100))
    for name, words in (
        ("missing.png", "there is no such file"),
        ("cut.png", "damaged"),
        ("text.png", "not an image that can be read"),
        ("empty.png", "not an image that can be read"),
        ("tiny.png", "8 x 8 pixels are too few"),
        ("huge.pgm", "pixels are too many"),
    ):
        code, out, err = said(capsys, str(tmp_path / name))
        assert code == 2 and out == "" and words in err and name in err, (name, err)
    for options in (
        ("--min-radius", "0"),
        ("--min-radius", "50", "--max-radius", "20"),
        ("--min-arc", "400"),
        ("--most", "0"),
    ):
        code, _, err = said(capsys, str(IMAGE), *options)
        assert code == 2 and "expected" in err
    code, _, err = said(capsys, str(IMAGE), "--overlay", str(tmp_path / "no folder" / "x.png"))
    assert code == 2 and "cannot be written" in err
