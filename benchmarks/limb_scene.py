"""Rendered disks whose exact place is known, and the finders' answer to them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from fsw import Module, OutPort
from fsw.math.bodies import body as table_body
from fsw.math.camera import lens_vector
from fsw.ports import In
from fsw.streams import stream_words
from messages.base import F64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, CameraImageMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.opnav.circle_finder import CircleFinder
from modules.opnav.horizon_nav import HorizonNav
from modules.opnav.limb_finder import LimbFinder
from modules.opnav.pixel_line_converter import PixelLineConverter
from sim.camera.detector import DetectorParams, blurred, expose
from sim.camera.disk_camera import DiskTruth, disk_body, invented
from sim.camera.disk_camera.scene import DiskBody, Seen, Sight, Textures, truth

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
MARS = table_body("Mars")
AU = 1.496e11
PSF_PX = 0.7
OVER = 3
"""Subpixels along each side: the light is blurred before the pixels sum it up, as it is in a camera."""
DETECTOR = DetectorParams(shot_noise=True, read_noise=20.0, bits=12, black_level=0.01)
EDGE = 30.0
"""Space around a disk in its image [px]."""
BAND_PX = 6.0
"""Pixels so far from the exact limb count for the bound."""
HORN = math.radians(82.0)
"""And so far from the Sun's azimuth: at the horns light ends, and the terminator begins."""
SECTORS = 24
"""Of the limb, in which its light is free."""


class Case(NamedTuple):
    """A disk to look at."""

    radius_px: float
    phase_deg: float = 30.0
    off_axis_deg: float = 0.0
    arc_deg: float = 360.0
    """Of the limb, lit or not, that is in the image; the Sun's side."""
    law: str = "any"
    """Of reflection, as in `DiskBody`."""
    contrast: float = 0.0
    """Of the texture."""
    full_well: float = 1000.0
    """Electrons: the fewer, the more noise."""
    side_px: int = 0
    """Of a square image with the principal point in its middle and the disk somewhere in it; 0: one around the disk."""


