"""The picture before the detector: rays, maps, light, air, clouds, stars, in bands of rows on several threads."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.imaging.maps import SEA_LEVEL, GeoMap
from fsw.math.camera import channel_lens, project, undistort
from fsw.math.geodesy import A, B, ray_to_spheroid
from messages.base import F64
from messages.opnav import CameraConfigMsg
from sim.camera.earth_camera.cells import (
    SIDE,
    easy_cells,
    keep_covered,
    light_cells,
    node_colours,
    smooth_cells,
    spread_places,
)
from sim.camera.earth_camera.clouds import cloud_band, noise_lattice, threshold
from sim.camera.earth_camera.kernel import F32, U8, U16, ground_band, limb_band, optical_depth, shade_band, soften
from sim.camera.earth_camera.layers import SPARSE, MapLayer, View
from sim.camera.earth_camera.params import EarthCameraParams
from sim.camera.earth_camera.patches import Desk, origin, sample_cells
from sim.camera.earth_camera.pose import Pose
from sim.camera.earth_camera.sampler import map_places, sample_band
from sim.camera.earth_camera.sky import add_stars, star_light
from sim.camera.earth_camera.terrain import Terrain, terrain_band, terrain_of
from sim.environment.star_catalogue import bright_stars

CV: Any = cv2
STEP = SIDE
"""Pixels between the nodes at which footprints, and on the interpolated grid everything else, are computed."""
BAND = 32
"""Rows that one thread works on at a time: its arrays stay in the cache."""
GRID_ERROR = 0.05
"""Largest error of the interpolated grid [px]; cells that bend more are drawn ray by ray."""
WORKERS = min(os.cpu_count() or 1, 8)


class Rendered(NamedTuple):
    """A picture before the detector."""

    radiance: F32
    """(rows, columns, 3), red, green, blue."""
    mask: NDArray[np.bool_]
    """(rows, columns): True where a map was seen."""


class _Lens(NamedTuple):
    """Rays of a lens, and the channels it is for."""

    vector: F64
    channels: tuple[int, ...]
    x_tan: F64
    y_tan: F64
    node_x: F64
    node_y: F64


class _Nodes(NamedTuple):
    lat: F64
    lon: F64
    light: F32
    mass: F32
    path: F32


class _Smooth(NamedTuple):
    colour: F32
    """As of `cells.node_colours`."""
    uses: list[U8]
    """The cells of each view that may be interpolated."""


class EarthRenderer:
    """Draws what a camera sees of the Earth. Maps stay in memory from picture to picture."""

    def __init__(
        self, camera: CameraConfigMsg, maps: GeoMap, params: EarthCameraParams, workers: int = WORKERS
    ) -> None:
        """Prepare rays and tables.

        Args:
            camera: size, lens and mounting.
            maps: pictures of the ground, fine to coarse, and heights.
            params: what to draw.
            workers: threads.
        """
        self.camera, self.maps, self.params, self.workers = camera, maps, params, workers
        self.shape = camera.height_px, camera.width_px
        self.layers = [MapLayer(raster) for raster in maps.layers]
        self._depth = optical_depth(params.haze, params.aerosol)
        self._lattice = noise_lattice(params.cloud_seed) if params.clouds > 0.0 else None
        self._terrain: tuple[object, Terrain] | None = None
        lenses = [channel_lens(camera, c) for c in range(3)]
        distinct = {lens.tobytes(): lens for lens in lenses}
        self._lenses = [
            self._rays(lens, tuple(c for c in range(3) if lenses[c].tobytes() == key)) for key, lens in distinct.items()
        ]
        stars = bright_stars()
        self._stars = stars.u_N, star_light(stars, float(np.sqrt(np.prod(camera.focal_px))))

    def _rays(self, lens: F64, channels: tuple[int, ...]) -> _Lens:
        rows, columns = self.shape
        nodes = [STEP * np.arange((n - 1) // STEP + 2, dtype=float) for n in self.shape]
        planes: list[F64] = []
        for x, y in ((np.arange(columns, dtype=float), np.arange(rows, dtype=float)), (nodes[1], nodes[0])):
            pixel = np.stack(np.meshgrid(x, y), axis=-1)
            out = np.empty((pixel.shape[0] * pixel.shape[1], 2))
            undistort(lens, np.ascontiguousarray(pixel.reshape(-1, 2)), out)
            planes += [np.ascontiguousarray(out[:, k].reshape(pixel.shape[:2])) for k in (0, 1)]
        return _Lens(lens, channels, *planes)

    def render(self, poses: Pose | Sequence[Pose], sun_E: F64) -> Rendered:
        """Draw a picture, or the mean of several: sub-exposures of a moving camera.

        Args:
            poses: of the camera, Earth-fixed.
            sun_E: direction of the Sun, Earth-fixed (3,), any length.

        Raises:
            ValueError: if the camera is inside the Earth, or a number is not finite.
            MapError: if a map file cannot be read.
        """
        series = [poses] if isinstance(poses, Pose) else list(poses)
        length = float(np.linalg.norm(sun_E))
        if not (math.isfinite(length) and length > 0.0):
            raise ValueError(f"sun_E: expected a direction, got {sun_E}; give the Sun's position")
        sun = np.asarray(sun_E, float) / length
        for pose in series:
            _check(pose)
        if len(series) == 1 and len(self._lenses) == 1:
            return Rendered(*self._draw(self._lenses[0], series[0], sun))
        total = np.zeros((*self.shape, 3), np.float32)
        masks: list[NDArray[np.bool_]] = []
        for pose in series:
            for lens in self._lenses:
                image, mask = self._draw(lens, pose, sun)
                for c in lens.channels:
                    total[..., c] += image[..., c]
                masks.append(mask)
        return Rendered(total / np.float32(len(series)), np.logical_and.reduce(masks))

    def motion_px(self, before: Pose, after: Pose) -> float:
        """How far what is in view moves in the picture between two poses of one entry, at most [px]."""
        lens = self._lenses[0]
        x, y = lens.node_x[::SPARSE, ::SPARSE], lens.node_y[::SPARSE, ::SPARSE]
        rays = np.stack([x, y, np.ones(x.shape)], axis=-1).reshape(-1, 3)
        rays = rays[np.isfinite(rays).all(axis=1)] @ before.dcm_CE[0]
        seen = np.empty_like(rays)
        x0, y0, z0 = (float(c) for c in before.r_CE_E[0])
        for k, d in enumerate(rays / np.linalg.norm(rays, axis=1, keepdims=True)):
            distance = ray_to_spheroid(x0, y0, z0, float(d[0]), float(d[1]), float(d[2]), 0.0)
            seen[k] = before.r_CE_E[0] + (1e12 if math.isnan(distance) else distance) * d
        pixels = [np.empty((len(seen), 2)) for _ in range(2)]
        for pose, out in zip((before, after), pixels, strict=True):
            project(lens.vector, (seen - pose.r_CE_E[0]) @ pose.dcm_CE[0].T, out)
        moved = np.linalg.norm(pixels[1] - pixels[0], axis=1)
        return float(np.max(moved[np.isfinite(moved)], initial=0.0))

    def _nodes(self, lens: _Lens, pose: Pose, sun: F64) -> _Nodes:
        shape = lens.node_x.shape
        lat, lon = np.empty(shape), np.empty(shape)
        light, mass, path = (np.empty(shape, np.float32) for _ in range(3))
        self._ground(lens.node_x, lens.node_y, 0, STEP, pose, sun, _Nodes(lat, lon, light, mass, path), None)
        return _Nodes(lat, lon, light, mass, path)

    def _ground(
        self, x: F64, y: F64, first: int, step: int, pose: Pose, sun: F64, out: _Nodes, terrain: Terrain | None
    ) -> bool:
        """Where rays meet the ground, and its light; whether no ray passes the ellipsoid."""
        lat, lon, light, mass, path = out
        r, dcm = pose.r_CE_E, pose.dcm_CE
        if not (hit := ground_band(x, y, first, step, r, dcm, sun, *out)):
            limb_band(x, y, first, step, r, dcm, sun, lat, light, mass, path)
        if terrain is not None:  # last: a mountain may stand where the ellipsoid is passed
            terrain_band(x, y, first, step, r, dcm, sun, *terrain, lat, lon, light)
        if not self.params.sunlight:
            light.fill(1.0)
            mass.fill(0.0)
            path.fill(0.0)
        elif self.params.sun_exponent != 1.0:
            soften(light, self.params.sun_exponent)
        return hit

    def _heights(self, nodes: _Nodes) -> Terrain | None:
        """Terrain in view, kept as long as the map reader gives the same window."""
        if self.maps.terrain is None:
            return None
        known = np.isfinite(nodes.lat)
        grid = self.maps.height_grid(nodes.lat[known], nodes.lon[known])
        if grid is None or grid is SEA_LEVEL:
            return None
        key = grid[1:], grid.heights.shape
        if self._terrain is None or self._terrain[0] != key:
            self._terrain = key, terrain_of(grid)
        return self._terrain[1]

    def _draw(self, lens: _Lens, pose: Pose, sun: F64) -> tuple[F32, NDArray[np.bool_]]:
        nodes = self._nodes(lens, pose, sun)
        terrain = self._heights(nodes)
        if terrain is not None:
            self._ground(lens.node_x, lens.node_y, 0, STEP, pose, sun, nodes, terrain)
        views = [v for layer in self.layers if (v := layer.view(nodes.lat, nodes.lon, STEP)) is not None]
        image = np.empty((*self.shape, 3), np.float32)
        todo = np.ones(self.shape, np.uint8)
        mask = np.ones(self.shape, np.bool_)
        smooth = self._smooth(nodes, views) if self.params.interpolated and self._lattice is None else None

        tops = iter(range(0, self.shape[0], BAND))  # one for all threads

        def work(_: int) -> bool:
            desk, sky = Desk(), False
            for top in tops:
                box: tuple[int, int, int, int] | None = top, min(top + BAND, self.shape[0]), 0, self.shape[1]
                if smooth is not None:
                    _cells(views, smooth, top, image, todo, desk)
                    box = _box(todo, top)
                if box is not None:
                    sky |= self._tile(lens, pose, sun, terrain, views, box, image, todo, mask, desk)
            return sky

        with ThreadPoolExecutor(self.workers) as pool:
            sky = list(pool.map(work, range(self.workers)))
        if any(sky) and self.params.star_gain > 0.0:
            u_N, light = self._stars
            count = max(len(pose.dcm_CE), len(pose.dcm_EN))
            dcm_CN = np.broadcast_to(pose.dcm_CE, (count, 3, 3)) @ np.broadcast_to(pose.dcm_EN, (count, 3, 3))
            gain = np.float32(self.params.star_gain * self.params.brightness)
            add_stars(image, todo == 2, lens.channels, lens.vector, dcm_CN, u_N, gain * light)
        return image, mask

    def _smooth(self, nodes: _Nodes, views: Sequence[View]) -> _Smooth:
        """The cells where everything but the map itself may be interpolated."""
        cells = nodes.lat.shape[0] - 1, nodes.lat.shape[1] - 1
        colour = np.empty((*nodes.lat.shape, 8), np.float32)
        node_colours(nodes.light, nodes.mass, nodes.path, self._depth, self.params.brightness, colour)
        free = np.ones(cells, np.uint8)
        uses: list[U8] = []
        for view in views:
            use = np.zeros(cells, np.uint8)
            rows, columns = (int(n) for n in view.window.levels[0, 1:])
            smooth_cells(view.at, view.prints, rows, columns, GRID_ERROR, free, use)
            uses.append(use)
        return _Smooth(colour, uses)

    def _tile(
        self, lens: _Lens, pose: Pose, sun: F64, terrain: Terrain | None, views: Sequence[View],
        box: tuple[int, int, int, int], image: F32, todo: U8, mask: NDArray[np.bool_], desk: Desk,
    ) -> bool:  # fmt: skip
        """Draw a part of the picture ray by ray; pixels of the sky get 2 in ``todo``. Returns whether there is any."""
        top, bottom, left, right = box
        part = slice(top, bottom), slice(left, right)
        x, y = (np.ascontiguousarray(a[part]) for a in (lens.x_tan, lens.y_tan))
        doubles = desk.array("ground", (2, *x.shape), np.float64)
        singles = desk.array("light", (3, *x.shape), np.float32)
        ground = _Nodes(*doubles, *singles)
        hit = self._ground(x, y, top, 1, pose, sun, ground, terrain)
        here, off = np.ascontiguousarray(todo[part]), None if hit else np.isnan(ground.lat)
        asked = here if off is None else np.where(off, np.uint8(0), here)
        want = asked.copy()
        seen = _reflectance(views, ground, top, left, want, desk)
        gaps = off is not None or bool(want.any())
        if gaps:
            seen[asked == want] = 0
        if self._lattice is not None:
            p, focal = self.params, float(np.sqrt(np.prod(self.camera.focal_px)))
            cloud_band(
                x, y, top, pose.r_CE_E, pose.dcm_CE, sun, ground.lat, ground.lon, self._lattice,
                threshold(p.clouds), p.cloud_height, focal, seen, ground.mass, want,
            )  # fmt: skip
        radiance = desk.array("radiance", (len(x), 4 * x.shape[1]), np.float32)
        flat = seen.reshape(len(x), -1)
        shade_band(flat, ground.light, ground.mass, ground.path, self._depth, self.params.brightness, radiance)
        whole = bool(here.all())
        picture = CV.cvtColor(radiance.reshape(*x.shape, 4), cv2.COLOR_RGBA2RGB, image[part] if whole else None)
        drawn = here == 1
        if not whole:
            np.copyto(image[part], picture, where=drawn[..., None])
        if gaps:
            np.copyto(mask[part], asked > want, where=drawn)
        if off is None or not off.any():
            return False
        todo[part][off & drawn] = 2
        return True


def _reflectance(views: Sequence[View], ground: _Nodes, top: int, left: int, want: U8, desk: Desk) -> U16:
    """What the maps show at places (rows, columns, 4); ``want`` becomes 0 where one of them has data."""
    seen = desk.array("seen", (*want.shape, 4), np.uint16)
    x, y = desk.array("places", (2, *want.shape), np.float32)
    first, column, cells = top // STEP, left // STEP, _cells_of(want.shape)
    fresh = True
    for view in views:
        corner = origin(view, first, first + cells[0])
        if corner is None or not want.any():
            continue
        window = view.window
        rows, columns = window.table.shape[:2]
        map_places(window.planes, rows, columns, window.frame, *corner, ground.lat, ground.lon, x, y)
        use = np.empty(cells, np.uint8)
        right, bottom = window.levels[0, 2] - 1.0 - corner[0], window.levels[0, 1] - 1.0 - corner[1]
        if easy_cells(x, y, right, bottom, want, first, column, view.prints, use):
            sample_cells(view, corner, x, y, first, column, use, seen, fresh, desk)
            keep_covered(seen.reshape(len(seen), -1), use, want)
        fresh = False
        if want.any():
            sample_band(x, y, *corner, top, left, STEP, view.prints, window.pixels, window.levels, seen, want)
    return seen


def _cells(views: Sequence[View], smooth: _Smooth, top: int, image: F32, todo: U8, desk: Desk) -> None:
    """Draw the cells to be interpolated in one band."""
    first = top // STEP
    size = min(BAND, image.shape[0] - top), image.shape[1]
    cells = _cells_of(size)
    seen = desk.array("seen", (*size, 4), np.uint16)
    x, y = desk.array("places", (2, *size), np.float32)
    fresh = True
    for view, uses in zip(views, smooth.uses, strict=True):
        use = uses[first : first + cells[0]].copy()
        corner = origin(view, first, first + cells[0])
        if corner is None or not use.any():
            continue
        spread_places(view.at, first, 0, *corner, x, y)
        sample_cells(view, corner, x, y, first, 0, use, seen, fresh, desk)
        keep_covered(seen.reshape(len(seen), -1), use, todo[top : top + size[0]])
        fresh = False
    if not fresh:
        radiance = desk.array("radiance", (size[0], 4 * size[1]), np.float32)
        light_cells(seen.reshape(len(seen), -1), first, 0, smooth.colour, radiance)
        CV.cvtColor(radiance.reshape(*size, 4), cv2.COLOR_RGBA2RGB, image[top : top + size[0]])


def _cells_of(size: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of cells that pixels need."""
    return -(-size[0] // STEP), -(-size[1] // STEP)


def _check(pose: Pose) -> None:
    r = pose.r_CE_E
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(pose.dcm_CE))):
        raise ValueError("pose: expected finite numbers; look at what makes position and attitude of the camera")
    inside = np.sqrt((r[:, 0] ** 2 + r[:, 1] ** 2) / A**2 + r[:, 2] ** 2 / B**2)
    if float(inside.min()) <= 1.0:
        away = float(np.linalg.norm(r[int(inside.argmin())])) / 1e3
        text = f"expected a camera outside the Earth, got one {away:.1f} km from its centre"
        raise ValueError(f"pose.r_CE_E: {text}; positions are in m")


def _box(todo: U8, top: int) -> tuple[int, int, int, int] | None:
    """Rows and columns of a band that still have pixels to draw, or None."""
    band = todo[top : top + BAND]
    if not band.any():
        return None
    columns = np.flatnonzero(band.any(axis=0))
    return top, top + len(band), int(columns[0]) // STEP * STEP, int(columns[-1]) + 1
