"""Points of a limb to a small part of a pixel: the limb's own profile, fitted to the pixels around it.

Across a lit limb the brightness is modelled as sky + (step + arch * mu + slope * depth) behind the limb, blurred by a
Gaussian; mu is the cosine of the emission angle. A step alone would be biased on a disk that darkens to its limb. The
shape is found for sectors of the limb, then only shifted for each small cell of it; no pixel is interpolated, and
each belongs to one cell, so errors of the cells are independent but for the sector's common one.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from messages.base import F64
from modules.opnav.disks.ellipse import Ellipse, azimuths
from modules.opnav.disks.grey import F32
from modules.opnav.disks.normal import normal

OUTSIDE_PX = 6.0
INSIDE_PX = 7.0
GRID = 0.02
TAILS = 1.35, 2.2
PARTS = 8
"""Of a profile: sky, step, arch, slope, two of the tails, and how step and arch change along the sector."""
PRIOR = np.array([1e3, 1e3, 4.0, 1.0, 0.3, 0.3, 1.0, 4.0])
COARSE_PRIOR = np.array([1e3, 1e3, 4.0, 1.0, 1e-6, 1e-6, 1e-6, 1e-6])
"""Standard deviations of the parts to the height of the whole fall: sky and step are free."""
BLURS = tuple(0.4 * 1.2**k for k in range(13))
"""Standard deviations of the blur that are tried [px]; a parabola finds the best between them."""
SHAPE_PIXELS = 3000
"""More pixels than this are not needed for the shapes."""
CLIP = 5.0


NO_MODES: F64 = np.zeros((0, 0))


class Limb(NamedTuple):
    """Points on a limb (n,), their standard deviations, and what is common to those of one sector."""

    x: F64
    y: F64
    sigma: F64
    """Of each point alone, across the limb [px]."""
    sector: NDArray[np.int64]
    common: F64
    """(sectors,) standard deviation of the shift that all points of a sector share [px]."""
    step: F64
    """Height of the fall over 3 px [levels]."""
    blur: float
    """Standard deviation of the blur across the limb [px], that of the pixel itself included."""
    modes: F64 = NO_MODES
    """(n, k) shifts outward that go together: each column is one standard deviation of an unknown cause [px]."""

    def pick(self, which: NDArray[np.bool_]) -> Limb:
        """The points that a mask names."""
        return self._replace(
            x=self.x[which],
            y=self.y[which],
            sigma=self.sigma[which],
            sector=self.sector[which],
            step=self.step[which],
            modes=self.modes[which] if len(self.modes) else NO_MODES,
        )


class Band(NamedTuple):
    """Pixels near a limb: distance (n,), value, azimuth, sector and cell."""

    d: F64
    value: F64
    sector: NDArray[np.int64]
    along: F64
    """Place in the sector, from -1 to 1."""
    cell: NDArray[np.int64]
    sectors: int
    cells: int
    x: F64
    """Column [px]."""
    y: F64


@functools.lru_cache(512)
def _tables(blur: float, radius: float) -> F64:
    """(2, 5, m): step, arch, slope, two of the tails, and their derivatives; by distance from -INSIDE_PX - 3 on."""
    half = round(6.0 * TAILS[1] * blur / GRID)
    reach = half * GRID
    fine = np.arange(-INSIDE_PX - 3.0 - reach, OUTSIDE_PX + 3.0 + reach + 0.5 * GRID, GRID)
    depth = np.minimum(np.maximum(-fine, 0.0), radius)
    inside = np.where(np.abs(fine) < 0.25 * GRID, 0.5, fine < 0.0)
    raw = np.array([inside * 1.0, np.sqrt(depth * (2.0 * radius - depth)) / radius, depth / 8.0])
    across = np.arange(-half, half + 1) * GRID / blur
    kernels = [np.exp(-0.5 * (across / w) ** 2) for w in (1.0, *TAILS)]
    narrow, *wide = [k / k.sum() for k in kernels]
    pairs = [(r, narrow) for r in raw] + [(raw[0], w - narrow) for w in wide]
    smooth = np.array([np.convolve(r, k, "valid") for r, k in pairs])
    return np.array([smooth, np.gradient(smooth, GRID, axis=1)])


def _shape(d: F64, along: F64, blur: float, radius: float) -> tuple[F64, F64]:
    """Values and derivatives (7, n) of the parts at distances (n,); the last two are step and arch times ``along``."""
    # A radius to 12 % is near enough: the arch is as good as the root of the depth
    table = _tables(round(blur, 3), math.exp(round(math.log(radius) / 0.12) * 0.12))
    at = np.rint((d + (INSIDE_PX + 3.0)) / GRID).astype(np.int64)
    both = table.take(np.clip(at, 0, table.shape[2] - 1), axis=2)
    values = both[0] + (d + (INSIDE_PX + 3.0) - GRID * at) * both[1]
    return np.vstack([values, along * values[:2]]), np.vstack([both[1], along * both[1, :2]])


def band_of(values: F32, e: Ellipse, azimuths: NDArray[np.bool_], depths: F64, cells: int, sectors: int) -> Band:
    """Pixels within some distance of an ellipse, where the azimuth is one that counts.

    Args:
        values: (rows, columns) grey.
        e: the limb, to about a pixel.
        azimuths: (n,) mask over the full turn from azimuth zero.
        depths: (n,) how far to look inside [px].
        cells: of how many the full turn is to be made. sectors: the same, a divisor of it.
    """
    rows, columns = values.shape
    n = len(azimuths)
    theta = (np.flatnonzero(azimuths) + 0.5) * (2.0 * math.pi / n)
    fine = max(1, math.ceil(2.2 * math.pi * e.radius * 1.3 / n))
    theta = (theta[:, None] + (np.arange(fine) + 0.5 - 0.5 * fine) * (2.0 * math.pi / n / fine)).ravel()
    reach, nx, ny = e.at(theta)
    across = np.arange(-INSIDE_PX - 1.0, OUTSIDE_PX + 1.01, 0.7)
    column = np.rint((e.x + reach * np.cos(theta))[:, None] + nx[:, None] * across).astype(np.int32)
    row = np.rint((e.y + reach * np.sin(theta))[:, None] + ny[:, None] * across).astype(np.int32)
    inside = (column >= 1) & (column < columns - 1) & (row >= 1) & (row < rows - 1)
    left, upper = int(column.min()), int(row.min())
    mark = np.zeros((int(row.max()) - upper + 1, int(column.max()) - left + 1), np.bool_)
    mark[row[inside] - upper, column[inside] - left] = True
    row, column = np.nonzero(mark)
    row, column = row + upper, column + left
    d, _, _ = e.distance(column.astype(float), row.astype(float))
    turn = np.arctan2(row - e.y, column - e.x) / (2.0 * math.pi) % 1.0
    index = np.minimum((turn * n).astype(np.int64), n - 1)
    keep = (d < OUTSIDE_PX) & (d > -depths[index]) & azimuths[index]
    d, turn, row, column = d[keep], turn[keep], row[keep], column[keep]
    cell = np.minimum((turn * cells).astype(np.int64), cells - 1)
    sector = cell * sectors // cells
    along = 2.0 * (turn * sectors - sector) - 1.0
    return Band(
        d,
        values[row, column].astype(float),
        sector,
        along,
        cell,
        sectors,
        cells,
        column.astype(float),
        row.astype(float),
    )


class Shapes(NamedTuple):
    """Profiles of the sectors: sky, step, arch, slope (m, 4), shift (m,) [px], blur, sum of squares, and noise (m,)."""

    part: F64
    shift: F64
    blur: float
    cost: float
    noise: F64
    spread: F64
    """(m,) standard deviation of the shift, with the shape unknown, and as if it were known."""
    alone: F64


def _fit_shapes(
    band: Band, radius: float, blur: float, shift: F64, weight: F64, noise: float, rounds: int, fine: bool = False
) -> Shapes:
    m, ones = band.sectors, np.ones(len(band.d))
    part, a, ridge = np.zeros((m, PARTS)), np.zeros((m, PARTS + 1, PARTS + 1)), np.zeros((m, PARTS, PARTS))
    residual = ones
    height = np.ptp(np.percentile(band.value, [2.0, 98.0])) + noise
    ridge[:, range(PARTS), range(PARTS)] = (noise / height / (PRIOR if fine else COARSE_PRIOR)) ** 2
    for _ in range(rounds):
        s, ds = _shape(band.d - shift[band.sector], band.along, blur, radius)
        a, b = normal(band.sector, m, np.array([ones, *s]), band.value, weight)
        part = np.linalg.solve(a + ridge, b[..., None])[..., 0]
        slant = -(part[band.sector, 1:].T * ds).sum(axis=0)
        residual = band.value - part[band.sector, 0] - (part[band.sector, 1:].T * s).sum(axis=0)
        a, b = normal(band.sector, m, np.array([ones, *s, slant]), residual, weight)
        a[:, :PARTS, :PARTS] += ridge
        b[:, :PARTS] -= (ridge @ part[..., None])[..., 0]
        a[:, PARTS, PARTS] += noise**2  # a shift of a pixel is as unlikely as one sigma
        step = np.linalg.solve(a, b[..., None])[..., 0][:, PARTS]
        shift = np.clip(shift + np.clip(step, -0.7, 0.7), -2.5, 2.5)
    covariance = np.linalg.inv(a)
    count = np.maximum(np.bincount(band.sector, weight, m) - (PARTS + 1.0), 1.0)
    square = np.bincount(band.sector, weight * residual**2, m) / count
    rough = np.sqrt(np.maximum(square, noise**2))
    return Shapes(
        np.asarray(part, float),
        shift,
        blur,
        float((weight * residual**2).sum()),
        rough,
        np.sqrt(np.maximum(covariance[:, PARTS, PARTS], 0.0)) * rough,
        rough / np.sqrt(np.maximum(a[:, PARTS, PARTS], 1e-12)),
    )


def _best_shapes(band: Band, radius: float, noise: float, weight: F64, fine: bool) -> Shapes:
    """Shapes with the blur that explains the pixels best."""
    zero = np.zeros(band.sectors)
    tried: dict[int, Shapes] = {}
    at = 3
    while True:
        for k in (at, at - 1, at + 1):
            if 0 <= k < len(BLURS) and k not in tried:
                start = tried[at].shift if at in tried else zero
                tried[k] = _fit_shapes(band, radius, BLURS[k], start, weight, noise, 2 if tried else 4)
        best = min(tried, key=lambda k: tried[k].cost)
        if best == at:
            break
        at = best
    if not 0 < at < len(BLURS) - 1:
        return _fit_shapes(band, radius, BLURS[at], tried[at].shift, weight, noise, 4 if fine else 2, fine)
    low, middle, high = (tried[k].cost for k in (at - 1, at, at + 1))
    between = 0.5 * (low - high) / max(low - 2.0 * middle + high, 1e-30)
    return _fit_shapes(band, radius, BLURS[at] * 1.2**between, tried[at].shift, weight, noise, 4 if fine else 2, fine)


def _misfit(band: Band, radius: float, shapes: Shapes) -> F64:
    s, _ = _shape(band.d - shapes.shift[band.sector], band.along, shapes.blur, radius)
    return band.value - shapes.part[band.sector, 0] - (shapes.part[band.sector, 1:].T * s).sum(axis=0)


def limb_points(
    values: F32, noise: float, e: Ellipse, azimuths: NDArray[np.bool_], depths: F64, most: int, fine: bool = False
) -> Limb | None:
    """Points of the limb near an ellipse.

    Args:
        values: (rows, columns) grey, as it came.
        noise: its standard deviation, at least.
        e: the limb, to a pixel or two.
        azimuths: (n,) mask of the azimuths that are lit limb, over the full turn.
        depths: (n,) how far in the profile is that of a limb [px].
        most: at most this many points on the full turn.
        fine: with the tails of the blur and the change along each sector; slower, and it bends to what is no limb.

    Returns:
        The points, or None if no pixels are left.
    """
    around = 2.0 * math.pi * e.radius
    sectors = int(np.clip(around / 14.0, 12, 24)) if fine else int(np.clip(around / 30.0, 8, 24))
    cells = sectors * max(1, int(min(around, most) / sectors))
    band = band_of(values, e, azimuths, depths, cells, sectors)
    if len(band.d) < 100:
        return None
    stride = max(1, len(band.d) // SHAPE_PIXELS)
    some = band._replace(
        d=band.d[::stride], value=band.value[::stride], sector=band.sector[::stride], along=band.along[::stride]
    )
    shapes = _best_shapes(some, e.radius, noise, np.ones(len(some.d)), fine)
    # Stars, cosmic rays and hot pixels do not fit the profile of the rest: leave them out, and look again
    few = _weights(_misfit(some, e.radius, shapes), some, shapes, noise)
    if few.min() == 0.0:
        shapes = _fit_shapes(some, e.radius, shapes.blur, shapes.shift, few, noise, 2, fine)
    weight = _weights(_misfit(band, e.radius, shapes), band, shapes, noise)
    exact = math.sqrt(1.0 / stride)  # the shapes' own errors are those of the part of the pixels
    return _cells(band, e, shapes._replace(alone=shapes.alone * exact), weight)


def _weights(misfit: F64, band: Band, shapes: Shapes, noise: float) -> F64:
    rough = max(1.4826 * float(np.median(np.abs(misfit))), noise)
    return (np.abs(misfit) < CLIP * rough + 0.3 * np.abs(shapes.part[band.sector, 1])).astype(np.float64)


def _cells(band: Band, e: Ellipse, shapes: Shapes, weight: F64) -> Limb:
    shift = shapes.shift[np.arange(band.cells) * band.sectors // band.cells]
    owner = np.arange(band.cells) * band.sectors // band.cells
    ones, n = np.ones(len(band.d)), band.cells
    a = np.zeros((n, 3, 3))
    gain, sky = np.ones(n), shapes.part[owner, 0]
    for _ in range(3):
        s, ds = _shape(band.d - shift[band.cell], band.along, shapes.blur, e.radius)
        form, slant = (
            (shapes.part[band.sector, 1:].T * s).sum(axis=0),
            -(shapes.part[band.sector, 1:].T * ds).sum(axis=0),
        )
        residual = band.value - sky[band.cell] - gain[band.cell] * form
        a, b = normal(band.cell, n, np.array([ones, form, gain[band.cell] * slant]), residual, weight)
        # Sky and height differ little from the sector's
        a[:, 0, 0] += 1e-9
        a[:, 1, 1] += (shapes.noise[owner] / 0.3) ** 2 + 1e-9
        a[:, 2, 2] += 1e-9
        b[:, 1] -= (shapes.noise[owner] / 0.3) ** 2 * (gain - 1.0)
        step = np.linalg.solve(a, b[..., None])[..., 0]
        sky, gain = sky + step[:, 0], np.clip(gain + step[:, 1], 0.1, 4.0)
        shift = shift + np.clip(step[:, 2], -0.7, 0.7)
    sigma = shapes.noise[owner] * np.sqrt(np.maximum(np.linalg.inv(a)[:, 2, 2], 0.0))
    s, _ = _shape(np.array([-1.5, 1.5]), np.zeros(2), shapes.blur, e.radius)
    step = gain * (shapes.part[owner, 1:] @ (s[:, 0] - s[:, 1]))
    theta = azimuths(n) + math.pi / n
    reach, nx, ny = e.at(theta)
    pixels = np.bincount(band.cell, weight, n)
    slack = np.sqrt(np.maximum(shapes.spread**2 - shapes.alone**2, 0.0))
    found = Limb(
        e.x + reach * np.cos(theta) + nx * shift,
        e.y + reach * np.sin(theta) + ny * shift,
        sigma,
        owner,
        slack,
        step,
        shapes.blur,
    )
    good = (pixels >= 6) & (np.abs(shift) < 3.0) & (sigma < 0.8) & (step > 4.0 * shapes.noise[owner] / np.sqrt(3.0))
    return found.pick(good & (np.abs(shift - shapes.shift[owner]) < 2.0))