class Scene:
    """One disk: Mars, its exact place, and pictures of it."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        """Place it: the Sun's azimuth, way off the axis, attitude of Mars and part of a pixel are random."""
        self.case, self.well = case, case.full_well
        self.focal = focal = 1500.0 if case.radius_px < 500.0 else 2500.0
        tangent = case.radius_px / focal
        self.range = MARS.radius / math.sin(math.atan(tangent))
        off, turn = math.radians(case.off_axis_deg), rng.uniform(0.0, 2.0 * math.pi)
        direction = np.array([math.sin(off) * math.cos(turn), math.sin(off) * math.sin(turn), math.cos(off)])
        self.r_PC_C = self.range * direction
        # the Sun at the phase angle from the direction to the camera, at a random azimuth
        azimuth, phase = rng.uniform(0.0, 2.0 * math.pi), math.radians(case.phase_deg)
        e1 = np.cross(direction, [0.3, 0.5, -0.8])
        e1 /= np.linalg.norm(e1)
        across = math.cos(azimuth) * e1 + math.sin(azimuth) * np.cross(direction, e1)
        self.sun_C = -math.cos(phase) * direction + math.sin(phase) * across
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        self.dcm_CP = q * np.sign(np.linalg.det(q))
        self.body = _mars(case, rng)
        self.camera = self._camera(focal, across, rng)
        self.lens = lens_vector(self.camera)
        fine = self.lens.copy()
        fine[[0, 1, 4]] *= OVER
        fine[2:4] = OVER * (fine[2:4] + 0.5) - 0.5
        self.sight = Sight(fine, OVER * self.camera.height_px, OVER * self.camera.width_px)
        self.textures = Textures([self.body])
        self.truth = self.exact()

    def _camera(self, focal: float, sun: F64, rng: np.random.Generator) -> CameraConfigMsg:
        """A window around the disk; for a part of the limb, one whose edge cuts off the rest."""
        wide = CameraConfigMsg(width_px=1, height_px=1, focal_px=np.full(2, focal), center_px=np.zeros(2))
        exact = truth(lens_vector(wide), self._seen(self.r_PC_C), 720)
        limb = exact.limb_px
        low, high = limb.min(axis=0) - EDGE, limb.max(axis=0) + EDGE
        if self.case.arc_deg < 360.0:
            # of the four sides take the one nearest to the Sun's azimuth
            toward = sun[:2] if self.case.phase_deg > 0.0 else rng.normal(size=2)
            axis = int(abs(toward[1]) > abs(toward[0]))
            way = 1.0 if toward[axis] > 0.0 else -1.0
            middle = 0.5 * (low + high)
            cut = middle[axis] + way * self.case.radius_px * math.cos(math.radians(0.5 * self.case.arc_deg))
            if way > 0.0:
                low[axis] = cut
            else:
                high[axis] = cut
        low += rng.uniform(-0.5, 0.5, 2)
        if side := self.case.side_px:
            return msgspec.structs.replace(wide, width_px=side, height_px=side, center_px=np.full(2, (side - 1) / 2.0))
        size = np.ceil(high - low).astype(int)
        return CameraConfigMsg(
            width_px=max(int(size[0]), 40),
            height_px=max(int(size[1]), 40),
            focal_px=np.full(2, focal),
            center_px=-low,
        )

    def _seen(self, r_PC_C: F64) -> Seen:
        return Seen(self.body, r_PC_C, self.dcm_CP, self.sun_C)

    def exact(self, points: int = 7200) -> DiskTruth:
        """Limb and centre."""
        return truth(self.lens, self._seen(self.r_PC_C), points)

    def radiance(self, r_PC_C: F64 | None = None, body: DiskBody | None = None, psf_px: float = PSF_PX) -> F32:
        """What falls on the detector, (H, W); from another place, of another body, with another blur."""
        out = np.zeros((self.sight.height_px, self.sight.width_px), np.float32)
        seen = self._seen(self.r_PC_C if r_PC_C is None else r_PC_C)
        textures = self.textures if body is None else Textures([body])
        seen = seen if body is None else seen._replace(body=body)
        self.sight.draw(seen, seen.body.albedo, textures, out)
        out = blurred(out, OVER * psf_px)
        return out.reshape(self.camera.height_px, OVER, self.camera.width_px, OVER).mean(axis=(1, 3))

    def expected(self, *change: Any, **changes: Any) -> F64:
        """Grey levels without noise, limits and quantisation, (H, W); arguments as of `radiance`."""
        light = self.radiance(*change, **changes).astype(float)
        return 255.0 * (light + DETECTOR.black_level)

    def near_limb(self) -> tuple[F64, NDArray[np.int64]]:
        """Signed distance of each pixel (H, W) from the limb, positive outside, and its sector; -1: not near."""
        limb = self.truth.limb_px
        rows, columns = self.camera.height_px, self.camera.width_px
        y, x = np.mgrid[0:rows, 0:columns]
        pixels = np.column_stack([x.ravel(), y.ravel()]).astype(float)
        tree: Any = KDTree(limb)
        away: F64
        which: NDArray[np.int64]
        away, which = tree.query(pixels, distance_upper_bound=BAND_PX)
        found = np.isfinite(away)
        d, sector = np.zeros(len(away)), np.full(len(away), -1)
        d[found] = across(self.truth, pixels[found], which[found])
        way = limb - self.truth.ellipse.center_px
        turn = np.arctan2(way[:, 1], way[:, 0]) / (2.0 * math.pi) % 1.0
        lit = np.ones(len(limb), np.bool_)
        if self.case.phase_deg > 0.0:
            lit = way @ self.truth.sun_px > math.cos(HORN) * np.linalg.norm(way, axis=1)
        number = np.where(lit, np.minimum((turn * SECTORS).astype(np.int64), SECTORS - 1), -1)
        sector[found] = number[which[found]]
        return d.reshape(rows, columns), sector.reshape(rows, columns)

    def errors(self, points: F64) -> F64:
        """How far outside of the exact limb points (n, 2) are [px]."""
        tree: Any = KDTree(self.truth.limb_px)
        return across(self.truth, points, tree.query(points)[1])

    def edges(self, points: F64) -> F64:
        """How the exact limb moves away from points (n, 2) inward, by the position (n, 3) [px/m]: H of each edge."""
        columns: list[F64] = []
        step = 2e-5 * self.range
        for axis in np.eye(3):
            ends: list[F64] = []
            for way in (-step, step):
                limb = truth(self.lens, self._seen(self.r_PC_C + way * axis), 7200)
                tree: Any = KDTree(limb.limb_px)
                ends.append(across(limb, points, tree.query(points)[1]))
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        return np.column_stack(columns)

    def picture(self, light: F32, seed: int) -> U8:
        """A picture with noise."""
        return expose(
            light, msgspec.structs.replace(DETECTOR, full_well=self.well), stream_words(seed, "limb", "noise")
        )


