"""Rays from pixels to the ellipsoid, and the light that comes back along them. Compiled, one band of rows a call.

Everything happens in a space in which the ellipsoid is the unit sphere: x / A, y / A, z / B. There the ground point p
of a ray is also its normal (up to the same scaling), so that neither sunlight nor air mass needs an angle.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from fsw.math.geodesy import A, B
from fsw.math.vectors import V3
from messages.base import F64

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
FULL = 65535.0
"""Reflectance 1, and a pixel with data, in a pyramid."""
PER_A, PER_B, A_PER_B = 1.0 / A, 1.0 / B, A / B
SCALE_HEIGHT = 8400.0
"""Of the air [m]."""
SHELL = A / SCALE_HEIGHT
"""Radius of the Earth in scale heights."""
TWILIGHT = 0.1
"""Sine of the depth of the Sun at which the air is dark."""
Number: TypeAlias = Any
"""A number as wide as its caller chose."""
SINGLE: Any = np.float32
"""Constants of functions that are as wide as their argument."""
_SHELL, _SHELL_2, _SHELL_1 = SINGLE(SHELL), SINGLE(SHELL * SHELL), SINGLE(2.0 * SHELL + 1.0)
_ZERO, _ONE, _UNIT = SINGLE(0.0), SINGLE(1.0), SINGLE(1.0 / FULL)
_RAYLEIGH, _PER_TWILIGHT = SINGLE(0.1875), SINGLE(1.0 / TWILIGHT)
_E2, _E3, _E4, _E5, _E6 = (SINGLE(1.0 / math.factorial(n)) for n in range(2, 7))
_FAR, _PER_64 = SINGLE(60.0), SINGLE(-1.0 / 64.0)
_TAN_22 = math.sqrt(2.0) - 1.0


def _arctan_series() -> F64:
    """Coefficients of atan(t) / t in powers of t^2 up to tan(22.5 deg): interpolated at Chebyshev points, 1e-15."""
    high = _TAN_22**2
    fit = np.polynomial.Chebyshev.interpolate(lambda z: np.arctan(np.sqrt(z)) / np.sqrt(z), 10, domain=[0.0, high])
    return np.asarray(fit.convert(kind=np.polynomial.Polynomial).coef, np.float64)


C0, C1, C2, C3, C4, C5, C6, C7, C8, C9, C10 = (float(c) for c in _arctan_series())


@compiled
def arctan2(y: float, x: float) -> float:
    """As `math.atan2`, to 1e-14 rad, without branches, so that a compiler can do several at once."""
    ax, ay = math.fabs(x), math.fabs(y)
    steep = ay > ax
    low = ax if steep else ay
    high = ay if steep else ax
    turned = low > _TAN_22 * high
    over = low - high if turned else low
    under = low + high if turned else high
    t = over / under
    z = t * t
    y2 = z * z
    even = C0 + y2 * (C2 + y2 * (C4 + y2 * (C6 + y2 * (C8 + y2 * C10))))
    odd = C1 + y2 * (C3 + y2 * (C5 + y2 * (C7 + y2 * C9)))
    a = t * (even + z * odd)
    a += 0.25 * math.pi if turned else 0.0
    a = 0.5 * math.pi - a if steep else a
    a = math.pi - a if x < 0.0 else a
    return -a if y < 0.0 else a


@compiled
def air_mass(mu: Number) -> Number:
    """Path through an even shell one scale height thick, in vertical ones; ``mu``: cosine of the zenith distance.

    Schoenberg (1929), "Theoretische Photometrie": 1 at the zenith, 39 at the horizon.
    """
    return np.sqrt(_SHELL_2 * mu * mu + _SHELL_1) - _SHELL * mu


@compiled
def scaled_axes(r_E: F64, dcm_CE: F64) -> tuple[float, ...]:
    """Origin and the three axes of the camera in scaled Earth-fixed components, as 12 numbers."""
    return (
        r_E[0] / A, r_E[1] / A, r_E[2] / B,
        dcm_CE[0, 0] / A, dcm_CE[0, 1] / A, dcm_CE[0, 2] / B,
        dcm_CE[1, 0] / A, dcm_CE[1, 1] / A, dcm_CE[1, 2] / B,
        dcm_CE[2, 0] / A, dcm_CE[2, 1] / A, dcm_CE[2, 2] / B,
    )  # fmt: skip


@compiled
def hit(u: float, v: float, axes: tuple[float, ...], outside: float) -> V3:
    """Where the ray with the tangents u, v meets the unit sphere, scaled; NaN if it misses."""
    ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    wx, wy, wz = xx * u + yx * v + zx, xy * u + yy * v + zy, xz * u + yz * v + zz
    ww, ow = wx * wx + wy * wy + wz * wz, ox * wx + oy * wy + oz * wz
    room = ow * ow - ww * outside
    room = room if (ow < 0.0) & (room >= 0.0) else math.nan
    t = outside / (math.sqrt(room) - ow)
    return ox + t * wx, oy + t * wy, oz + t * wz


@compiled
def _places(x_tan: F64, y_tan: F64, axes: tuple[float, ...], outside: float, lat: F64, lon: F64, ground: F32) -> None:
    """A row of `ground_band`. Rows are short arrays of one dimension, which a compiler can vectorise."""
    gx, gy, gz = ground[0], ground[1], ground[2]
    for j in range(x_tan.shape[0]):
        px, py, pz = hit(x_tan[j], y_tan[j], axes, outside)
        lat[j] = arctan2(A_PER_B * pz, math.sqrt(px * px + py * py))
        lon[j] = arctan2(py, px)
        gx[j], gy[j], gz[j] = px, py, pz


@compiled
def _lights(
    x_tan: F64, y_tan: F64, to_E: F32, sun: F32, ground: F32, light: F32, mass: F32, path: F32,
) -> None:  # fmt: skip
    """A row of `ground_band`, in single precision, which is good to 1e-5 of the light."""
    sx, sy, sz = sun[0], sun[1], sun[2]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = to_E[0], to_E[1], to_E[2], to_E[3], to_E[4], to_E[5], to_E[6], to_E[7], to_E[8]
    gx, gy, gz = ground[0], ground[1], ground[2]
    one, stretch = np.float32(1.0), np.float32(A_PER_B)
    square = stretch * stretch
    for j in range(x_tan.shape[0]):
        u, v = np.float32(x_tan[j]), np.float32(y_tan[j])
        px, py, pz = gx[j], gy[j], gz[j]
        wx, wy, wz = xx * u + yx * v + zx, xy * u + yy * v + zy, xz * u + yz * v + zz
        across = px * px + py * py
        per_normal = one / np.sqrt(across + square * pz * pz)
        per_ray = one / np.sqrt(u * u + v * v + one)
        mu_sun = (px * sx + py * sy + stretch * pz * sz) * per_normal
        mu_view = -(px * wx + py * wy + stretch * pz * wz) * per_normal * per_ray
        cosine = (wx * sx + wy * sy + wz * sz) * per_ray
        down, up = air_mass(mu_sun), air_mass(mu_view)
        light[j] = max(np.float32(0.0), mu_sun)
        mass[j] = down + up
        path[j] = rayleigh(cosine) * up / (down + up) * dusk(mu_sun)


@compiled
def ground_band(
    x_tan: F64, y_tan: F64, first: int, step: int, r_E: F64, dcm_CE: F64, sun_E: F64,
    lat: F64, lon: F64, light: F32, mass: F32, path: F32,
) -> bool:  # fmt: skip
    """Where the rays of a band of pixels meet the ellipsoid, and how that place is lit. Arrays are (rows, columns).

    Args:
        x_tan: tangent x/z of each ray; NaN where a pixel has no direction.
        y_tan: tangent y/z.
        first: row of the camera that the first row of the band is.
        step: rows of the camera from row to row of the band.
        r_E: position at each row of the camera (n, 3) [m]; the last one stands for all further rows.
        dcm_CE: attitude likewise (n, 3, 3).
        sun_E: direction of the Sun (3,).
        lat: out, geodetic latitude [rad]; NaN if the ray misses.
        lon: out, longitude [rad].
        light: out, cosine of the Sun's zenith distance; 0 at night.
        mass: out, air masses from the Sun to the ground and on to the camera.
        path: out, brightness of endless air in this direction; white ground below the Sun is 1.

    Returns:
        Whether all rays meet it.
    """
    sun, to_E = np.empty(3, np.float32), np.empty(9, np.float32)
    sun[0], sun[1], sun[2] = sun_E[0], sun_E[1], sun_E[2]
    ground = np.empty((3, x_tan.shape[1]), np.float32)
    missed = 0
    for i in range(x_tan.shape[0]):
        k = min(first + i * step, r_E.shape[0] - 1)
        axes = scaled_axes(r_E[k], dcm_CE[k])
        outside = axes[0] * axes[0] + axes[1] * axes[1] + axes[2] * axes[2] - 1.0
        for n in range(9):
            to_E[n] = dcm_CE[k, n // 3, n % 3]
        _places(x_tan[i], y_tan[i], axes, outside, lat[i], lon[i], ground)
        _lights(x_tan[i], y_tan[i], to_E, sun, ground, light[i], mass[i], path[i])
        missed += _missing(ground[0])
    return missed == 0


@compiled
def _missing(row: F32) -> int:
    """How many numbers are NaN."""
    count = 0
    for j in range(row.shape[0]):
        count += 1 if row[j] != row[j] else 0
    return count


@compiled
def limb_band(
    x_tan: F64, y_tan: F64, first: int, step: int, r_E: F64, dcm_CE: F64, sun_E: F64,
    lat: F64, light: F32, mass: F32, path: F32,
) -> None:  # fmt: skip
    """The air that rays past the Earth go through; arguments as in `ground_band`, pixels with a latitude are left."""
    sx, sy, sz = sun_E[0], sun_E[1], sun_E[2]
    for i in range(x_tan.shape[0]):
        k = min(first + i * step, r_E.shape[0] - 1)
        ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz = scaled_axes(r_E[k], dcm_CE[k])
        for j in range(x_tan.shape[1]):
            if not math.isnan(lat[i, j]):
                continue
            light[i, j], mass[i, j], path[i, j] = 0.0, 0.0, 0.0
            u, v = x_tan[i, j], y_tan[i, j]
            wx, wy, wz = xx * u + yx * v + zx, xy * u + yy * v + zy, xz * u + yz * v + zz
            t = -(ox * wx + oy * wy + oz * wz) / (wx * wx + wy * wy + wz * wz)
            if not t > 0.0:
                continue
            px, py, pz = ox + t * wx, oy + t * wy, oz + t * wz
            height = (math.sqrt(px * px + py * py + pz * pz) - 1.0) * A
            nx, ny, nz = px * PER_A, py * PER_A, pz * PER_B
            mu_sun = (nx * sx + ny * sy + nz * sz) / math.sqrt(nx * nx + ny * ny + nz * nz)
            cosine = (A * (wx * sx + wy * sy) + B * wz * sz) / math.sqrt(u * u + v * v + 1.0)
            mass[i, j] = 2.0 * math.sqrt(2.0 * SHELL + 1.0) * math.exp(-height / SCALE_HEIGHT)
            path[i, j] = rayleigh(cosine) * dusk(mu_sun)


@compiled
def rayleigh(cosine: Number) -> Number:
    """A quarter of Rayleigh's phase function, from the cosine of the angle of scattering."""
    return _RAYLEIGH * (_ONE + cosine * cosine)


