"""Rays from pixels to the ellipsoid, and the light that comes back along them. Compiled, one band of rows a call.

Everything happens in a space in which the ellipsoid is the unit sphere: x / A, y / A, z / B. There the ground point p
of a ray is also its normal (up to the same scaling), so that neither sunlight nor air mass needs an angle.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from fsw.math.geodesy import A, B
from messages.base import F64

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
PER_A, PER_B = 1.0 / A, 1.0 / B
SCALE_HEIGHT = 8400.0
"""Of the air [m]."""
SHELL = A / SCALE_HEIGHT
"""Radius of the Earth in scale heights."""
TWILIGHT = 0.1
"""Sine of the depth of the Sun at which the air is dark."""
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
def air_mass(mu: float) -> float:
    """Path through an even shell one scale height thick, in vertical ones; ``mu``: cosine of the zenith distance.

    Schoenberg (1929), "Theoretische Photometrie": 1 at the zenith, 39 at the horizon.
    """
    return math.sqrt(SHELL * SHELL * mu * mu + 2.0 * SHELL + 1.0) - SHELL * mu


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
def hit(u: float, v: float, axes: tuple[float, ...], outside: float) -> tuple[float, float, float, float, float, float]:
    """Where the ray with the tangents u, v meets the unit sphere, and its direction, both scaled; NaN if it misses."""
    ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    wx, wy, wz = xx * u + yx * v + zx, xy * u + yy * v + zy, xz * u + yz * v + zz
    ww, ow = wx * wx + wy * wy + wz * wz, ox * wx + oy * wy + oz * wz
    room = ow * ow - ww * outside
    room = room if ow < 0.0 else -1.0
    t = outside / (math.sqrt(room) - ow)
    return ox + t * wx, oy + t * wy, oz + t * wz, wx, wy, wz


@compiled
def _places(x_tan: F64, y_tan: F64, axes: tuple[float, ...], outside: float, lat: F64, lon: F64) -> None:
    """A row of `ground_band`. Rows are short arrays of one dimension, which a compiler can vectorise."""
    for j in range(x_tan.shape[0]):
        px, py, pz, _, _, _ = hit(x_tan[j], y_tan[j], axes, outside)
        nx, ny, nz = px * PER_A, py * PER_A, pz * PER_B
        lat[j] = arctan2(nz, math.sqrt(nx * nx + ny * ny))
        lon[j] = arctan2(py, px)


@compiled
def _lights(
    x_tan: F64, y_tan: F64, axes: tuple[float, ...], outside: float, sun: tuple[float, float, float],
    light: F32, mass: F32, path: F32,
) -> None:  # fmt: skip
    """A row of `ground_band`."""
    sx, sy, sz = sun
    for j in range(x_tan.shape[0]):
        u, v = x_tan[j], y_tan[j]
        px, py, pz, wx, wy, wz = hit(u, v, axes, outside)
        nx, ny, nz = px * PER_A, py * PER_A, pz * PER_B
        per_normal = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        per_ray = 1.0 / math.sqrt(u * u + v * v + 1.0)
        mu_sun = (nx * sx + ny * sy + nz * sz) * per_normal
        mu_view = -(px * wx + py * wy + pz * wz) * per_normal * per_ray
        cosine = (A * (wx * sx + wy * sy) + B * wz * sz) * per_ray
        down, up = air_mass(mu_sun), air_mass(mu_view)
        light[j] = max(0.0, mu_sun)
        mass[j] = down + up
        path[j] = rayleigh(cosine) * up / (down + up) * dusk(mu_sun)


@compiled
def ground_band(
    x_tan: F64, y_tan: F64, first: int, step: int, r_E: F64, dcm_CE: F64, sun_E: F64,
    lat: F64, lon: F64, light: F32, mass: F32, path: F32,
) -> None:  # fmt: skip
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
    """
    sun = (sun_E[0], sun_E[1], sun_E[2])
    for i in range(x_tan.shape[0]):
        k = min(first + i * step, r_E.shape[0] - 1)
        axes = scaled_axes(r_E[k], dcm_CE[k])
        outside = axes[0] * axes[0] + axes[1] * axes[1] + axes[2] * axes[2] - 1.0
        _places(x_tan[i], y_tan[i], axes, outside, lat[i], lon[i])
        _lights(x_tan[i], y_tan[i], axes, outside, sun, light[i], mass[i], path[i])


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
def rayleigh(cosine: float) -> float:
    """A quarter of Rayleigh's phase function, from the cosine of the angle of scattering."""
    return 0.1875 * (1.0 + cosine * cosine)


@compiled
def dusk(mu_sun: float) -> float:
    """How much of the air above a place is in sunlight."""
    low = 1.0 + mu_sun / TWILIGHT
    low = max(0.0, low)
    low = min(1.0, low)
    return low * low


@compiled
def soften(light: F32, exponent: float) -> None:
    """Raise the cosine of the Sun's zenith distance to a power: below 1 for ground that is rougher than Lambert's."""
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            light[i, j] = light[i, j] ** exponent


@compiled
def decay(x: float) -> float:
    """exp(-x) for x of at least 0, to 2e-8, without branches. Beyond 60 it is 0 to all purposes."""
    x = min(60.0, x)
    x *= -1.0 / 256.0
    y = 1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x * (1.0 / 720.0))))))
    for _ in range(8):
        y *= y
    return y


@compiled
def _transmit(mass: F32, depth: F64, red: F64, green: F64, blue: F64) -> None:
    r, g, b = depth[0], depth[1], depth[2]
    for j in range(mass.shape[0]):
        red[j], green[j], blue[j] = decay(mass[j] * r), decay(mass[j] * g), decay(mass[j] * b)


@compiled
def shade_band(image: F32, light: F32, mass: F32, path: F32, depth: F64, gain: float, todo: U8) -> None:
    """Turn reflectance into radiance, in place.

    Args:
        image: reflectance (rows, columns, 3) in, radiance out.
        light: as of `ground_band`.
        mass: likewise.
        path: likewise.
        depth: vertical optical depth of each channel (3,).
        gain: factor on the result.
        todo: (rows, columns): pixels that are 0 are left.
    """
    through = np.empty((3, image.shape[1]))
    for i in range(image.shape[0]):
        _transmit(mass[i], depth, through[0], through[1], through[2])
        for j in range(image.shape[1]):
            if todo[i, j] == 0:
                continue
            lit, air = gain * light[i, j], gain * path[i, j]
            for c in range(3):
                image[i, j, c] = image[i, j, c] * lit * through[c, j] + air * (1.0 - through[c, j])


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
