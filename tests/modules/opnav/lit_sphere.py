"""A lit sphere as a camera sees it, by rays cast through a fine grid of pixels; lens by OpenCV."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from messages.opnav import CameraConfigMsg


def rays(cam: CameraConfigMsg, columns: NDArray[Any], rows: NDArray[Any]) -> F64:
    """Unit directions that pixels see, (n, 3)."""
    matrix = np.array([[cam.focal_px[0], 0.0, cam.center_px[0]], [0.0, cam.focal_px[1], cam.center_px[1]], [0, 0, 1]])
    seen = np.stack([columns.ravel(), rows.ravel()], axis=1)[:, None, :]
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-13)
    flat = cv2.undistortPoints(seen, matrix, cam.distortion, criteria=stop)[:, 0]
    way = np.column_stack([flat, np.ones(len(flat))])
    return way / np.linalg.norm(way, axis=1)[:, None]


def light_of(way: F64, body_C: F64, sun_C: F64, law: int) -> F64:
    """Brightness along unit directions (n,) of a unit sphere at ``body_C``: Lambert (1) or uniform where lit (2)."""
    along = way @ body_C
    root = along**2 - (body_C @ body_C - 1.0)
    hit = root > 0.0
    normal = (along - np.sqrt(np.where(hit, root, 0.0)))[:, None] * way - body_C
    lit = np.where(hit, normal @ sun_C, 0.0)
    return np.maximum(lit, 0.0) if law == 1 else (lit > 0.0).astype(float)


def lit_sphere(cam: CameraConfigMsg, body_C: F64, sun_C: F64, law: int, fine: int = 900) -> tuple[F64, float, float]:
    """Centre of brightness (2,) [px], lit area [px^2], and radius [px] of a unit sphere at ``body_C``."""
    matrix = np.array([[cam.focal_px[0], 0.0, cam.center_px[0]], [0.0, cam.focal_px[1], cam.center_px[1]], [0, 0, 1]])
    x, y = cv2.projectPoints(body_C[None], np.zeros(3), np.zeros(3), matrix, cam.distortion)[0].ravel()
    radius = float(cam.focal_px[0] / np.sqrt(body_C @ body_C - 1.0))
    step = 2.6 * radius / fine
    grid = (np.arange(fine) - (fine - 1) / 2) * step
    columns, rows = np.meshgrid(x + grid, y + grid)
    light = light_of(rays(cam, columns, rows), body_C, sun_C, law)
    center = np.array([light @ columns.ravel(), light @ rows.ravel()]) / light.sum()
    return center, float(np.count_nonzero(light) * step**2), radius


def picture(
    cam: CameraConfigMsg, body_C: F64, sun_C: F64, level: float, background: float, noise: float, seed: int
) -> NDArray[np.uint8]:
    """A grey image of a Lambert sphere, 4 x 4 rays for each pixel, blurred by a Gaussian of 0.8 px."""
    k = (np.arange(4) - 1.5) / 4
    fine_x = (np.arange(cam.width_px)[:, None] + k).ravel()
    fine_y = (np.arange(cam.height_px)[:, None] + k).ravel()
    columns, rows = np.meshgrid(fine_x, fine_y)
    light = light_of(rays(cam, columns, rows), body_C, sun_C, 1)
    mean = light.reshape(cam.height_px, 4, cam.width_px, 4).mean(axis=(1, 3))
    grey = background + level * cv2.GaussianBlur(mean, (0, 0), 0.8)
    grey += noise * np.random.default_rng(seed).normal(size=grey.shape)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)
