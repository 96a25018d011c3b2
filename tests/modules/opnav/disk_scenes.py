"""Rendered disks for tests of the finders: supersampled spheres and ellipses, lit, blurred, noisy; truth is exact."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import scipy.ndimage as ndi
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def lit_disk(
    shape: tuple[int, int],
    center: tuple[float, float],
    radius: float,
    phase_deg: float = 0.0,
    direction_deg: float = 0.0,
    law: str = "lambert",
    flattening: float = 0.0,
    tilt_deg: float = 0.0,
    over: int = 5,
) -> F64:
    """Brightness (rows, columns) of a disk on black, 1 at its brightest; each pixel is the mean of its subpixels.

    Args:
        shape: rows and columns.
        center: column and row of the centre [px].
        radius: geometric mean of the semi-axes [px].
        phase_deg: angle between the Sun and the camera at the body.
        direction_deg: where the Sun stands in the image, from column towards row.
        law: lambert, lunar (Lommel-Seeliger), flat, or dark (limb darkened and lit head on).
        flattening: 1 - b / a. tilt_deg: direction of the long axis.
        over: subpixels along each side.
    """
    rows, columns = shape
    reach = radius * 1.2 + 3.0
    c0, c1 = max(0, math.floor(center[0] - reach)), min(columns, math.ceil(center[0] + reach))
    r0, r1 = max(0, math.floor(center[1] - reach)), min(rows, math.ceil(center[1] + reach))
    out = np.zeros(shape)
    if c1 <= c0 or r1 <= r0:
        return out
    y, x = np.mgrid[0 : (r1 - r0) * over, 0 : (c1 - c0) * over]
    x = (x + 0.5) / over - 0.5 + c0 - center[0]
    y = (y + 0.5) / over - 0.5 + r0 - center[1]
    turn, ratio = math.radians(tilt_deg), math.sqrt(1.0 - flattening)
    u = (x * math.cos(turn) + y * math.sin(turn)) * ratio / radius
    v = (y * math.cos(turn) - x * math.sin(turn)) / ratio / radius
    x, y = u * math.cos(turn) - v * math.sin(turn), u * math.sin(turn) + v * math.cos(turn)
    inside = x * x + y * y <= 1.0
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    phase, azimuth = math.radians(phase_deg), math.radians(direction_deg)
    incident = np.maximum((x * math.cos(azimuth) + y * math.sin(azimuth)) * math.sin(phase) + z * math.cos(phase), 0.0)
    if law == "lambert":
        value = incident
    elif law == "lunar":
        value = 2.0 * incident / np.maximum(incident + z, 1e-9) * 0.5
    elif law == "flat":
        value = (incident > 0.0) * 1.0
    else:
        value = 0.4 + 0.6 * z
    value = np.where(inside, value, 0.0)
    value = value.reshape(r1 - r0, over, c1 - c0, over).mean(axis=(1, 3))
    out[r0:r1, c0:c1] = value / max(value.max(), 1e-9)
    return out


def exposed(
    light: F64,
    rng: np.random.Generator,
    level: float = 180.0,
    sky: float = 4.0,
    blur: float = 0.7,
    noise: float = 1.5,
    shot: float = 0.02,
    bits: int = 8,
) -> NDArray[Any]:
    """The image of a scene: Gaussian blur [px], shot and read noise [grey levels], quantised."""
    grey = ndi.gaussian_filter(light, blur, truncate=6.0) * level + sky
    grey = grey + rng.normal(size=grey.shape) * np.sqrt(noise**2 + shot * np.maximum(grey, 0.0))
    top = 2**bits - 1
    return np.clip(np.rint(grey), 0, top).astype(np.uint8 if bits == 8 else np.uint16)


def with_stars(image: NDArray[Any], rng: np.random.Generator, count: int, top: float = 255.0) -> NDArray[Any]:
    """Adds stars of a pixel or so, hot pixels, and tracks of cosmic rays, a third of each."""
    out = image.astype(float)
    rows, columns = image.shape
    for n in range(count):
        r, c = int(rng.integers(2, rows - 2)), int(rng.integers(2, columns - 2))
        bright = float(rng.uniform(0.1, 1.0)) * top
        if n % 3 == 0:
            out[r - 1 : r + 2, c - 1 : c + 2] += bright * np.array([[0.1, 0.3, 0.1], [0.3, 1.0, 0.3], [0.1, 0.3, 0.1]])
        elif n % 3 == 1:
            out[r, c] = top
        else:
            slope, length = rng.uniform(0, math.pi), int(rng.integers(3, 25))
            for k in range(length):
                i, j = round(r + k * math.sin(slope)), round(c + k * math.cos(slope))
                if 0 <= i < rows and 0 <= j < columns:
                    out[i, j] += bright
    return np.clip(out, 0, top).astype(image.dtype)


def basilisk_scene(scene: dict[str, Any]) -> NDArray[np.uint8]:
    """A scene (rows, columns, 3) of the reference vectors, after their description; see `sha256`."""
    w, h, over = scene["width"], scene["height"], scene.get("smooth", 4)
    x, y = (np.arange(w * over) + 0.5) / over - 0.5, ((np.arange(h * over) + 0.5) / over - 0.5)[:, None]
    fine = np.full((h * over, w * over), float(scene.get("background", 0)))
    for body in scene["bodies"]:
        left, right = np.searchsorted(x, [body["x"] - body["r"] - 1, body["x"] + body["r"] + 1])
        upper, lower = np.searchsorted(y[:, 0], [body["y"] - body["r"] - 1, body["y"] + body["r"] + 1])
        nx, ny = (x[left:right] - body["x"]) / body["r"], (y[upper:lower] - body["y"]) / body["r"]
        square = nx * nx + ny * ny
        nz = np.sqrt(np.maximum(1 - square, 0.0))
        phase, azimuth = body["phase"], body["dir"]
        sun = (math.sin(phase) * math.cos(azimuth), math.sin(phase) * math.sin(azimuth), math.cos(phase))
        lit = np.clip(nx * sun[0] + ny * sun[1] + nz * sun[2], 0, None)
        part = fine[upper:lower, left:right]
        part[square <= 1.0] = (body["level"] * np.sqrt(lit))[square <= 1.0]
    grey = np.floor(fine.reshape(h, over, w, over).mean(axis=(1, 3)) + 0.5)
    if scene.get("noise"):
        seed, most = scene["noise"]
        grey = grey + np.random.default_rng(seed).integers(-most, most + 1, size=grey.shape)
    grey = np.clip(grey, 0, 255).astype(np.uint8)
    tint = np.array(scene.get("tint") or [1.0, 1.0, 1.0], float)
    return np.clip(np.floor(grey[..., None] * tint + 0.5), 0, 255).astype(np.uint8)


@functools.cache
def vectors() -> tuple[dict[str, Any], list[NDArray[np.uint8]]]:
    """Basilisk's vectors and the images of their scenes, which are those that it saw."""
    made = json.loads((Path(__file__).parents[2] / "data" / "basilisk_opnav_images.json").read_text())
    images = [basilisk_scene(s) for s in made["scenes"]]
    assert [sha256(i) for i in images] == [s["sha256_rgb"] for s in made["scenes"]]
    return made, images


def sha256(image: NDArray[np.uint8]) -> str:
    """Fingerprint of an image's bytes, rows first."""
    return hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()