@compiled
def dusk(mu_sun: Number) -> Number:
    """How much of the air above a place is in sunlight."""
    low = _ONE + mu_sun * _PER_TWILIGHT
    low = max(_ZERO, low)
    low = min(_ONE, low)
    return low * low


@compiled
def soften(light: F32, exponent: float) -> None:
    """Raise the cosine of the Sun's zenith distance to a power: below 1 for ground that is rougher than Lambert's."""
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            light[i, j] = light[i, j] ** exponent


@compiled
def decay(x: Number) -> Number:
    """exp(-x) for x of at least 0, to 1e-8 of double or 1e-6 of single precision, without branches."""
    x = min(_FAR, x)
    x = x * _PER_64
    y = _ONE + x * (_ONE + x * (_E2 + x * (_E3 + x * (_E4 + x * (_E5 + x * _E6)))))
    for _ in range(6):
        y *= y
    return y


@compiled
def _transmit(mass: F32, light: F32, path: F32, depth: Number, gain: Number, factor: F32, added: F32) -> None:
    """A row of `shade_band` in one channel: factor on the reflectance, and what is added."""
    per = gain * _UNIT
    for j in range(mass.shape[0]):
        through = decay(mass[j] * depth)
        factor[j] = per * light[j] * through
        added[j] = gain * path[j] * (_ONE - through)


