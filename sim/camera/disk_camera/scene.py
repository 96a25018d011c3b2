"""What the disk camera looks at: bodies, where they are in its frame, and their exact limbs."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fsw.math.bodies import body as table_body
from fsw.math.camera import UNLIMITED, distort_slopes, project_point, undistort
from fsw.math.checks import require_rotation
from fsw.math.ellipsoid import ImageEllipse, ellipsoid_in_image, limb_ellipse, limb_pixels
from messages.base import F64
from sim.camera.detector import blurred
from sim.camera.disk_camera import edges, kernel
from sim.camera.disk_camera.texture import PLAIN, cubes

WORKERS = os.cpu_count() or 1
BAND = 16
"""Rows that a thread draws at a time."""
RIM = 256
"""Points of the limb that bound the pixels to draw."""
DOT = 987
"""Rays for a body smaller than two pixels: a Fibonacci number, so that they form a lattice without gaps."""
_DOT_STEP = 610 / 987
_UNIT_LENS = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, UNLIMITED])
F32 = NDArray[np.float32]
LAWS = {"lambert": kernel.LAMBERT, "lommel_seeliger": kernel.LOMMEL_SEELIGER, "minnaert": kernel.MINNAERT}


class DiskBody(msgspec.Struct, frozen=True, kw_only=True):
    """A planet or moon as the disk camera draws it.

    Attributes:
        body_id: NAIF identifier. axes: semi-axes (3,) along the axes of its frame P, m. dcm_PN: maps N to P components
            at time zero. rate: of its rotation about the z axis of P, rad/s. albedo: radiance where the Sun is
            overhead and so is the camera; 1 saturates the nominal detector. law: of reflection: "lambert",
            "lommel_seeliger" or "minnaert". exponent: of Minnaert's law, whose radiance is
            mu0^exponent mu^(exponent - 1): 1 is Lambert's, 0.5 a flat disk at full phase, larger ones darken the limb.
        colour: (3,), factors of red, green and blue on the albedo. texture: raster as `texture.cubes` takes it.
    """

    body_id: int
    axes: F64
    dcm_PN: F64 = msgspec.field(default_factory=lambda: np.eye(3))
    rate: float = 0.0
    albedo: float = 0.5
    law: str = "lambert"
    exponent: float = 1.0
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    texture: F32 | None = None

    def __post_init__(self) -> None:
        """Check all that could give a picture that looks right and is not.

        Raises:
            ValueError: names the field, what was expected and what came.
        """
        axes = np.asarray(self.axes, float)
        if axes.shape != (3,) or not np.all(np.isfinite(axes) & (axes > 0.0)):
            raise ValueError(f"DiskBody.axes: expected three lengths above 0 [m], got {self.axes}")
        if self.law not in LAWS:
            raise ValueError(f"DiskBody.law: expected one of {', '.join(LAWS)}, got {self.law!r}")
        require_rotation(self, "dcm_PN")
        numbers = {"albedo": (self.albedo,), "exponent": (self.exponent,), "colour": self.colour}
        for name, values in numbers.items():
            if not all(0.0 <= x < np.inf for x in values):
                raise ValueError(f"DiskBody.{name}: expected finite numbers of at least 0, got {values}")
        raster = self.texture
        if raster is not None and not (
            raster.ndim == 2 and raster.size and np.all(np.isfinite(raster) & (raster >= 0))
        ):
            text = "a raster (rows, columns) of finite numbers of at least 0"
            raise ValueError(f"DiskBody.texture: expected {text}, got one of shape {raster.shape}")

    def attitude(self, t_ns: int) -> F64:
        """dcm_PN at a simulation time."""
        angle = self.rate * (t_ns / 1e9)
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ self.dcm_PN


def disk_body(which: int | str, **changes: Any) -> DiskBody:
    """A body with the size and rotation of the table of bodies; ``changes`` are fields of `DiskBody`.

    Raises:
        ValueError: if the table has no such body.
    """
    known = table_body(which)
    polar = known.radius * (1.0 - known.flattening)
    given: dict[str, Any] = {"axes": np.array([known.radius, known.radius, polar]), "rate": known.rate, **changes}
    return DiskBody(body_id=known.naif, **given)


class Seen(NamedTuple):
    """A body in the camera's frame."""

    body: DiskBody
    r_PC_C: F64
    """Position of its centre relative to the camera (3,) [m]."""
    dcm_CP: F64
    """Maps body-fixed to camera components."""
    sun_C: F64
    """Unit vector from the body to the Sun (3,)."""


class DiskTruth(NamedTuple):
    """Where a body really is in an image."""

    body_id: int
    r_PC_C: F64
    """Position of its centre relative to the camera (3,) [m]."""
    center_px: F64
    """Image of its centre (2,), distorted."""
    limb_px: F64
    """Points of the whole limb (n, 2), lit or not, distorted; NaN where the lens does not see them."""
    ellipse: ImageEllipse
    """The limb without distortion."""
    sun_px: F64
    """Unit vector (2,) in the image towards the Sun, without distortion; NaN if it has no such direction."""
    phase: float
    """Angle at the body between the Sun and the camera [rad]."""


