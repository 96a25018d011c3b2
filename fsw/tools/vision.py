"""``fsw features``, ``fsw catalogue`` and ``fsw geolocate``: what is seen in an image, and from where."""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw.tools.limb import read_image
from messages.opnav import CameraConfigMsg

FEATURES, CATALOGUE, LOCATE = (
    "modules.opnav.features",
    "modules.opnav.landmark_catalogue",
    "modules.opnav.earth_tracker.geolocate",
)
"""Loaded by name when a command runs: the framework does not import flight code."""
PHOTO = "sim/data/iss_photos/iss_20230505T033039.jpg"
MAP = "sim/data/earth/blue_marble_z8_caspian.tif"
FEATURES_EXAMPLE = f"features {PHOTO} --detector surf --overlay features.png"
CATALOGUE_EXAMPLE = f"catalogue {MAP} -o caspian.npz"
LOCATE_EXAMPLE = f"geolocate {PHOTO} --map {MAP} --fov 64 --lat 34.9 --lon 53.1 --height 423"


def features_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``fsw features``."""
    made.add_argument("image", type=Path, metavar="IMAGE", help="PNG, TIFF, JPEG or the like, 8 or 16 bit")
    made.add_argument("--detector", default="sift", metavar="NAME", help="sift (the default), surf or orb")
    made.add_argument("--limit", type=int, default=2000, metavar="N", help="features at most; default: 2000")
    made.add_argument("--json", action="store_true", help="print JSON, with place, size, angle and strength of each")
    made.add_argument("--overlay", type=Path, metavar="FILE", help="draw them, as PNG")


def catalogue_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``fsw catalogue``."""
    made.add_argument("map", type=Path, nargs="+", metavar="MAP", help="georeferenced rasters, the finest first")
    made.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="the catalogue, .npz")
    made.add_argument("--dem", type=Path, metavar="FILE", help="heights, a georeferenced raster; none: sea level")
    made.add_argument("--gsd", type=float, metavar="M", help="pixel of the finest chips; default: the map's")
    made.add_argument(
        "--levels", type=int, default=4, metavar="N", help="sizes of chips, each twice the last; default: 4"
    )
    made.add_argument("--detector", default="sift", metavar="NAME", help="of features for cold starts; default: sift")
    made.add_argument(
        "--region",
        type=float,
        nargs=4,
        metavar=("SOUTH", "WEST", "NORTH", "EAST"),
        help="degrees; default: all of the finest map",
    )


