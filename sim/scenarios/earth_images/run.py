"""The scenario as a program."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

from PIL import Image

from fsw.imaging.maps import GeoMap, MapError
from fsw.simulation import ModuleError
from sim.scenarios.earth_images.graph import build
from sim.scenarios.earth_images.scenes import GLOBE, SCENES, Scene, effects, with_effect
from sim.scenarios.earth_images.sheet import contact_sheet, titled

OUT = Path("out/earth_images")
"""Folder of the pictures unless told otherwise."""
SMALL_PX = 330
"""Width of a picture on the sheet."""


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Options of the command line; a wrong one ends the program with a sentence."""
    parser = argparse.ArgumentParser(
        prog="python -m sim.scenarios.earth_images",
        description="Pictures of the Earth from orbit that show every effect of the camera one by one: Paris, Cairo "
        "with the pyramids, the Landsat scene of Itaipu; or a place and maps of your own.",
    )
    parser.add_argument("--out", type=Path, default=OUT, metavar="DIR", help=f"folder for the pictures (default {OUT})")
    parser.add_argument(
        "--scene", choices=SCENES, action="append", help="only this scene; may be repeated (default: all three)"
    )
    parser.add_argument("--size", type=int, default=1024, metavar="PX", help="rows and columns (default 1024)")
    own = parser.add_argument_group(
        "a place of your own",
        "With --map, --lat and --lon the pictures are of that place. What you leave out is as over Paris.",
    )
    own.add_argument(
        "--map", type=Path, action="append", metavar="FILE",
        help="georeferenced raster (GeoTIFF, COG, JPEG 2000, ...); repeat it, fine to coarse; the globe follows",
    )  # fmt: skip
    own.add_argument("--dem", type=Path, metavar="FILE", help="heights in m, a georeferenced raster, north-up")
    own.add_argument("--lat", type=float, metavar="DEG", help="latitude in the middle of the picture")
    own.add_argument("--lon", type=float, metavar="DEG", help="longitude in the middle of the picture")
    own.add_argument("--height", type=float, metavar="KM", help="height of the camera above the ellipsoid")
    own.add_argument("--off-nadir", type=float, metavar="DEG", help="angle between the camera's axis and the vertical")
    own.add_argument("--azimuth", type=float, metavar="DEG", help="direction in which it looks, from north to east")
    own.add_argument("--focal", type=float, metavar="PX", help="focal length for a picture of 1024 pixels")
    own.add_argument("--time", metavar="UTC", help="such as 2023-06-21T10:30:00Z; says where the Sun is")
    own.add_argument("--brightness", type=float, help="radiance of white ground below the Sun; 1 saturates")
    given = parser.parse_args(arguments)
    if not 16 <= given.size <= 8192:
        parser.error(f"--size: expected 16 to 8192 pixels, got {given.size}")
    if len({given.map is None, given.lat is None, given.lon is None}) > 1:
        parser.error("--map, --lat and --lon belong together: give all three for a place of your own")
    if given.map is not None and given.scene:
        parser.error("--scene is for the shipped scenes; leave it out with --map")
    if given.off_nadir is not None and not 0.0 <= given.off_nadir <= 180.0:
        parser.error(f"--off-nadir: expected 0 to 180 degrees, got {given.off_nadir:g}")
    for name in ("height", "focal", "brightness"):
        value = getattr(given, name)
        if value is not None and not value > 0.0:
            parser.error(f"--{name}: expected a number above 0, got {value:g}")
    return given


def chosen(given: argparse.Namespace) -> list[Scene]:
    """The scenes that the options ask for."""
    names = {
        "height": "height_km", "off_nadir": "off_deg", "azimuth": "azimuth_deg", "focal": "focal_px", "time": "utc",
        "brightness": "brightness",
    }  # fmt: skip
    changes = {field: getattr(given, name) for name, field in names.items() if getattr(given, name) is not None}
    if given.map is None:
        return [replace(SCENES[n], **changes) for n in dict.fromkeys(given.scene or SCENES)]
    place = {"lat_deg": given.lat, "lon_deg": given.lon, "zoom_deg": (given.lat, given.lon), "dem": given.dem}
    own = replace(SCENES["paris"], name="own", title=given.map[0].stem, files=(*given.map, GLOBE), **place, **changes)
    return [replace(own, zoom_px=4.0 * own.focal_px)]


def pictures(scene: Scene, size_px: int, out: Path) -> list[Image.Image]:
    """Make, save and return the pictures of a scene.

    Raises:
        MapError: if a map cannot be used.
        ValueError: if the place or the time is none.
    """
    made: list[Image.Image] = []
    maps = {dem: GeoMap.open(scene.files, dem) for dem in {None, scene.dem}}
    for effect in effects(scene):
        if effect.terrain and scene.dem is None:
            effect = replace(effect, title=f"{effect.title} (no height file)")  # noqa: PLW2901 -- its title is all that changes
        one = build(scene, effect, size_px, maps=maps[with_effect(scene, effect).dem])
        begin = time.perf_counter()
        try:
            one.sim.run_until(0)
        except ModuleError as error:
            if isinstance(error.__cause__, (MapError, ValueError)):
                raise error.__cause__ from error
            raise
        message = one.eye.out_image.latest()
        assert message is not None, "every input was written"
        image = titled(message.image, f"{scene.title}: {effect.title}")
        path = out / f"{scene.name}_{effect.name}.png"
        image.save(path)
        print(f"{path}  {time.perf_counter() - begin:6.2f} s, with reading of maps and detector")
        made.append(image)
    return made


def main(arguments: list[str] | None = None) -> int:
    """Run the scenario; returns the exit code."""
    given = parse(arguments)
    try:
        given.out.mkdir(parents=True, exist_ok=True)
        rows = [pictures(scene, given.size, given.out) for scene in chosen(given)]
        contact_sheet(rows, min(SMALL_PX, given.size), given.out / "overview.png")
    except (MapError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except OSError as error:
        sys.stderr.write(f"cannot write to {given.out}: {error.strerror}; choose another folder with --out\n")
        return 1
    print(f"{given.out / 'overview.png'}  all of them")
    return 0