def truth(lens: F64, seen: Seen, points: int = 360) -> DiskTruth:
    """The exact image of a body's centre and limb."""
    x, y, z = (float(c) for c in seen.r_PC_C)
    distance = float(np.linalg.norm(seen.r_PC_C))
    shift = seen.sun_C[:2] * z - seen.r_PC_C[:2] * seen.sun_C[2]  # of the tangents x/z, y/z along the way to the Sun
    shift = np.array([lens[0] * shift[0] + lens[4] * shift[1], lens[1] * shift[1]])
    length = float(np.linalg.norm(shift))
    return DiskTruth(
        seen.body.body_id,
        seen.r_PC_C,
        np.array(project_point(lens, x, y, z)),
        limb_pixels(lens, seen.body.axes, seen.dcm_CP, seen.r_PC_C, points),
        ellipsoid_in_image(lens, seen.body.axes, seen.dcm_CP, seen.r_PC_C),
        shift / length if length > 0.0 else np.full(2, np.nan),
        float(np.arccos(np.clip(-seen.r_PC_C @ seen.sun_C / distance, -1.0, 1.0))),
    )


def body_numbers(seen: Seen, focal_px: float, brightness: float) -> F64:
    """What `sim.camera.disk_camera.kernel` wants to know of a body, (25,).

    Raises:
        ValueError: if the camera is inside the body.
    """
    body, out = seen.body, np.empty(kernel.BODY_SIZE)
    unit = float(body.axes.min())
    dcm_PC = seen.dcm_CP.T
    start = -(dcm_PC @ seen.r_PC_C) / body.axes
    away = float(np.linalg.norm(start))
    if not away > 1.0:
        where = f"{np.linalg.norm(seen.r_PC_C):.6g} m from the centre of body {body.body_id}"
        raise ValueError(f"disk camera: expected a camera outside of every body, got one inside, {where}")
    out[:9] = (dcm_PC * (unit / body.axes)[:, None]).ravel()
    out[9:12] = start
    out[12:15] = unit / body.axes
    out[15:18] = unit / body.axes * (dcm_PC @ seen.sun_C)
    out[18:21] = body.axes
    out[21:24] = LAWS[body.law], body.exponent, brightness
    out[24] = 2.0 * float(np.linalg.norm(seen.r_PC_C)) / unit / focal_px
    return out


class Edges(NamedTuple):
    """Where the light near limbs falls, see `sim.camera.disk_camera.edges`."""

    fine: F32
    """Cells of half a pixel (2 H + 2, 2 W + 2)."""
    edge: NDArray[np.uint8]
    """(H, W), 1 for pixels whose light is in cells."""


NO_EDGES = Edges(np.zeros((0, 0), np.float32), np.zeros((0, 0), np.uint8))


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(WORKERS)


