"""One interface to all detectors of features."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.features.surf import surf

CV: Any = cv2
ORB_PATCH = 31
"""Side of the square that ORB describes, in pixels of the image of its pyramid."""


class Features(NamedTuple):
    """Features of one image, the strongest first; n of them."""

    place_px: F64
    """(n, 2) column and row; pixel centres at integers."""
    size_px: F64
    """(n,) standard deviation of the Gaussian at which each was found."""
    angle: F64
    """(n,) orientation, rad, from the image's x axis towards y (down)."""
    response: F64
    """(n,) strength, in the detector's own measure."""
    words: NDArray[Any]
    """(n, d) descriptors: float32, compared by distance, or uint8, compared bit by bit."""

    @property
    def binary(self) -> bool:
        """Whether descriptors are strings of bits."""
        return self.words.dtype == np.uint8

    def pick(self, which: NDArray[Any]) -> Features:
        """The features that an index or mask array names."""
        return Features(*(part[which] for part in self))


def _by_opencv(extractor: Any, grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, sigma: float) -> Features:
    """Features of an OpenCV extractor; ``sigma`` is the Gaussian's for a key point of diameter 1."""
    keys, words = extractor.detectAndCompute(grey, mask)
    if words is None:
        words = np.empty((0, extractor.descriptorSize()), np.uint8 if extractor.descriptorType() == 0 else np.float32)
    return Features(
        np.array([k.pt for k in keys], np.float64).reshape(-1, 2),
        sigma * np.array([k.size for k in keys], np.float64),
        np.radians([k.angle for k in keys]),
        np.array([k.response for k in keys], np.float64),
        words,
    )


def _sift(grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, limit: int) -> Features:
    """SIFT (Lowe 2004) with the square root of its normalised words (Arandjelovic and Zisserman 2012).

    Without the precise upscaling OpenCV's places are a quarter of a pixel off, towards the lower right.
    """
    precise = CV.SIFT_create(limit, 3, 0.02, 10.0, 1.6, cv2.CV_32F, True)
    found = _by_opencv(precise, grey, mask, 0.5)
    total = np.maximum(np.abs(found.words).sum(axis=1, keepdims=True), 1e-9)
    return found._replace(words=np.sqrt(found.words / total).astype(np.float32))


def _orb(grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, limit: int) -> Features:
    """ORB (Rublee et al. 2011); its patch of 31 pixels is taken as 5 standard deviations wide.

    OpenCV multiplies places of the smaller images of its pyramid by their scale, as if pixels were counted from the
    middle of the first one; that is half a pixel of the difference between the two sizes too little.
    """
    found = _by_opencv(CV.ORB_create(nfeatures=limit, fastThreshold=8, patchSize=ORB_PATCH), grey, mask, 0.2)
    scale = found.size_px / (0.2 * ORB_PATCH)
    return found._replace(place_px=found.place_px + 0.5 * (scale[:, None] - 1.0))


def _akaze(grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, limit: int) -> Features:
    """AKAZE (Alcantarilla et al. 2013)."""
    home = CV if hasattr(CV, "AKAZE_create") else CV.xfeatures2d
    return _by_opencv(home.AKAZE_create(threshold=5e-4, max_points=limit), grey, mask, 0.5)


def _surf(grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None, limit: int) -> Features:
    """SURF (Bay et al. 2008)."""
    return Features(*surf(grey, mask, limit))


DETECTORS: dict[str, Callable[[NDArray[np.uint8], NDArray[np.uint8] | None, int], Features]] = {
    "sift": _sift,
    "surf": _surf,
    "orb": _orb,
}
"""The detectors at hand, by name."""
if hasattr(CV, "AKAZE_create") or hasattr(getattr(CV, "xfeatures2d", None), "AKAZE_create"):
    DETECTORS["akaze"] = _akaze


def detect(name: str, image: NDArray[Any], mask: NDArray[Any] | None = None, limit: int = 4000) -> Features:
    """Features of an image.

    Args:
        name: of a detector in `DETECTORS`.
        image: grey (rows, columns) or colour (rows, columns, 3), uint8; at least 32 x 32 pixels.
        mask: (rows, columns), where features are wanted; None for everywhere.
        limit: most features; the strongest are kept.

    Raises:
        ValueError: if the detector is unknown or not in this OpenCV, or image, mask or limit do not fit.
    """
    if name not in DETECTORS:
        missing = "; this build of OpenCV has no AKAZE" if name == "akaze" else ""
        raise ValueError(f"detector: expected one of {', '.join(DETECTORS)}, got {name!r}{missing}")
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(
            f"image: expected uint8 (rows, columns) or (rows, columns, 3), got {image.dtype} {image.shape}"
        )
    if min(image.shape[:2]) < 32:
        raise ValueError(f"image: expected 32 x 32 pixels or more, got {image.shape[1]} x {image.shape[0]}")
    if mask is not None and mask.shape != image.shape[:2]:
        raise ValueError(f"mask: expected the image's shape {image.shape[:2]}, got {mask.shape}")
    if limit < 1:
        raise ValueError(f"limit: expected 1 or more, got {limit}")
    grey = CV.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else np.ascontiguousarray(image)
    shown = None if mask is None else np.where(mask, 255, 0).astype(np.uint8)
    found = DETECTORS[name](grey, shown, limit)
    return found.pick(np.argsort(-found.response, kind="stable")[:limit])
