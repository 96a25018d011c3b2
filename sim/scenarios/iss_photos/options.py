"""What a person can ask for on the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import msgspec

DATA = Path(__file__).resolve().parents[2] / "data"

_DESCRIPTION = """\
Finds where the International Space Station was, and how it was turned, from photos of the Earth taken through its
window. Without options it uses ten photos that come with the program. Each photo becomes a position and an attitude by
comparing it with a map; lens and mounting of the camera are calibrated from the photos themselves and the approximate
orbit.
"""

_EPILOG = """\
examples
  the ten photos that come with the program (about a minute; results in out/iss_photos):
    python -m sim.scenarios.iss_photos

  your own photos of the same camera, with the calibration just made:
    python -m sim.scenarios.iss_photos --photos my_photos --calibration out/iss_photos/calibration.json --out out/mine

  your own photos of another place and day: a map of it (any GeoTIFF), elements of that day, your lens:
    python -m sim.scenarios.iss_photos --photos my_photos --map fine.tif coarse.tif --dem heights.tif --tle day.txt \\
        --camera lens.json --out out/mine

camera file: JSON with width_px, height_px, focal_px [x, y], center_px [x, y], distortion [k1, k2, p1, p2, k3].
exit code: 0 a result, 1 no photo could be located, 2 something given cannot be used (one sentence says what).
"""


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """The command line, parsed.

    Attributes:
        photos: folder of photos, or photo files. maps: map files, fine to coarse. dem: heights. tle: two-line elements.
        camera: lens to begin with. calibration: of an earlier run, or None. out: folder of the results.
        shift_study: also show how far the fixes follow a shifted orbit. debug: show tracebacks.
    """

    photos: tuple[Path, ...]
    maps: tuple[Path, ...]
    dem: Path | None
    tle: Path
    camera: Path
    calibration: Path | None
    out: Path
    shift_study: bool
    debug: bool


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sim.scenarios.iss_photos",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "--photos",
        metavar="DIR",
        nargs="+",
        type=Path,
        default=[DATA / "iss_photos"],
        help="folder with photos (jpg, png, tif) that have the time in their EXIF data, or the photo files themselves",
    )
    add(
        "--map",
        metavar="FILE",
        nargs="+",
        type=Path,
        default=[DATA / "earth" / "blue_marble_z8_caspian.tif"],
        help="georeferenced pictures of the ground (GeoTIFF and others), the finest first",
    )
    add(
        "--dem",
        metavar="FILE",
        type=Path,
        default=DATA / "earth" / "nasa_topography_2048x1024.png",
        help="georeferenced heights in metres; 'none' takes height 0 everywhere",
    )
    add(
        "--tle",
        metavar="FILE",
        type=Path,
        default=DATA / "orbits" / "iss_tle_2023-05-03.txt",
        help="two-line elements of the station, at most ten days from the photos",
    )
    add(
        "--camera",
        metavar="FILE",
        type=Path,
        default=Path(__file__).with_name("camera.json"),
        help="the lens to begin with (JSON, see below); the focal length may be wrong by some per cent",
    )
    add(
        "--calibration",
        metavar="FILE",
        type=Path,
        help="calibration.json of an earlier run: use its lens and mounting, and estimate none from these photos",
    )
    add(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("out") / "iss_photos",
        help="folder for the results (out/iss_photos)",
    )
    add(
        "--shift-study",
        action="store_true",
        help="also show how far the fixes follow an orbit shifted by 5, 10 and 20 km",
    )
    add("--debug", action="store_true", help="show the Python traceback of an error")
    return parser


def parse(arguments: Sequence[str] | None = None) -> Options:
    """Parse the command line; argparse ends the program with code 2 and a sentence if it cannot."""
    given = _parser().parse_args(arguments)
    return Options(
        photos=tuple(given.photos),
        maps=tuple(given.map),
        dem=None if str(given.dem).lower() == "none" else given.dem,
        tle=given.tle,
        camera=given.camera,
        calibration=given.calibration,
        out=given.out,
        shift_study=given.shift_study,
        debug=given.debug,
    )
