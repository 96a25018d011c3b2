"""Limbs of ellipsoids as OpenCV projects them, and messages of disk navigation, for tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.scenarios.feed import fed
from messages.base import F64
from messages.opnav import MAX_CIRCLES, MAX_LIMB, CameraConfigMsg, OpNavCirclesMsg, OpNavLimbMsg
from messages.states import NavAttMsg
from modules.opnav.basilisk import camera_of

Criterion = Callable[[str, float], None]
FRAMES = "NBC"


def vectors(name: str) -> list[dict[str, Any]]:
    """Cases of Basilisk."""
    path = Path(__file__).parents[2] / "data" / "basilisk_disk_navigation.json"
    return json.loads(path.read_text(encoding="utf-8"))[name]


sources = fed
"""An output for each input of a module."""


def camera(focal: float, size: int = 1024, distortion: Sequence[float] = (0.0,) * 5, **more: Any) -> CameraConfigMsg:
    """A square camera."""
    return CameraConfigMsg(
        width_px=size,
        height_px=size,
        focal_px=np.array([focal, focal]),
        center_px=np.full(2, (size - 1) / 2),
        distortion=np.array(distortion),
        **more,
    )


def basilisk_camera(case: dict[str, Any]) -> CameraConfigMsg:
    """The camera of a case of Basilisk."""
    width, height = case.get("resolution", (512, 512))
    sigma: Any = tuple(case["sigma_CB"])
    return camera_of(case.get("fieldOfView", 0.5), width, height, sigma)


def attitude(sigma: Sequence[float] = (0.0, 0.0, 0.0), rate: Sequence[float] = (0.0, 0.0, 0.0)) -> NavAttMsg:
    return NavAttMsg(sigma_BN=np.array(sigma), omega_BN_B=np.array(rate))


def pixels(cam: CameraConfigMsg, points_C: F64) -> F64:
    """Projection by OpenCV (no skew), (n, 2)."""
    matrix = np.array([[cam.focal_px[0], 0.0, cam.center_px[0]], [0.0, cam.focal_px[1], cam.center_px[1]], [0, 0, 1]])
    flat = cv2.projectPoints(np.ascontiguousarray(points_C), np.zeros(3), np.zeros(3), matrix, cam.distortion)[0]
    return np.asarray(flat, np.float64).reshape(-1, 2)


def limb_points(axes: F64, dcm_EC: F64, r_C: F64, angle: F64) -> F64:
    """Points of an ellipsoid, relative to the camera in C, where the line of sight touches it (n, 3) [m]."""
    q = (dcm_EC @ r_C) / axes
    far = np.linalg.norm(q)
    m = q / far
    e1 = np.cross(m, [0.3, 0.5, -0.8])
    e1 /= np.linalg.norm(e1)
    ring = np.outer(np.cos(angle), e1) + np.outer(np.sin(angle), np.cross(m, e1))
    p_E = (m / far + np.sqrt(1.0 - 1.0 / far**2) * ring) * axes
    sight_E = p_E - dcm_EC @ r_C
    normal = p_E / axes**2
    off = np.sum(sight_E * normal, axis=1) / np.linalg.norm(sight_E, axis=1) / np.linalg.norm(normal, axis=1)
    assert np.max(np.abs(np.sum((p_E / axes) ** 2, axis=1) - 1.0)) < 1e-12  # on the surface
    assert np.max(np.abs(off)) < 1e-9  # where it is seen edge on
    return sight_E @ dcm_EC


def limb_message(points: F64, sigma: float | F64, body_id: int = 499, when: int = 0, **more: Any) -> OpNavLimbMsg:
    n = len(points)
    limb, each = np.full((MAX_LIMB, 2), np.nan), np.full(MAX_LIMB, np.nan)
    limb[:n], each[:n] = points, sigma
    fields: dict[str, Any] = {"valid": True, "status": 0, "count": n, "exposure_ns": when, "body_id": body_id}
    return OpNavLimbMsg(limb_px=limb, sigma_px=each, **{**fields, **more})


def circles_message(circles: F64, P_px: F64, body_id: int = 499, when: int = 0, **more: Any) -> OpNavCirclesMsg:
    """Rows of ``circles``: column, row, radius."""
    n = len(circles)
    center, radius = np.full((MAX_CIRCLES, 2), np.nan), np.full(MAX_CIRCLES, np.nan)
    P = np.full((MAX_CIRCLES, 3, 3), np.nan)
    center[:n], radius[:n], P[:n] = circles[:, :2], circles[:, 2], P_px
    fields: dict[str, Any] = {"valid": True, "status": 0, "count": n, "exposure_ns": when, "body_id": body_id}
    return OpNavCirclesMsg(center_px=center, radius_px=radius, P_px=P, **{**fields, **more})


def worst(message: Any, expected: dict[str, Any]) -> float:
    """Largest relative difference of positions and covariances from a Basilisk message."""
    found = 0.0
    for f in FRAMES:
        r, P = np.array(expected[f"r_BN_{f}"]), np.array(expected[f"covar_{f}"]).reshape(3, 3)
        away = np.max(np.abs(getattr(message, f"r_CP_{f}") - r)), np.max(np.abs(getattr(message, f"P_rr_{f}") - P))
        sizes = max(float(np.linalg.norm(r)), 1e-9), max(float(np.max(np.abs(P))), 1e-9)
        found = max(found, float(away[0]) / sizes[0], float(away[1]) / sizes[1])
    return found