def locate_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``fsw geolocate``."""
    made.description = (
        "Find where a photo of the Earth was taken, by the landmarks in it. Without a\n"
        "place, the camera is taken to be over the middle of the map, looking down.\n"
        "The exit code is 1 if nothing is sure. The landmarks of a map are kept in the\n"
        "user's cache folder (or FSW_CACHE_DIR) and are made again if its content changes."
    )
    made.add_argument("photo", type=Path, metavar="PHOTO", help="PNG, TIFF, JPEG or the like, 8 or 16 bit")
    made.add_argument(
        "--map",
        type=Path,
        nargs="+",
        required=True,
        metavar="MAP",
        help="georeferenced rasters, the finest first; or a catalogue (.npz, quicker)",
    )
    made.add_argument("--dem", type=Path, metavar="FILE", help="heights, a georeferenced raster; none: sea level")
    lens = made.add_mutually_exclusive_group(required=True)
    lens.add_argument(
        "--camera", type=Path, metavar="FILE", help="JSON with width_px, height_px, focal_px, center_px, distortion"
    )
    lens.add_argument("--fov", type=float, metavar="DEG", help="instead: field of view, from left to right")
    made.add_argument("--lat", type=float, metavar="DEG", help="of the camera, to 50 km or so")
    made.add_argument("--lon", type=float, metavar="DEG", help="of the camera")
    made.add_argument("--height", type=float, metavar="KM", help="of the camera")
    made.add_argument("--heading", type=float, metavar="DEG", help="azimuth of the top of the photo; default: any")
    made.add_argument(
        "--accuracy", type=float, default=5.0, metavar="DEG", help="sigma of boresight and heading; default: 5"
    )
    made.add_argument("--tle", type=Path, metavar="FILE", help="instead of a place: two-line elements")
    made.add_argument("--utc", metavar="TIME", help="with --tle: such as 2023-05-05T03:28:50")
    made.add_argument("--json", action="store_true", help="print JSON")
    made.add_argument("--overlay", type=Path, metavar="FILE", help="draw landmarks, grid and map, as PNG")


def grey_image(path: Path) -> NDArray[np.uint8]:
    """An image file as 8-bit grey (rows, columns); deeper ones are stretched between their 0.1 and 99.9 per cent.

    Raises:
        ValueError: as `read_image`, or if it is smaller than 64 x 64 pixels.
    """
    image = read_image(path)
    if min(image.shape[:2]) < 64:
        raise ValueError(f"{path}: {image.shape[1]} x {image.shape[0]} pixels are too few; give 64 x 64 or more")
    values: NDArray[Any] = image
    if image.ndim == 3:
        weights = np.array([0.299, 0.587, 0.114]) if image.shape[2] >= 3 else np.array([1.0])
        values = image[..., : len(weights)].astype(np.float64) @ weights
    if image.dtype == np.uint8:
        return np.rint(values).astype(np.uint8)
    low, high = np.percentile(values, [0.1, 99.9])
    return np.clip(np.rint((values - low) * (255.0 / max(float(high - low), 1e-9))), 0, 255).astype(np.uint8)


def save(path: Path, canvas: NDArray[np.uint8]) -> None:
    """Write a picture (blue, green, red) as PNG.

    Raises:
        ValueError: if it cannot be written.
    """
    import cv2

    library: Any = cv2
    data = library.imencode(".png", canvas)[1]
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror}); give another place for --overlay") from error


def features(args: argparse.Namespace) -> int:
    """Print the features of an image; the exit code is 1 if there is none.

    Raises:
        ValueError: if the image or an option cannot be used.
    """
    import cv2

    library: Any = cv2
    grey = grey_image(args.image)
    begun = time.perf_counter()
    found: Any = importlib.import_module(FEATURES).detect(args.detector, grey, None, args.limit)
    spent = time.perf_counter() - begun
    sizes = np.percentile(found.size_px, [0, 50, 100]).tolist() if len(found.size_px) else [math.nan] * 3
    made = {
        "detector": args.detector,
        "size_px": [grey.shape[1], grey.shape[0]],
        "count": len(found.size_px),
        "milliseconds": round(1e3 * spent, 1),
    }
    if args.json:
        parts = zip(found.place_px, found.size_px, found.angle, found.response, strict=True)
        rows = [{"place_px": p.tolist(), "size_px": s, "angle_rad": a, "response": r} for p, s, a, r in parts]
        sys.stdout.write(json.dumps({**made, "features": rows}, indent=2) + "\n")
    else:
        sys.stdout.write(
            f"{args.image}: {made['count']} features by {args.detector} in {made['milliseconds']:.0f} ms\n"
            f"  size     {sizes[0]:.1f} to {sizes[2]:.1f} px, median {sizes[1]:.1f} (sigma of the Gaussian)\n"
            f"  descriptor  {found.words.shape[1]} numbers, {found.words.dtype}\n"
        )
    if args.overlay is not None:
        canvas = library.cvtColor(grey, library.COLOR_GRAY2BGR)
        for (x, y), size, angle in zip(
            found.place_px.tolist(), found.size_px.tolist(), found.angle.tolist(), strict=True
        ):
            center, radius = (round(16 * x), round(16 * y)), max(2.0, 2.0 * size)
            tip = (round(16 * (x + radius * math.cos(angle))), round(16 * (y + radius * math.sin(angle))))
            library.circle(canvas, center, round(16 * radius), (80, 255, 80), 1, library.LINE_AA, 4)
            library.line(canvas, center, tip, (40, 140, 255), 1, library.LINE_AA, 4)
        save(args.overlay, canvas)
    return 0 if made["count"] else 1


def catalogue(args: argparse.Namespace) -> int:
    """Make a landmark catalogue from maps.

    Raises:
        ValueError: if a map or an option cannot be used.
    """
    from rich.console import Console
    from rich.progress import Progress

    from fsw.imaging.maps import GeoMap

    made: Any = importlib.import_module(CATALOGUE)
    region = None if args.region is None else made.Region(*np.radians(args.region).tolist())
    maps = GeoMap.open(args.map, args.dem)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("landmarks", total=1.0)

        def tick(share: float) -> None:
            progress.update(task, completed=share)

        kept = made.build_catalogue(
            maps,
            region,
            args.gsd,
            levels=args.levels,
            detector=args.detector,
            tick=tick,
        )
    digest = made.write_catalogue(kept, args.output)
    size = args.output.stat().st_size / 1e6
    sys.stdout.write(
        f"{args.output}: {len(kept)} landmarks, chips from {kept.gsd:.1f} m a pixel, "
        f"{len(kept.features.gsd)} features by {kept.detector}, {size:.1f} MB, sha256 {digest[:16]}\n"
    )
    return 0


def camera_of(args: argparse.Namespace, shape: tuple[int, ...]) -> CameraConfigMsg:
    """The camera of ``--camera`` or ``--fov``, checked against the size of the photo.

    Raises:
        ValueError: if it cannot be used.
    """
    rows, columns = shape
    if args.camera is None:
        if not 0.1 <= args.fov <= 150.0:
            raise ValueError(f"--fov: expected 0.1 to 150 degrees, got {args.fov:g}")
        focal = 0.5 * columns / math.tan(math.radians(0.5 * args.fov))
        center = np.array([columns - 1, rows - 1]) / 2.0
        return CameraConfigMsg(width_px=columns, height_px=rows, focal_px=np.full(2, focal), center_px=center)
    try:
        held = json.loads(args.camera.read_text(encoding="utf-8"))
        held = held.get("camera", held)  # a calibration holds the camera in an entry of its own
        arrays: dict[str, Any] = {
            n: np.array(held[n], float) for n in ("focal_px", "center_px", "distortion") if n in held
        }
        camera = CameraConfigMsg(width_px=held["width_px"], height_px=held["height_px"], **arrays)
    except OSError as error:
        raise ValueError(f"camera file {args.camera} cannot be read ({error.strerror})") from error
    except KeyError as error:
        raise ValueError(f"camera file {args.camera} lacks {error}; see --help for what it holds") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"camera file {args.camera} is not usable ({error}); see --help for what it holds") from error
    if (camera.height_px, camera.width_px) != (rows, columns):
        expected = f"{camera.width_px} x {camera.height_px}"
        raise ValueError(f"{args.photo} has {columns} x {rows} pixels, but the camera {expected}; give its own camera")
    return camera


def place_text(lat_deg: float, lon_deg: float) -> str:
    """Degrees with N or S, E or W."""
    return f"{abs(lat_deg):.4f} {'S' if lat_deg < 0 else 'N'}, {abs(lon_deg):.4f} {'W' if lon_deg < 0 else 'E'}"


def locate_text(photo: Path, made: dict[str, Any]) -> str:
    """The report for a person."""
    lines = [
        f"{photo}: {made['landmarks']} landmarks of {made['candidates']} candidates",
        f"  camera     {place_text(made['lat_deg'], made['lon_deg'])}, {made['height_m'] / 1e3:.2f} km",
        f"  sigma      {made['sigma_position_m'] / 1e3:.2f} km, if map and lens are right",
        f"  attitude   {made['off_nadir_deg']:.2f} deg off nadir, top towards azimuth {made['heading_deg']:.2f} deg",
        f"  matches    sigma {made['sigma_px']:.2f} px, rms of residuals {made['rms_px']:.2f} px",
    ]
    for name, place in made["ground"].items():
        seen = "no ground" if place is None else place_text(*place)
        lines.append(f"  {name.replace('_', ' '):<13}{seen}")
    return "\n".join(lines)


def geolocate(args: argparse.Namespace) -> int:
    """Find where a photo was taken; the exit code is 1 if nothing is sure.

    Raises:
        ValueError: if the photo, a map or an option cannot be used.
    """
    if (args.tle is None) != (args.utc is None):
        raise ValueError("--tle and --utc go together: elements give a position only at a time")
    if (args.lat is None) != (args.lon is None):
        raise ValueError("--lat and --lon go together; give both or none")
    if args.tle is not None and args.lat is not None:
        raise ValueError("--tle and --lat: expected one of the two, the position is either computed or given")
    if args.lat is not None and not (-90.0 <= args.lat <= 90.0 and -360.0 <= args.lon <= 360.0):
        raise ValueError(f"--lat, --lon: expected degrees on the Earth, got {args.lat:g} and {args.lon:g}")
    if args.height is not None and not 1.0 <= args.height <= 1e6:
        raise ValueError(f"--height: expected 1 to 1000000 km, got {args.height:g}")
    if not 0.01 <= args.accuracy <= 60.0:
        raise ValueError(f"--accuracy: expected 0.01 to 60 degrees, got {args.accuracy:g}")
    grey = grey_image(args.photo)
    camera = camera_of(args, grey.shape)
    action: Any = importlib.import_module(LOCATE)
    maps = action.open_maps(args.map, args.dem)
    angles = [None if v is None else math.radians(v) for v in (args.lat, args.lon, args.heading)]
    height = None if args.height is None else 1e3 * args.height
    tle = None if args.tle is None else (args.tle, args.utc)
    place = angles[0], angles[1], height
    guess = action.expected(camera, maps, place, angles[2], math.radians(args.accuracy), tle)
    found = action.locate(grey, camera, maps, guess)
    if found is None:
        text = json.dumps({"located": False}) if args.json else f"{args.photo}: not located; no landmarks that are sure"
        sys.stdout.write(text + "\n")
        return 1
    sys.stdout.write(
        (json.dumps(found.report, indent=2) if args.json else locate_text(args.photo, found.report)) + "\n"
    )
    if args.overlay is not None:
        save(args.overlay, action.draw(grey, camera, found.tracked, maps))
    return 0
