"""Photos with what was found in them: landmarks, and the map's coast drawn where the fix says it must be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap
from fsw.math.camera import lens_vector
from messages.opnav import CameraConfigMsg
from modules.opnav.landmark_finder import render_view
from sim.camera.photo_player import read_image
from sim.scenarios.iss_photos.results import Fix

CV: Any = cv2
_COAST, _FOUND, _TEXT = (0, 255, 255), (70, 255, 70), (255, 255, 255)
_SMALLEST_PX = 150


def water(image: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where a coloured map shows water: dark, with little red, and blue not far below green (Blue Marble), (H, W)."""
    smooth = CV.GaussianBlur(image, (0, 0), 1.5).astype(np.int32)
    red, green, blue = smooth[..., 0], smooth[..., 1], smooth[..., 2]
    dark = red + green + blue
    return mask & (10 * red < 6 * np.maximum(green, blue)) & ((2 * blue > green) | (dark < 30)) & (dark < 330)


def coast_lines(image: NDArray[np.uint8], mask: NDArray[np.bool_]) -> list[NDArray[np.int32]]:
    """Outlines of water bodies in a rendered map, px; short ones and the map's own edge are left out."""
    wet = water(image, mask).astype(np.uint8)
    wet = CV.morphologyEx(wet, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    wet = CV.morphologyEx(wet, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    outlines: list[NDArray[np.int32]] = list(CV.findContours(wet, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])
    inner = CV.erode(mask.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    inner[:3], inner[-3:], inner[:, :3], inner[:, -3:] = False, False, False, False
    lines: list[NDArray[np.int32]] = []
    for outline in outlines:
        points = outline[:, 0, :]
        if len(points) < _SMALLEST_PX:
            continue
        shown = inner[points[:, 1], points[:, 0]]
        parts = np.split(np.arange(len(points)), np.flatnonzero(np.diff(shown.astype(np.int8))) + 1)
        lines += [points[part] for part in parts if shown[part[0]] and len(part) > 1]
    return lines


def draw_overlay(fix: Fix, camera: CameraConfigMsg, geo_map: GeoMap, sizes_px: float = 3.0) -> bytes:
    """A JPEG of the photo with landmarks and coast, or with the reason why there are none."""
    picture = np.array(read_image(fix.path))
    if fix.valid and fix.r_CE_E is not None and fix.dcm_CE is not None and fix.landmarks is not None:
        view = render_view(geo_map, lens_vector(camera), picture.shape[:2], fix.r_CE_E, fix.dcm_CE, colour=True)
        for line in coast_lines(view.image, view.mask):
            CV.polylines(picture, [line.reshape(-1, 1, 2)], False, _COAST, 2, cv2.LINE_AA)
        for u, v in fix.landmarks:
            CV.circle(picture, (round(16 * u), round(16 * v)), round(16 * sizes_px), _FOUND, 1, cv2.LINE_AA, 4)
        total = np.linalg.norm(fix.error_H) / 1e3 if fix.error_H is not None else np.nan
        found = f"{len(fix.landmarks)} landmarks (green), coast of the map (cyan), {total:.1f} km from the orbit"
        text = f"{fix.path.name}: {found}"
    else:
        text = f"{fix.path.name}: not used: {fix.reason}"
    CV.rectangle(picture, (0, 0), (picture.shape[1], 34), (0, 0, 0), -1)
    CV.putText(picture, text, (10, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.62, _TEXT, 1, cv2.LINE_AA)
    done, data = CV.imencode(".jpg", CV.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])
    if not done:
        raise OSError(0, f"the overlay of {fix.path.name} cannot be encoded")
    return bytes(data)


def overlay_name(path: Path) -> str:
    """File name of the overlay of a photo."""
    return f"{path.stem}_overlay.jpg"
