"""Camera and calibration files (JSON)."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from messages.opnav import CameraConfigMsg
from messages.orbit import CameraAccuracyMsg
from sim.camera.photo_player import Cadence


class BadInputError(ValueError):
    """Something given that cannot be used; the text is one sentence for a person."""


class CameraFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A lens: px, and Brown's k1, k2, p1, p2, k3."""

    width_px: int
    height_px: int
    focal_px: list[float]
    center_px: list[float]
    distortion: list[float] = msgspec.field(default_factory=lambda: [0.0] * 5)


class CalibrationFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Lens, mounting and shutter as estimated by a run, with standard deviations.

    Attributes:
        camera: the lens. dcm_CO: mounting: maps orbit-frame to camera components.
        sigma_focal_px, sigma_center_px, sigma_distortion: of the lens. sigma_mounting_rad: of one photo's attitude.
        sigma_common_m: error that all fixes made with this calibration share: radial, along track, normal.
        shutter_period_s, shutter_sigma_s: the even cadence of the shutter, or null.
        photos, rms_px: what it was made from, and how well it fits. note: what it does not show.
    """

    camera: CameraFile
    dcm_CO: list[list[float]]
    sigma_focal_px: float
    sigma_center_px: list[float]
    sigma_distortion: list[float]
    sigma_mounting_rad: list[float]
    sigma_common_m: list[float]
    shutter_period_s: float | None
    shutter_sigma_s: float | None
    photos: int
    rms_px: float
    note: str = ""


T = TypeVar("T", CameraFile, CalibrationFile)


def _read(path: Path, kind: type[T]) -> T:
    what = "camera file" if kind is CameraFile else "calibration file"
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except OSError as error:
        raise BadInputError(f"{what} {path} cannot be read: {error.strerror or error}") from error
    except msgspec.ValidationError as error:
        raise BadInputError(f"{what} {path}: {error}; see --help for what it holds") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadInputError(f"{what} {path} is no valid JSON ({error}); JSON has no NaN or infinity") from error


def _message(file: CameraFile, path: Path, dcm_CO: list[list[float]] | None = None) -> CameraConfigMsg:
    try:
        camera = CameraConfigMsg(
            width_px=file.width_px,
            height_px=file.height_px,
            focal_px=np.array(file.focal_px),
            center_px=np.array(file.center_px),
            distortion=np.array(file.distortion),
            dcm_CB=np.eye(3) if dcm_CO is None else np.array(dcm_CO),
        )
    except ValueError as error:
        raise BadInputError(f"{path}: {error}") from error
    dcm = camera.dcm_CB
    if not (np.allclose(dcm @ dcm.T, np.eye(3), atol=1e-6) and np.linalg.det(dcm) > 0.0):
        raise BadInputError(f"{path}: dcm_CO is no rotation matrix (orthonormal, determinant 1)")
    size = np.array([camera.width_px, camera.height_px])
    if np.any(camera.center_px < 0.0) or np.any(camera.center_px > size):
        raise BadInputError(f"{path}: center_px {file.center_px} lies outside an image of {size[0]} x {size[1]} px")
    return camera


def read_camera(path: Path) -> CameraConfigMsg:
    """The lens in a camera file.

    Raises:
        BadInputError: if the file is missing, malformed, or a value has the wrong sign, shape or is not finite.
    """
    return _message(_read(path, CameraFile), path)


def read_calibration(path: Path) -> tuple[CameraConfigMsg, CameraAccuracyMsg, Cadence | None]:
    """Lens with mounting, accuracy and shutter in a calibration file.

    Raises:
        BadInputError: as `read_camera`.
    """
    file = _read(path, CalibrationFile)
    camera = _message(file.camera, path, file.dcm_CO)
    try:
        accuracy = CameraAccuracyMsg(
            photos=file.photos,
            rms_px=file.rms_px,
            sigma_focal_px=file.sigma_focal_px,
            sigma_center_px=np.array(file.sigma_center_px),
            sigma_distortion=np.array(file.sigma_distortion),
            sigma_mounting=np.array(file.sigma_mounting_rad),
            sigma_common_H=np.array(file.sigma_common_m),
        )
    except ValueError as error:
        raise BadInputError(f"{path}: {error}") from error
    if file.shutter_period_s is None or file.shutter_sigma_s is None:
        return camera, accuracy, None
    if not (file.shutter_period_s > 0.0 and file.shutter_sigma_s > 0.0):
        raise BadInputError(f"{path}: shutter_period_s and shutter_sigma_s must be greater than 0, or null")
    return camera, accuracy, Cadence(file.shutter_period_s, file.shutter_sigma_s)


def calibration_json(camera: CameraConfigMsg, accuracy: CameraAccuracyMsg, cadence: Cadence | None, note: str) -> bytes:
    """The text of a calibration file."""
    lens = CameraFile(
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_px=camera.focal_px.tolist(),
        center_px=camera.center_px.tolist(),
        distortion=camera.distortion.tolist(),
    )
    file = CalibrationFile(
        camera=lens,
        dcm_CO=camera.dcm_CB.tolist(),
        sigma_focal_px=accuracy.sigma_focal_px,
        sigma_center_px=accuracy.sigma_center_px.tolist(),
        sigma_distortion=accuracy.sigma_distortion.tolist(),
        sigma_mounting_rad=accuracy.sigma_mounting.tolist(),
        sigma_common_m=accuracy.sigma_common_H.tolist(),
        shutter_period_s=None if cadence is None else cadence.period_s,
        shutter_sigma_s=None if cadence is None else cadence.sigma_s,
        photos=accuracy.photos,
        rms_px=accuracy.rms_px,
        note=note,
    )
    return msgspec.json.format(msgspec.json.encode(file), indent=2) + b"\n"
