"""``fsw limb``: the disks of planets and moons in an image, as text, JSON, and a picture."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import math
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

EXAMPLE = "limb sim/data/cassini_limb/N1488823805_1.png --overlay limb.png"
FINDER = "modules.opnav.disks"
"""Loaded by name when the command runs: the framework does not import flight code."""
MAX_PIXELS = 120_000_000


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    made.add_argument("image", type=Path, metavar="IMAGE", help="PNG, TIFF, JPEG or the like, 8 or 16 bit")
    made.add_argument("--json", action="store_true", help="print JSON")
    made.add_argument("--overlay", type=Path, metavar="FILE", help="draw points, outlines and centres, as PNG")
    made.add_argument("--points", action="store_true", help="with --json: list the points too (column, row, sigma)")
    made.add_argument(
        "--sun",
        type=float,
        metavar="DEG",
        help="where the Sun stands, from right to down; default: found from the light",
    )
    made.add_argument("--min-radius", type=float, default=8.0, metavar="PX", help="least radius; default: 8")
    made.add_argument("--max-radius", type=float, default=4000.0, metavar="PX", help="greatest; default: 4000")
    made.add_argument("--min-arc", type=float, default=40.0, metavar="DEG", help="least limb to see; default: 40")
    made.add_argument("--most", type=int, default=10, metavar="N", help="disks at most; default: 10")


def read_image(path: Path) -> NDArray[Any]:
    """Pixels (rows, columns) or (rows, columns, 3 or 4) of an image file, colours in the order red, green, blue.

    Raises:
        ValueError: if the file is missing, no image, damaged, or too large.
    """
    import cv2
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise ValueError(f"{path}: there is no such file; give an image")
    many = f"pixels are too many; crop or reduce it below {MAX_PIXELS} pixels"
    library: Any = cv2
    image = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with contextlib.suppress(UnidentifiedImageError), Image.open(path) as header:
                if header.width * header.height > MAX_PIXELS:
                    raise ValueError(f"{path}: {header.width} x {header.height} {many}")
                header.load()  # says so if data are missing, which OpenCV may not
        image = library.imread(str(path), cv2.IMREAD_UNCHANGED)
    except Image.DecompressionBombError as error:
        raise ValueError(f"{path}: its {many}") from error
    except (OSError, SyntaxError, library.error) as error:
        raise ValueError(f"{path}: damaged ({str(error).strip()}); give a whole image") from error
    if image is None:
        raise ValueError(f"{path}: not an image that can be read; give a PNG, TIFF or JPEG")
    return image[..., [2, 1, 0]] if image.ndim == 3 and image.shape[2] >= 3 else image


def _entry(disk: Any, points: bool) -> dict[str, Any]:
    e, limb = disk.ellipse, disk.limb
    long, short = e.semi_axes
    sigma = np.sqrt(np.diag(disk.P))
    made: dict[str, Any] = {
        "center_px": [e.x, e.y],
        "radius_px": e.radius,
        "ellipse": {
            "fitted": disk.oval,
            "center": [e.x, e.y],
            "semi_axes": [long, short],
            "angle_deg": math.degrees(e.angle),
        },
        "sigma": {"center_px": sigma[:2].tolist(), "radius_px": float(sigma[2])},
        "covariance_px2": disk.P[:3, :3].tolist(),
        "arc_deg": round(math.degrees(disk.arc), 3),
        "points": len(limb.x),
        "rms_px": disk.rms,
        "sigma_point_px": float(np.median(limb.sigma)),
        "blur_px": limb.blur,
        "sun_deg": math.degrees(disk.light.azimuth) if disk.light.contrast >= 0.15 else None,
        "votes": disk.votes,
    }
    if points:
        made["limb"] = np.column_stack([limb.x, limb.y, limb.sigma]).round(4).tolist()
    return made


def report(status: str, size: tuple[int, int], disks: list[dict[str, Any]]) -> dict[str, Any]:
    """What ``--json`` prints: the first disk's fields at the top, and the list of all."""
    head: dict[str, Any] = {"valid": bool(disks), "status": status, "size_px": list(size), "count": len(disks)}
    return {**head, **(disks[0] if disks else {}), "disks": disks}


