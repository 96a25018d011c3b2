"""A stored photo: its pixels, and the time that its EXIF data give."""

from __future__ import annotations

import re
import warnings
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

_EXIF_IFD, _ORIGINAL, _DIGITIZED, _OFFSET, _OFFSET_ORIGINAL, _SUBSECOND = 0x8769, 0x9003, 0x9004, 0x9010, 0x9011, 0x9291


class PhotoError(ValueError):
    """A photo that cannot be used; the text says why, and who knows the file puts its name before."""


class Photo(msgspec.Struct, frozen=True, kw_only=True):
    """A photo file and the second in which it was taken.

    Attributes:
        path: the file. width_px, height_px: its size.
        stamp: start of the interval in which it was taken, UTC. resolution_s: length of that interval, s.
    """

    path: Path
    width_px: int
    height_px: int
    stamp: datetime
    resolution_s: float


def _text(value: Any) -> str:
    return str(value).strip("\x00 ") if value is not None else ""


def _stamp(tags: dict[int, Any]) -> tuple[datetime, float]:
    """EXIF time as UTC, and its resolution in s. A stamp is cut off, not rounded (seen in Astro Pi photos)."""
    written = _text(tags.get(_ORIGINAL)) or _text(tags.get(_DIGITIZED))
    if not written:
        text = "it has no time in its EXIF data (DateTimeOriginal), and without a time the orbit gives no position"
        raise PhotoError(f"{text}; use the photo as the camera wrote it")
    try:
        local = datetime.strptime(written[:19] + " +0000", "%Y:%m:%d %H:%M:%S %z")
    except ValueError:
        raise PhotoError(f"it has the EXIF time {written!r}, expected YYYY:MM:DD HH:MM:SS") from None
    zone = re.fullmatch(r"([+-])(\d\d):(\d\d)", _text(tags.get(_OFFSET_ORIGINAL)) or _text(tags.get(_OFFSET)))
    shift = timedelta(hours=int(zone[2]), minutes=int(zone[3])) if zone else timedelta(0)
    stamp = local.replace(tzinfo=timezone(-shift if zone and zone[1] == "-" else shift)).astimezone(UTC)
    digits = _text(tags.get(_SUBSECOND))[:6]
    if not digits.isdigit():
        return stamp, 1.0
    return stamp + timedelta(microseconds=int(digits.ljust(6, "0"))), 10.0 ** -len(digits)


def open_photo(path: Path | str) -> Photo:
    """Read size and time of a photo; its pixels stay on the disk, but are decoded once to see that they can be.

    Times without a zone are taken as UTC, which is what cameras on board the station are set to.

    Raises:
        PhotoError: if the file is no image, is damaged, or has no time.
    """
    path = Path(path)
    height, width = read_image(path).shape[:2]
    with Image.open(path) as image:
        tags: dict[int, Any] = dict(image.getexif().get_ifd(_EXIF_IFD))
    stamp, resolution = _stamp(tags)
    return Photo(path=path, width_px=width, height_px=height, stamp=stamp, resolution_s=resolution)


def read_image(path: Path | str) -> NDArray[np.uint8]:
    """Pixels as the sensor read them out, (H, W, 3) red green blue. The EXIF orientation is not applied.

    Raises:
        PhotoError: if the file is missing, no image, or damaged.
    """
    path = Path(path)
    try:
        with warnings.catch_warnings(), Image.open(path) as image:
            warnings.simplefilter("error")
            return np.asarray(image.convert("RGB"), np.uint8)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        reason = "there is no such file" if isinstance(error, FileNotFoundError) else "it is no image, or damaged"
        raise PhotoError(reason) from error
    except Warning as error:
        raise PhotoError(f"it cannot be read: {error}") from error
