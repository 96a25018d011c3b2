"""A detector: from the light on each pixel to grey levels of eight bits, with blur, noise, defects and quantisation.

The chain, in this order: point-spread function, vignetting and response of each pixel, dark signal, cosmic rays, shot
noise, full well, read noise, gain, quantisation, tone curve. Every effect is off until it is asked for. Sources:
Janesick (2007), "Photon Transfer", ch. 3 to 5; EMVA 1288 (2021), "Standard for Characterization of Image Sensors and
Cameras", sec. 2; the blur, Lindeberg (1990), "Scale-space for discrete signals", eq. 18.
"""

from __future__ import annotations

import functools
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Annotated, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from messages.base import U64, Bound, Record
from sim.camera import detector_kernel as kernel

CV: Any = cv2
WORKERS = os.cpu_count() or 1
BAND = 32
"""Rows that share one random stream: their number does not depend on the number of threads."""
F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]


class DetectorParams(Record):
    """Parameters of a detector; a camera module derives its own from these.

    A radiance of 1 fills the well at ``exposure`` 1, and a full well is the highest grey level at ``gain`` 1.
    """

    exposure: Annotated[float, "-", "exposure time over the nominal one", Bound(ge=0)] = 1.0
    gain: Annotated[float, "-", "grey levels per electron over the nominal ones", Bound(gt=0)] = 1.0
    full_well: Annotated[float, "-", "electrons that a pixel holds", Bound(gt=0)] = 20000.0
    bits: Annotated[int, "-", "of the converter; the image has eight in any case", Bound(ge=1, le=16)] = 8
    black_level: Annotated[float, "-", "output without light, of the full range", Bound(ge=0, lt=1)] = 0.0
    gamma: Annotated[float, "-", "tone curve: output is level^(1/gamma); 1 for a linear one", Bound(gt=0)] = 1.0
    psf_sigma_px: Annotated[float, "px", "standard deviation of the point-spread function", Bound(ge=0, le=50)] = 0.0
    shot_noise: Annotated[bool, "-", "electrons come at random"] = False
    read_noise: Annotated[float, "-", "standard deviation of the read noise, electrons", Bound(ge=0)] = 0.0
    dark_signal: Annotated[float, "-", "electrons without light, nominal exposure", Bound(ge=0)] = 0.0
    vignetting: Annotated[float, "-", "part of the light that the corners lose", Bound(ge=0, le=1)] = 0.0
    response_sigma: Annotated[float, "-", "standard deviation of the pixels' response", Bound(ge=0, le=0.5)] = 0.0
    dead_pixels: Annotated[float, "-", "part of the pixels that see nothing", Bound(ge=0, le=1)] = 0.0
    hot_pixels: Annotated[float, "-", "part of the pixels with a large dark signal", Bound(ge=0, le=1)] = 0.0
    hot_signal: Annotated[float, "-", "electrons of a hot pixel, nominal exposure", Bound(ge=0)] = 10000.0
    pattern_seed: Annotated[int, "-", "which pixels are dead, hot or weak", Bound(ge=0)] = 1
    cosmic_rays: Annotated[float, "-", "mean number of cosmic rays in an image", Bound(ge=0, le=1e5)] = 0.0
    cosmic_signal: Annotated[float, "-", "mean electrons of a cosmic ray in each pixel", Bound(ge=0)] = 2000.0


class Pattern(NamedTuple):
    """What differs from pixel to pixel and stays."""

    response: F32
    """(rows, columns, channels): factor on the light."""
    dark: F32
    """The same: electrons at nominal exposure."""