@compiled
def _shade(seen: U16, factor: F32, added: F32, out: F32) -> None:
    """A row of `shade_band`; the fourth number of a pixel is written too, which lets a compiler do several at once."""
    f0, f1, f2, a0, a1, a2 = factor[0], factor[1], factor[2], added[0], added[1], added[2]
    for j in range(f0.shape[0]):
        out[4 * j] = f0[j] * SINGLE(seen[4 * j]) + a0[j]
        out[4 * j + 1] = f1[j] * SINGLE(seen[4 * j + 1]) + a1[j]
        out[4 * j + 2] = f2[j] * SINGLE(seen[4 * j + 2]) + a2[j]
        out[4 * j + 3] = _ZERO


@compiled
def shade_band(seen: U16, light: F32, mass: F32, path: F32, depth: F64, gain: float, out: F32) -> None:
    """Turn reflectance into radiance.

    Args:
        seen: reflectance (rows, 4 * columns), red, green, blue and any fourth number; 0 to FULL.
        light: as of `ground_band`.
        mass: likewise.
        path: likewise.
        depth: vertical optical depth of each channel (3,).
        gain: factor on the result.
        out: radiance, of the shape of ``seen``.
    """
    factor, added = np.empty((3, light.shape[1]), np.float32), np.empty((3, light.shape[1]), np.float32)
    for i in range(light.shape[0]):
        for c in range(3):
            _transmit(mass[i], light[i], path[i], SINGLE(depth[c]), SINGLE(gain), factor[c], added[c])
        _shade(seen[i], factor, added, out[i])


RAYLEIGH_RGB = (0.0525, 0.0973, 0.2022)
AEROSOL_RGB = (0.821, 1.0, 1.261)
"""Relative to 550 nm: Angstrom's exponent 1.3."""


def optical_depth(haze: float, aerosol: float) -> F64:
    """Vertical optical depth of the air for red, green and blue (640, 550, 460 nm), (3,).

    Args:
        haze: factor on the whole, 0 for none.
        aerosol: vertical optical depth of aerosols at 550 nm. Of molecules: Hansen and Travis (1974), eq. 2.30.
    """
    return haze * (np.array(RAYLEIGH_RGB) + aerosol * np.array(AEROSOL_RGB))