def text(image: Path, made: dict[str, Any]) -> str:
    """The same for a person."""
    lines = [f"{image}: {made['count']} disk{'s' * (made['count'] != 1)} ({made['status']})"]
    for n, disk in enumerate(made["disks"], 1):
        (x, y), (long, short) = disk["center_px"], disk["ellipse"]["semi_axes"]
        sx, sy = disk["sigma"]["center_px"]
        lines += [
            f"  disk {n}",
            f"    centre   {x:.2f}, {y:.2f} px  (column, row; sigma {sx:.2f}, {sy:.2f})",
            f"    radius   {disk['radius_px']:.2f} px  (sigma {disk['sigma']['radius_px']:.2f})",
        ]
        if disk["ellipse"]["fitted"]:
            lines.append(
                f"    ellipse  {long:.2f} x {short:.2f} px, long axis at {disk['ellipse']['angle_deg']:.1f} deg"
            )
        sun = "all round" if disk["sun_deg"] is None else f"lit from {disk['sun_deg']:.0f} deg"
        lines.append(
            f"    limb     {disk['points']} points on {disk['arc_deg']:.0f} deg, {sun}, rms {disk['rms_px']:.2f} px"
        )
    return "\n".join(lines)


def draw(image: NDArray[Any], disks: list[Any], path: Path) -> None:
    """Save the image, brightened, with points of the limb (green), outlines (orange) and centres."""
    import cv2

    library: Any = cv2
    grey = image.astype(np.float32)
    grey = grey if grey.ndim == 2 else grey[..., :3].mean(axis=2)
    low, high = np.percentile(grey, [1.0, 99.9])
    light = np.clip((grey - low) / max(float(high - low), 1e-9), 0.0, 1.0) ** 0.6
    scale = max(1, round(1000 / max(grey.shape)))
    canvas = np.repeat((light * 220).astype(np.uint8)[..., None], 3, axis=2)
    canvas = library.resize(canvas, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)

    def place(x: Any, y: Any) -> NDArray[np.int32]:
        both = (np.column_stack([x, y]) + 0.5) * scale - 0.5
        return np.rint(both * 16).astype(np.int32)

    for disk in disks:
        e = disk.ellipse
        theta = np.linspace(0.0, 2.0 * math.pi, 721)
        reach = e.at(theta)[0]
        curve = place(e.x + reach * np.cos(theta), e.y + reach * np.sin(theta))
        library.polylines(canvas, [curve], True, (40, 140, 255), 1, cv2.LINE_AA, 4)
        for x, y in place(disk.limb.x, disk.limb.y).tolist():
            library.circle(canvas, (x, y), 16 * scale, (80, 255, 80), -1, cv2.LINE_AA, 4)
        center = place([e.x], [e.y])[0] // 16
        library.drawMarker(canvas, center.tolist(), (40, 140, 255), cv2.MARKER_CROSS, 14, 1)
    done, data = library.imencode(".png", canvas)
    if not done:
        raise ValueError(f"{path}: the picture could not be made")
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror}); give another place for --overlay") from error


def run(args: argparse.Namespace) -> int:
    """Find disks; the exit code is 1 if there is none.

    Raises:
        ValueError: if the image or an option cannot be used.
    """
    if not (0 < args.min_radius < args.max_radius and 0 < args.min_arc <= 360 and args.most >= 1):
        raise ValueError(
            "--min-radius, --max-radius, --min-arc or --most: expected 0 < min < max, 0 to 360 and 1 or more"
        )
    disks_of: Any = importlib.import_module(FINDER)
    image = read_image(args.image)
    sun = None if args.sun is None else disks_of.Light(math.radians(args.sun), 1.0)
    options = disks_of.Options(args.min_radius, args.max_radius, math.radians(args.min_arc), args.most, sun=sun)
    try:
        status, found = disks_of.find_disks(image, options)
    except ValueError as error:
        raise ValueError(f"{args.image}: {error}") from error
    made = report(status.name.lower(), (image.shape[1], image.shape[0]), [_entry(d, args.points) for d in found])
    if args.overlay is not None:
        draw(image, found, args.overlay)
    sys.stdout.write((json.dumps(made, indent=2) if args.json else text(args.image, made)) + "\n")
    return 0 if found else 1