def across(exact: DiskTruth, points: F64, which: NDArray[np.int64]) -> F64:
    """Signed distance of points (n, 2) from a limb, positive outside; ``which`` point of it is the nearest."""
    limb = exact.limb_px
    along = np.roll(limb, -1, axis=0) - np.roll(limb, 1, axis=0)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    normal *= np.sign(np.sum(normal * (limb - exact.ellipse.center_px), axis=1))[:, None]
    return np.sum((points - limb[which]) * normal[which], axis=1)


def _mars(case: Case, rng: np.random.Generator) -> DiskBody:
    more: dict[str, Any] = {"exponent": 0.75} if case.law == "minnaert" else {}
    if case.contrast > 0.0:
        more["texture"] = invented(seed=int(rng.integers(1000)), contrast=case.contrast)
    return disk_body("Mars", albedo=0.55, law=case.law, **more)


class Chain:
    """A finder and what makes a position of its answer, fed by hand."""

    def __init__(self, scene: Scene, kind: str) -> None:
        """Connect the modules; kind is "limb" or "circle"."""
        self.scene = scene
        self.finder: LimbFinder | CircleFinder
        self.converter: HorizonNav | PixelLineConverter
        if kind == "limb":
            limb, horizon = LimbFinder("finder"), HorizonNav("converter")
            limb.out_limb.connect(horizon.in_limb)
            self.finder, self.converter = limb, horizon
        else:
            # CircleFinder gives centre and mean radius of the whole limb, so `lit_half` stays off
            circle, line = CircleFinder("finder"), PixelLineConverter("converter")
            circle.out_circles.connect(line.in_circles)
            self.finder, self.converter = circle, line
        owner, self.sources = Module("sources"), dict[str, list[OutPort[Any]]]()
        for module in (self.finder, self.converter):
            for name, port in module.ports.items():
                reader = vars(module)[name]
                if isinstance(port, In) and reader.source is None:
                    source = OutPort(owner, name, port.kind)
                    source.connect(reader)
                    self.sources.setdefault(name, []).append(source)
        self._write("in_camera", scene.camera)
        self._write("in_attitude", NavAttMsg(sigma_BN=np.zeros(3), omega_BN_B=np.zeros(3)))
        self._write("in_orientation", PlanetOrientationMsg(dcm_EN=scene.dcm_CP.T, omega_EN_N=np.zeros(3)))
        self._write(
            "in_sun", EphemerisMsg(body_id=10, mu=1.3e20, radius=7e8, r_PN_N=AU * scene.sun_C, v_PN_N=np.zeros(3))
        )

    def _write(self, name: str, message: Any) -> None:
        for source in self.sources.get(name, []):
            source.write(message, 0)

    def find(self, image: U8) -> None:
        """Let the finder look at an image."""
        self._write("in_image", CameraImageMsg(image=image, exposure_ns=0))
        self.finder.step(0)

    def convert(self) -> OpNavMsg:
        """The position from what was found last."""
        self.converter.state.seen = 0  # so that the same answer is taken again
        self.converter.step(0)
        answer = self.converter.out_position.latest()
        assert answer is not None
        return answer

    def look(self, image: U8) -> OpNavMsg:
        """The position from an image."""
        self.find(image)
        return self.convert()

    def circle(self) -> F64 | None:
        """Column, row, radius of the first circle found [px], if there is one."""
        assert isinstance(self.finder, CircleFinder)
        found = self.finder.out_circles.latest()
        if found is None or not found.valid:
            return None
        return np.append(found.center_px[0], found.radius_px[0])

    def points(self) -> F64:
        """Points of the limb found (n, 2) [px]."""
        assert isinstance(self.finder, LimbFinder)
        found = self.finder.out_limb.latest()
        assert found is not None
        return found.limb_px[: found.count]
