"""Parameters of `EarthCamera`: what it draws, and its detector's."""

from __future__ import annotations

from typing import Annotated

from messages.base import Bound, Vec3, zeros
from sim.camera.detector import DetectorParams


class EarthCameraParams(DetectorParams):
    """Parameters."""

    r_CB_B: Annotated[Vec3, "m", "position of the camera relative to B, B components"] = zeros(3)
    brightness: Annotated[float, "-", "radiance of white ground below the Sun; 1 saturates", Bound(gt=0)] = 1.0
    colour: Annotated[bool, "-", "image of three channels; false for grey"] = True
    interpolated: Annotated[bool, "-", "rays for every 16th pixel only, where that is good to 0.05 px"] = False
    sunlight: Annotated[bool, "-", "the Sun lights the ground; false for the bare map"] = True
    sun_exponent: Annotated[float, "-", "power of the cosine law of light; 1 is Lambert's", Bound(gt=0, le=2)] = 1.0
    haze: Annotated[float, "-", "factor on the optical depth of the air; 0 for none", Bound(ge=0, le=20)] = 1.0
    aerosol: Annotated[float, "-", "vertical optical depth of aerosols at 550 nm", Bound(ge=0, le=5)] = 0.08
    clouds: Annotated[float, "-", "part of the sky with clouds; 0 for none", Bound(ge=0, le=1)] = 0.0
    cloud_seed: Annotated[int, "-", "which clouds", Bound(ge=0)] = 1
    cloud_height: Annotated[float, "m", "height of the clouds", Bound(gt=0, le=20000)] = 4000.0
    star_gain: Annotated[float, "-", "factor on the light of stars; 0 for none", Bound(ge=0)] = 1.0
    row_time: Annotated[float, "s", "rolling shutter: time from row to row; 0 for none", Bound(ge=0, le=0.01)] = 0.0
    smear_time: Annotated[float, "s", "exposure over which motion smears; 0 for none", Bound(ge=0, le=1)] = 0.0