def behind_optics(light: F32, drawn: Edges, sigma_px: float) -> F32:
    """What the detector gets: light (H, W) spread by a Gaussian, that of limbs from where it falls in the pixels."""
    height, width = light.shape
    reach, out = math.ceil(5.0 * sigma_px + 2.0), np.zeros_like(light)
    rows = np.flatnonzero(light.any(axis=1))
    if rows.size:
        lit = np.flatnonzero(light[rows[0] : rows[-1] + 1].any(axis=0))
        part = np.s_[max(rows[0] - reach, 0) : rows[-1] + reach + 1, max(lit[0] - reach, 0) : lit[-1] + reach + 1]
        out[part] = blurred(light[part], sigma_px)
    near = np.zeros((-(-height // edges.TILE), -(-width // edges.TILE)), np.uint8)
    edges.mark(drawn.edge, reach, near)
    weight = edges.weights(sigma_px).astype(np.float32)

    def tile(place: tuple[int, int]) -> None:
        edges.blur_tile(place[0] * edges.TILE, place[1] * edges.TILE, light, *drawn, weight, out)

    list(_pool().map(tile, np.argwhere(near).tolist()))
    return out


class Textures:
    """The cubes of the bodies that have a texture, made once."""

    def __init__(self, bodies: Sequence[DiskBody]) -> None:
        self._cubes = {b.body_id: cubes(b.texture) for b in bodies if b.texture is not None}

    def of(self, seen: Seen, focal_px: float) -> F32:
        """The cube whose cells are about as large as pixels in the middle of the disk."""
        levels = self._cubes.get(seen.body.body_id)
        if levels is None:
            return PLAIN
        size = float(np.cbrt(np.prod(seen.body.axes)))
        height = max(float(np.linalg.norm(seen.r_PC_C)) - size, 1e-3 * size)
        wanted = 2.0 * focal_px * size / height  # cells along an edge, two in a tangent of 45 degrees each way
        return min(levels, key=lambda c: abs(np.log(wanted / (c.shape[1] - 2))))


class Sight:
    """One lens on one detector: the directions of its pixels, made once, and drawing with them.

    Attributes:
        lens: as `fsw.math.camera.lens_vector` makes it. height_px, width_px: of the image.
    """

    def __init__(self, lens: F64, height_px: int, width_px: int) -> None:
        self.lens, self.height_px, self.width_px = lens, height_px, width_px
        v, u = np.mgrid[-1.0 : height_px + 1.0, -1.0 : width_px + 1.0]
        self._grid = np.empty((height_px + 2, width_px + 2, 2))
        undistort(lens, np.column_stack([u.ravel(), v.ravel()]), self._grid.reshape(-1, 2))

    def draw_stars(self, u_C: F64, light: F64, out: F32) -> None:
        """Add stars: directions (n, 3), camera components, and their light, radiance times square pixels (n,)."""
        for direction, amount in zip(u_C.tolist(), light.tolist(), strict=True):
            u, v = project_point(self.lens, *direction)
            if -1.0 < u < self.width_px and -1.0 < v < self.height_px:
                kernel.add_star(u, v, amount, out)

    def draw(self, seen: Seen, brightness: float, textures: Textures, out: F32, edges: Edges = NO_EDGES) -> None:
        """Draw a body over what ``out`` (H, W) shows already; ``edges`` keep where the light of its limb falls.

        Raises:
            ValueError: if the camera is inside the body.
        """
        focal = float(min(self.lens[0], self.lens[1]))
        numbers, faces = body_numbers(seen, focal, brightness), textures.of(seen, focal)
        rows, columns = self._touched(seen)
        if not (rows and columns):
            return
        if 2.0 / numbers[24] < 1.0:  # its radius in pixels
            self._draw_dot(seen, numbers, faces, out)
            return
        starts = range(rows.start, rows.stop, BAND)

        def band(start: int) -> None:
            part = start, min(start + BAND, rows.stop), columns.start, columns.stop
            kernel.draw(numbers, faces, self._grid, *part, out, *edges)

        # A pixel writes to itself and, of the edges, to the next row too: neighbouring bands take turns, and the number
        # of threads changes nothing but the time
        for turn in range(2):
            list(_pool().map(band, starts[turn::2]))

    def edges(self) -> Edges:
        """Room for where the light near limbs falls; only what is touched becomes memory."""
        size = self.height_px, self.width_px
        return Edges(np.zeros((2 * size[0] + 2, 2 * size[1] + 2), np.float32), np.zeros(size, np.uint8))

    def _touched(self, seen: Seen) -> tuple[range, range]:
        """Rows and columns around the limb; all of them if a part of it is not seen; none if the body is behind."""
        body = seen.body
        if seen.r_PC_C[2] < -float(body.axes.max()):
            return range(0), range(0)
        limb = limb_pixels(self.lens, body.axes, seen.dcm_CP, seen.r_PC_C, RIM)
        if not np.all(np.isfinite(limb)):
            return range(self.height_px), range(self.width_px)
        margin = 2.0 + 1e-3 * np.ptp(limb, axis=0)  # the limb bulges between its points
        low, high = np.floor(limb.min(axis=0) - margin), np.ceil(limb.max(axis=0) + margin) + 1.0
        size = np.array([self.width_px, self.height_px])
        left, top = (int(x) for x in np.clip(low, 0, size))
        right, bottom = (int(x) for x in np.clip(high, 0, size))
        return range(top, bottom), range(left, right)

    def _draw_dot(self, seen: Seen, numbers: F64, faces: F32, out: F32) -> None:
        """A body of a pixel or less, by rays inside its limb that lie closer together near it, as crescents do."""
        u, v = project_point(self.lens, *(float(c) for c in seen.r_PC_C))
        x, y, xx, xy, yy = limb_ellipse(_UNIT_LENS, seen.body.axes, seen.dcm_CP, seen.r_PC_C)
        if np.isnan(u) or np.isnan(x):
            return
        root = np.linalg.cholesky(np.array([[xx, xy], [xy, yy]]))
        n = np.arange(DOT) + 0.5
        depth, turn = n / DOT, 2.0 * np.pi * (n * _DOT_STEP % 1.0)  # the radius is sqrt(1 - depth^2)
        circle = np.sqrt(1.0 - depth * depth)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        tangents = np.array([x, y]) + circle @ root.T
        a, b, _ = (seen.r_PC_C / seen.r_PC_C[2]).tolist()
        slopes = np.array(distort_slopes(self.lens, a, b)).reshape(2, 2)
        slopes = np.array([[self.lens[0], self.lens[4]], [0.0, self.lens[1]]]) @ slopes  # pixels by tangents
        places = np.array([u, v]) + (tangents - np.array([a, b])) @ slopes.T
        area = 2.0 * np.pi * depth / DOT * float(np.linalg.det(slopes) * np.linalg.det(root))
        kernel.add_point(numbers, faces, places, tangents, area, out)
