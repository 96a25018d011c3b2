"""Atmosphere: density of the air at the spacecraft, and its velocity as it turns with the planet."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np

from fsw import F64, Bound, In, KernelModule, Out, Record, Row, Shape, publish, zeros
from fsw.math.atmosphere import EARTH_BANDS, band_of, exponential_density, height_above_spheroid
from fsw.math.geodesy import A, F
from fsw.math.vectors import cross, dot, store3, vec3
from messages.environment import AtmosphereMsg, PlanetOrientationMsg
from messages.states import SCStatesMsg

BANDS = len(EARTH_BANDS)


class Atmosphere(KernelModule):
    """Exponential bands of density, turning with the planet. See SPEC.md."""

    class Params(Record):
        """Parameters; without bands they are those of the Earth."""

        radius: Annotated[float, "m", "radius of the equator", Bound(gt=0)] = A
        flattening: Annotated[float, "-", "flattening of the planet", Bound(ge=0, lt=1)] = F
        bands: Annotated[int, "-", "number of bands used", Bound(ge=1, le=BANDS)] = BANDS
        base_height: Annotated[F64, Shape(BANDS), "m", "height at which a band begins, ascending"] = zeros(BANDS)
        density: Annotated[F64, Shape(BANDS), "kg/m^3", "density there", Bound(ge=0)] = zeros(BANDS)
        scale_height: Annotated[F64, Shape(BANDS), "m", "scale height, > 0 in used bands", Bound(ge=0)] = zeros(BANDS)

        def __post_init__(self) -> None:
            """Fill in the Earth's bands where none are given, and check their order."""
            names = ("base_height", "density", "scale_height")
            if not any(np.any(getattr(self, name)) for name in names):
                table = EARTH_BANDS * np.array([1e3, 1.0, 1e3])
                for k, name in enumerate(names):
                    msgspec.structs.force_setattr(self, name, table[:, k].copy())
            super().__post_init__()
            heights = self.base_height[: self.bands]
            if np.any(np.diff(heights) <= 0.0):
                raise ValueError(
                    f"Atmosphere.Params.base_height: expected ascending heights (m), got {heights.tolist()}"
                )
            if np.any(self.scale_height[: self.bands] <= 0.0):
                raise ValueError("Atmosphere.Params.scale_height: expected > 0 (m) in every used band")

    class State(Record):
        """Where the last search for the band ended."""

        band: Annotated[int, "-", "band of the last height; -1 before the first"] = -1
        steepness: Annotated[float, "1/m", "one over the scale height of that band"] = 0.0

    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_atmosphere = Out(AtmosphereMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, in_orientation: Row, out_atmosphere: Row) -> None:
        """Air at the newest position."""
        if in_state.seq == 0 or in_orientation.seq == 0:
            return
        r_BN_N = vec3(in_state.r_BN_N)
        z = dot(vec3(in_orientation.dcm_EN[2]), r_BN_N)
        height = height_above_spheroid(dot(r_BN_N, r_BN_N), z, params.radius, params.flattening)
        band = band_of(height, params.base_height, params.bands, state.band)
        if band != state.band:
            state.band, state.steepness = band, 1.0 / params.scale_height[band]
        air = exponential_density(height, params.base_height, params.density, band, state.steepness)
        wind = cross(vec3(in_orientation.omega_EN_N), r_BN_N)
        if not math.isfinite(air + wind[0] + wind[1] + wind[2]):
            raise ValueError("in_state.r_BN_N, in_orientation: expected finite numbers and a position that is not 0")
        out_atmosphere.density = air
        store3(out_atmosphere.v_AN_N, wind)
        publish(out_atmosphere, t_ns)