def expose(radiance: F32, params: DetectorParams, stream: U64, *, blurred_already: bool = False) -> U8:
    """Take a picture.

    Args:
        radiance: (H, W) or (H, W, 3), linear; 1 saturates at nominal exposure and gain. It is not changed.
        params: of the detector.
        stream: (4,) random stream of the module; it advances. The picture depends on its words, not on the number of
            threads.
        blurred_already: whether the renderer has applied the point-spread function.

    Returns:
        Grey levels (H, W) or (H, W, 3).

    Raises:
        ValueError: if the radiance has another shape, or a value that is negative, NaN or infinite.
    """
    if radiance.ndim not in (2, 3) or 0 in radiance.shape or (radiance.ndim == 3 and radiance.shape[2] != 3):
        raise ValueError(f"expose: radiance: expected the shape (H, W) or (H, W, 3), got {radiance.shape}")
    rows, columns = radiance.shape[:2]
    channels = 1 if radiance.ndim == 2 else 3
    light = np.ascontiguousarray(radiance, np.float32)
    light = (light if blurred_already else blurred(light, params.psf_sigma_px)).reshape(rows, -1)
    pattern = _pattern(_fixed(params), rows, columns, channels)
    electrons, rays = params.full_well * params.exposure, params.cosmic_rays
    bands = range(0, rows, BAND)
    streams = np.empty((len(bands) + 1, 4), np.uint64)
    out = np.empty((rows, columns * channels), np.uint8)
    levels = 2**params.bits - 1
    numbers = np.array(
        [
            electrons,
            params.exposure,
            params.full_well,
            float(params.shot_noise),
            params.read_noise,
            params.gain * levels / params.full_well,
            params.black_level * levels,
        ]
    )
    table = _tone(params.bits, params.gamma)
    struck = np.zeros_like(light) if rays > 0.0 else np.zeros((1, 1), np.float32)
    with _wrapping():
        kernel.split(stream, streams)
        if rays > 0.0:
            kernel.cosmic_rays(streams[-1], rays, params.cosmic_signal, channels, struck)

    def share(first: int) -> int:
        bad = 0
        for k in range(first, len(bands), WORKERS):
            part = slice(bands[k], bands[k] + BAND)
            hits = struck[part] if rays > 0.0 else struck
            where = light[part], pattern.response[part], pattern.dark[part], hits
            with _wrapping():
                bad += kernel.expose_band(*where, numbers, table, streams[k], out[part])
        return bad

    with ThreadPoolExecutor(WORKERS) as pool:
        bad = sum(pool.map(share, range(WORKERS)))
    if bad:
        text = f"{bad} values that are negative, NaN or infinite; a renderer must not make such"
        raise ValueError(f"expose: radiance: expected finite light of at least 0, got {text}")
    return out.reshape(radiance.shape)


def _wrapping() -> np.errstate:
    """Lets the words of a stream wrap around without a warning, which uncompiled runs would give."""
    return np.errstate(over="ignore")


def blurred(light: F32, sigma_px: float) -> F32:
    """The light behind a Gaussian point-spread function; beyond the border it goes on as at the border.

    The kernel is the discrete Gaussian `exp(-sigma^2) I_n(sigma^2)`: its variance is sigma^2 for any sigma, which that
    of a sampled Gaussian is not below 0.5 px.
    """
    if sigma_px == 0.0:
        return light
    reach = int(np.ceil(5.0 * sigma_px + 2.0))
    weights = ive(np.abs(np.arange(-reach, reach + 1)), sigma_px * sigma_px).astype(np.float32)
    weights /= weights.sum()
    return CV.sepFilter2D(light, -1, weights, weights, borderType=cv2.BORDER_REPLICATE)


@functools.lru_cache(8)
def _tone(bits: int, gamma: float) -> U8:
    """Grey level of eight bits for each level of the converter, (2^bits,)."""
    level = np.linspace(0.0, 1.0, 2**bits)
    return np.rint(255.0 * level ** (1.0 / gamma)).astype(np.uint8)


class _Fixed(NamedTuple):
    """The parameters that the pattern depends on."""

    dark_signal: float
    vignetting: float
    response_sigma: float
    dead_pixels: float
    hot_pixels: float
    hot_signal: float
    pattern_seed: int


def _fixed(params: DetectorParams) -> _Fixed:
    return _Fixed(**{name: getattr(params, name) for name in _Fixed._fields})


@functools.lru_cache(4)
def _pattern(fixed: _Fixed, rows: int, columns: int, channels: int) -> Pattern:
    """Response and dark signal of each pixel, (rows, columns * channels); each colour has its own defects."""
    rng = np.random.default_rng(fixed.pattern_seed)
    size = (rows, columns, channels)
    y, x = np.arange(rows) - (rows - 1) / 2.0, np.arange(columns) - (columns - 1) / 2.0
    square = (y * y)[:, None] + x * x
    square /= max(float(square[0, 0]), 0.5)  # 1 in the corners
    response = np.broadcast_to((1.0 - fixed.vignetting * square)[..., None], size).copy()
    if fixed.response_sigma > 0.0:
        response *= np.maximum(1.0 + fixed.response_sigma * rng.standard_normal(size), 0.0)
    order = rng.permutation(response.size)
    dead, hot = round(fixed.dead_pixels * response.size), round(fixed.hot_pixels * response.size)
    dark = np.full(size, fixed.dark_signal)
    response.reshape(-1)[order[:dead]] = 0.0
    dark.reshape(-1)[order[:dead]] = 0.0
    dark.reshape(-1)[order[dead : dead + hot]] += fixed.hot_signal
    flat = rows, columns * channels
    return Pattern(response.reshape(flat).astype(np.float32), dark.reshape(flat).astype(np.float32))
