"""Disks against brute force, closed forms of the light of a sphere, and the places where spots must appear."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from fsw.math.attitude import dcm_to_mrp
from fsw.math.camera import lens_vector, project_point
from fsw.math.compiled import COMPILE, plain
from fsw.math.stars import StarCatalogue
from fsw.math.vectors import mat3
from fsw.math.view_geometry import north_up
from messages.base import F64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg
from messages.states import SCStatesMsg
from sim.camera.disk_camera import DiskBody, DiskCamera, disk_body, scene
from sim.camera.disk_camera.scene import Seen, Sight, Textures, behind_optics, truth
from sim.camera.disk_camera.texture import cubes, invented

CV: Any = cv2
Criterion = Callable[[str, float], None]
SIZE = 160 if COMPILE else 40
ANGLE_OF_THE_SUN = [0.0, 1.0, 2.5, -2.0]


def config(size: int = SIZE, focal: float = 500.0, **changes: Any) -> CameraConfigMsg:
    middle = (size - 1) / 2.0
    given: dict[str, Any] = {"width_px": size, "height_px": size, "focal_px": [focal, focal]}
    given |= {"center_px": [middle, middle], **changes}
    return CameraConfigMsg(**given)


def drawn(seen: Seen, camera: CameraConfigMsg, background: float = 0.0) -> F64:
    """Radiance, albedo 1."""
    out = np.full((camera.height_px, camera.width_px), background, np.float32)
    Sight(lens_vector(camera), camera.height_px, camera.width_px).draw(seen, 1.0, Textures([seen.body]), out)
    return out.astype(np.float64)


def sun_at(phase: float, towards: float) -> F64:
    """Unit vector from the body to the Sun: the phase, and the direction in the image, seen straight ahead."""
    return np.array([math.sin(phase) * math.cos(towards), math.sin(phase) * math.sin(towards), -math.cos(phase)])


def turned(seed: int) -> F64:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


def cast(seen: Seen, tangents: F64) -> F64:
    """Radiance of rays (n, 2), by the quadratic equation of the body's surface."""
    d = np.column_stack([tangents, np.ones(len(tangents))]) @ seen.dcm_CP
    start, axes = -seen.dcm_CP.T @ seen.r_PC_C, seen.body.axes
    a, b, c = ((d / axes) ** 2).sum(1), 2.0 * (d * start / axes**2).sum(1), ((start / axes) ** 2).sum() - 1.0
    square = b * b - 4.0 * a * c
    t = (-b - np.sqrt(np.maximum(square, 0.0))) / (2.0 * a)
    normal = (start + t[:, None] * d) / axes**2
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    mu = -(normal * d).sum(1) / np.linalg.norm(d, axis=1)
    mu0 = np.maximum(normal @ (seen.dcm_CP.T @ seen.sun_C), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        k = seen.body.exponent
        laws = {"lambert": mu0, "lommel_seeliger": 2.0 * mu0 / (mu0 + mu), "minnaert": mu0**k * mu ** (k - 1.0)}
    return np.where((square > 0.0) & (t > 0.0) & (mu0 > 0.0), laws[seen.body.law], 0.0)


def brute(seen: Seen, camera: CameraConfigMsg, pixels: F64, across: int) -> F64:
    """Mean radiance of pixels (n, 2) by a square grid of rays in each, with OpenCV's inverse of the lens."""
    steps = (np.arange(across) + 0.5) / across - 0.5
    offset = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    k = np.array([[camera.focal_px[0], 0.0, camera.center_px[0]], [0.0, camera.focal_px[1], camera.center_px[1]]])
    k = np.vstack([k, [0.0, 0.0, 1.0]])
    places = (pixels[:, None] + offset).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12)
    tangents = CV.undistortPoints(places, k, camera.distortion, R=np.eye(3), P=np.eye(3), criteria=criteria)[:, 0]
    return cast(seen, tangents).reshape(len(pixels), -1).mean(axis=1)


BODIES: dict[str, Any] = {
    "sphere": {"axes": np.full(3, 1e6)},
    "spheroid": {"axes": np.array([1e6, 1e6, 0.9e6]), "law": "lommel_seeliger"},
    "triaxial": {"axes": np.array([1.2e6, 1e6, 0.7e6]), "law": "minnaert", "exponent": 0.8},
}


@pytest.mark.parametrize("phase", [0.3, 1.2, 2.3])
@pytest.mark.parametrize("name", BODIES)
def test_radiance_against_brute_force(criterion: Criterion, name: str, phase: float) -> None:
    """Off the axis, distorted; every pixel of a frame by 16 rays, those that differ by 1,600."""
    size = min(SIZE, 96)
    camera = config(size=size, distortion=np.array([-0.3, 0.1, 2e-3, -1e-3, 0.0]))
    radius = 0.3 * size
    r = 1e6 * 500.0 / radius * np.array([0.03, -0.02, 1.0])
    seen = Seen(DiskBody(body_id=1, **BODIES[name]), r, turned(3), sun_at(phase, 1.0))
    found = drawn(seen, camera)
    v, u = np.mgrid[:size, :size]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    expected = brute(seen, camera, pixels, 4)
    rough = np.flatnonzero(np.abs(expected - found.ravel()) > 0.001)
    expected[rough] = brute(seen, camera, pixels[rough], 40)
    error = np.abs(found.ravel() - expected).reshape(size, size)
    inside = CV.erode((expected > 0.0).reshape(size, size).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert expected.max() > 0.3 and (phase > 2.0 or np.count_nonzero(inside) > 30)
    criterion("DISK-1", error.max())
    criterion("DISK-2", error[inside].max(initial=0.0))


def behind_lens(seen: Seen, camera: CameraConfigMsg, sigma_px: float) -> F64:
    """Light of the pixels: 16 x 16 rays in each, spread by a Gaussian on their grid, then summed over the pixels."""
    size, across = camera.width_px, 16
    at = ((np.arange(size * across) + 0.5) / across - 0.5 - camera.center_px[0]) / camera.focal_px[0]
    rows = [cast(seen, np.column_stack([at, np.full(len(at), y)])) for y in at]
    light = ndimage.gaussian_filter(np.array(rows), sigma_px * across, truncate=6.0)
    return light.reshape(size, across, size, across).mean(axis=(1, 3))


@pytest.mark.skipif(not COMPILE, reason="half a million rays")
@pytest.mark.parametrize("sigma_px", [0.5, 0.8, 1.4])
@pytest.mark.parametrize("law", [("lambert", 1.0), ("lommel_seeliger", 1.0)])
def test_place_of_a_blurred_limb(criterion: Criterion, law: tuple[str, float], sigma_px: float) -> None:
    """By least squares, for each arc of 30 degrees of the lit limb that is 45 degrees and more from the cusps."""
    camera, radius, towards = config(size=40), 13.7, 0.4
    body = DiskBody(body_id=1, axes=np.full(3, 1e6), law=law[0], exponent=law[1])
    r = 1e6 * 500.0 / radius * np.array([0.37 / 500.0, -0.21 / 500.0, 1.0])
    seen = Seen(body, r, np.eye(3), sun_at(0.6, towards))
    larger = seen._replace(body=DiskBody(body_id=1, axes=np.full(3, 1.01e6), law=law[0], exponent=law[1]))
    sight, out = Sight(lens_vector(camera), 40, 40), np.zeros((40, 40), np.float32)
    edges = sight.edges()
    sight.draw(seen, 1.0, Textures([body]), out, edges)
    expected = behind_lens(seen, camera, sigma_px)
    slope = (behind_lens(larger, camera, sigma_px) - expected) / (0.01 * radius)
    wrong = behind_optics(out, edges, sigma_px) - expected
    v, u = np.mgrid[:40, :40] - 19.5
    angle = np.arctan2(v + 0.21, u - 0.37) - towards
    arcs = [np.abs(np.angle(np.exp(1j * (angle - middle)))) < np.pi / 12 for middle in np.radians([-30, 0, 30])]
    places = [float((slope[arc] * wrong[arc]).sum() / (slope[arc] ** 2).sum()) for arc in arcs]
    criterion("DISK-9", max(abs(x) for x in places))


def circle_coverage(center: F64, radius: float, size: int) -> F64:
    """Part of each pixel inside a circle: exact along the rows, 400 lines in each."""
    out = np.zeros((size, size))
    left = np.arange(size) - 0.5
    for i in range(size):
        lines = i - 0.5 + (np.arange(400) + 0.5) / 400.0
        half = np.sqrt(np.maximum(radius**2 - (lines - center[1]) ** 2, 0.0))[:, None]
        low, high = np.maximum(left, center[0] - half), np.minimum(left + 1.0, center[0] + half)
        out[i] = np.maximum(high - low, 0.0).mean(axis=0)
    return out


@pytest.mark.parametrize("radius_px", [1.3, 4.0, 15.5, 55.3])
def test_coverage_of_the_limb(criterion: Criterion, radius_px: float) -> None:
    """A flat disk (Lommel-Seeliger at full phase, far away), over a background that it hides."""
    radius_px = min(radius_px, 0.45 * SIZE)
    camera = config(focal=1e8)
    shift = np.array([0.31, -0.27])
    body = DiskBody(body_id=1, axes=np.full(3, 1e6), law="lommel_seeliger")
    r = 1e6 * 1e8 / radius_px * np.array([shift[0] / 1e8, shift[1] / 1e8, 1.0])
    found = drawn(Seen(body, r, turned(1), sun_at(0.0, 0.0)), camera, background=0.25)
    coverage = circle_coverage(camera.center_px + shift, radius_px, SIZE)
    error = found - (0.25 + 0.75 * coverage)
    criterion("DISK-3", np.abs(error).max() / 0.75)
    area = ((found - 0.25) / 0.75).sum()
    # the radius from the area: hundredths of a pixel would bias every limb finder tested on such pictures
    criterion("DISK-4", math.sqrt(area / math.pi) - radius_px)


@pytest.mark.parametrize("phase_deg", [0, 30, 60, 90, 120, 150])
@pytest.mark.parametrize("radius_px", [0.02, 0.4, 3.0, 50.0])
def test_light_of_a_sphere(criterion: Criterion, radius_px: float, phase_deg: int) -> None:
    """The integral over the disk: Lambert's 2/3 (sin a + (pi - a) cos a) / pi, and Lommel-Seeliger's."""
    radius_px = min(radius_px, 0.4 * SIZE)
    a, camera = math.radians(phase_deg), config(focal=1e5)
    r = 1e6 * 1e5 / radius_px * np.array([3e-6, 8e-6, 1.0])
    lambert = 2.0 / 3.0 * (math.sin(a) + (math.pi - a) * math.cos(a)) / math.pi
    seeliger = 1.0 if a == 0.0 else 1.0 - math.sin(a / 2) * math.tan(a / 2) * math.log(1.0 / math.tan(a / 4))
    for law, expected in [("lambert", lambert), ("lommel_seeliger", seeliger)]:
        seen = Seen(DiskBody(body_id=1, axes=np.full(3, 1e6), law=law), r, np.eye(3), sun_at(a, 0.7))
        total = drawn(seen, camera).sum() / (math.pi * radius_px**2)
        criterion("DISK-5", (total - expected) / max(expected, 0.1))


@pytest.mark.parametrize("towards", ANGLE_OF_THE_SUN)
@pytest.mark.parametrize("phase", [0.6, 1.6, 2.4])
def test_the_bright_side_faces_the_sun(criterion: Criterion, phase: float, towards: float) -> None:
    """From the middle of the disk to the centroid of the light: the direction of the Sun in the image."""
    camera = config(focal=5000.0)
    r = np.array([0.0, 0.0, 1e6 * 5000.0 / (0.35 * SIZE)])
    seen = Seen(DiskBody(body_id=1, axes=np.full(3, 1e6)), r, np.eye(3), sun_at(phase, towards))
    light = drawn(seen, camera)
    v, u = np.mgrid[:SIZE, :SIZE]
    away = np.array([(u * light).sum(), (v * light).sum()]) / light.sum() - camera.center_px
    assert away @ [math.cos(towards), math.sin(towards)] > 0.05 * SIZE
    criterion("DISK-6", math.remainder(math.atan2(away[1], away[0]) - towards, 2.0 * math.pi))
    exact = truth(lens_vector(camera), seen)
    np.testing.assert_allclose(exact.sun_px, [math.cos(towards), math.sin(towards)], atol=1e-9)
    assert exact.phase == pytest.approx(phase, abs=1e-9)


def spots(*places_deg: tuple[float, float]) -> np.ndarray:
    """A raster with a bright spot, 1.5 degrees in radius, at each latitude and longitude."""
    rows = 1024
    lat = np.radians(90.0 - (np.arange(rows) + 0.5) * 180.0 / rows)[:, None]
    lon = np.radians((np.arange(2 * rows) + 0.5) * 180.0 / rows - 180.0)[None, :]
    out = np.full((rows, 2 * rows), 0.05)
    for la, lo in places_deg:
        a, b = math.radians(la), math.radians(lo)
        cos = np.sin(lat) * math.sin(a) + np.cos(lat) * math.cos(a) * np.cos(lon - b)
        out += np.where(cos > math.cos(math.radians(1.5)), 1.0, 0.0)
    return out


@pytest.mark.skipif(not COMPILE, reason="a small image does not resolve the spots")
@pytest.mark.parametrize(
    "place_deg", [(0.0, 0.0), (20.0, 0.0), (-20.0, 0.0), (0.0, 25.0), (0.0, -25.0), (15.0, 179.0), (88.0, 30.0)]
)
def test_spots_of_a_texture_are_where_they_belong(criterion: Criterion, place_deg: tuple[float, float]) -> None:
    """The mirror test with a north-up camera over each place in turn: south-east of the middle is right and below."""
    size = SIZE * 2
    body = DiskBody(body_id=1, axes=np.full(3, 1e6), law="lommel_seeliger", texture=spots(place_deg))
    lat, lon = (math.radians(a) for a in place_deg)
    camera = config(size=size, focal=2.0 * size)
    r_CP_P = 7e6 * np.array(
        [math.cos(lat - 0.2) * math.cos(lon + 0.2), math.cos(lat - 0.2) * math.sin(lon + 0.2), math.sin(lat - 0.2)]
    )
    dcm_CP = np.array(plain(north_up)(lat - 0.2, lon + 0.2))
    r = -dcm_CP @ r_CP_P
    light = drawn(Seen(body, r, dcm_CP, -r / np.linalg.norm(r)), camera)
    light = np.maximum(light - 0.1, 0.0)
    mark = 1e6 * np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    x, y, z = dcm_CP @ (mark - r_CP_P)
    expected = np.array(project_point(lens_vector(camera), x, y, z))
    v, u = np.mgrid[:size, :size]
    found = np.array([(u * light).sum(), (v * light).sum()]) / light.sum()
    if abs(place_deg[0]) < 60.0:  # the camera is south-east of the spot, which therefore appears up and to the left
        assert np.all(found < (size - 1) / 2.0 - 0.02 * size)
    criterion("DISK-7", float(np.linalg.norm(found - expected)))


def test_cube_has_no_seam() -> None:
    """A smooth field on the sphere comes back in every direction, edges and corners of the faces among them."""
    from sim.camera.disk_camera.kernel import BODY_SIZE, texture_at

    rows = 512
    lat = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    lon = np.pi * ((np.arange(2 * rows) + 0.5) / rows - 1.0)[None, :]
    levels = cubes(1.0 + 0.3 * np.sin(lat) + 0.2 * np.cos(lat) * np.cos(lon - 0.5))
    assert [c.shape[1] - 2 for c in levels] == [256, 128, 64, 32, 16, 8]
    body = np.zeros(BODY_SIZE)  # a unit sphere around the camera: x, y, 1 times the depth is the direction
    body[[0, 4, 8, 18, 19, 20]] = 1.0
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(500, 3))
    directions[:100, 1] = directions[:100, 0] * (1.0 + rng.choice([-1e-9, 1e-9], 100))
    directions[100:110] = np.sign(directions[100:110])
    for x, y, z in (directions / np.linalg.norm(directions, axis=1)[:, None]).tolist():
        expected = 1.0 + 0.3 * z + 0.2 * (x * math.cos(0.5) + y * math.sin(0.5))
        assert plain(texture_at)(body, levels[0], x / z, y / z, z) == pytest.approx(expected, abs=2e-4)
        assert plain(texture_at)(body, levels[3], x / z, y / z, z) == pytest.approx(expected, abs=8e-3)


def test_invented_texture() -> None:
    raster = invented(3, 0.2, rows=128)
    weight = np.cos(np.pi * (0.5 - (np.arange(128) + 0.5) / 128))[:, None] * np.ones(256)
    mean = np.average(raster, weights=weight)
    assert mean == pytest.approx(1.0, abs=0.02)
    assert np.sqrt(np.average((raster - mean) ** 2, weights=weight)) == pytest.approx(0.2, rel=0.1)
    assert raster.min() >= 0.05 and not np.array_equal(raster, invented(4, 0.2, rows=128))
    assert np.abs(raster[:, 0] - raster[:, -1]).max() < 0.25  # no seam at 180 degrees


class Source(Module):
    """Feeds the camera with what the test says."""

    out_state = Out(SCStatesMsg)
    out_sun = Out(EphemerisMsg)
    out_orientation = Out(PlanetOrientationMsg)
    out_moon = Out(EphemerisMsg)

    def step(self, t_ns: int) -> None:
        """What the test wrote stays."""


def ephemeris(body_id: int, r: Any, v: Any = (0.0, 0.0, 0.0)) -> EphemerisMsg:
    return EphemerisMsg(body_id=body_id, mu=1.0, radius=1.0, r_PN_N=np.array(r, float), v_PN_N=np.array(v, float))


def state(r: Any, dcm_BN: F64 | None = None) -> SCStatesMsg:
    matrix = plain(mat3)(np.eye(3) if dcm_BN is None else dcm_BN)
    given = {"r_BN_N": np.array(r, float), "sigma_BN": np.array(plain(dcm_to_mrp)(matrix))}
    return SCStatesMsg(v_BN_N=np.zeros(3), omega_BN_B=np.zeros(3), omegaDot_BN_B=np.zeros(3), **given)


MARS = 3396.19e3


class Rig:
    """A camera with its sources; 20,000 km from Mars on the negative z axis, which looks at it with the identity."""

    def __init__(
        self, bodies: list[DiskBody] | None = None, stars: Any = None, moon: bool = False, **params: Any
    ) -> None:
        camera = params.pop("camera", None) or config(size=64, focal=100.0)
        self.source = Source("source")
        given = [disk_body("Mars")] if bodies is None else bodies
        self.camera = DiskCamera("eye", DiskCamera.Params(center_id=499, **params), camera, given, stars)
        self.source.out_state.connect(self.camera.in_state)
        self.source.out_sun.connect(self.camera.in_sun)
        if moon:
            self.source.out_moon.connect(self.camera.in_body_1)

    def picture(self, t_ns: int = 0, r: Any = (0.0, 0.0, -20e6), sun: Any = (0.0, 0.0, -2e11), **more: Any) -> Any:
        self.source.out_state.write(state(r, more.get("dcm_BN")), t_ns)
        self.source.out_sun.write(ephemeris(10, sun), t_ns)
        if "moon" in more:
            self.source.out_moon.write(more["moon"], t_ns)
        self.camera.step(t_ns)
        return self.camera.out_image.latest()


def test_picture_of_the_module() -> None:
    rig = Rig()
    message = rig.picture(t_ns=s(3))
    assert message.image.shape == (64, 64) and message.image.dtype == np.uint8
    assert (message.exposure_ns, message.label) == (s(3), "eye")
    assert rig.camera.out_camera.latest() is rig.camera.camera
    (exact,) = rig.camera.truths(points=90)
    assert exact.body_id == 499 and exact.center_px == pytest.approx([31.5, 31.5])
    polar = 100.0 * MARS * (1.0 - 0.00588600756) / 20e6  # seen from above the pole
    radius = 100.0 * MARS / 20e6 / math.sqrt(1.0 - (polar / 100.0) ** 2)
    assert exact.ellipse.semi_major_px == pytest.approx(radius, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(exact.limb_px - 31.5, axis=1), radius, rtol=6e-3)  # it is flattened
    found = np.sqrt(np.count_nonzero(message.image > 12) / math.pi)
    assert found == pytest.approx(radius, abs=0.5)
    assert message.image[31, 31] == pytest.approx(127, abs=1)  # albedo 0.5


def test_attitude_and_mounting_move_the_disk() -> None:
    """The camera turned to the right (about y, down) sees the planet to the left; a mounting does the same."""
    right = Rotation.from_euler("y", 0.1).as_matrix().T
    expected = 31.5 - 100.0 * math.tan(0.1)
    turned_body = Rig()
    turned_body.picture(dcm_BN=right)
    mounted = Rig(camera=config(size=64, focal=100.0, dcm_CB=right))
    mounted.picture()
    for rig in (turned_body, mounted):
        assert rig.camera.truths()[0].center_px == pytest.approx([expected, 31.5], abs=1e-9)
        image = rig.camera.out_image.latest()
        assert image is not None
        columns = np.flatnonzero(image.image.max(axis=0) > 12)
        assert columns.mean() == pytest.approx(expected, abs=0.7)


def test_nothing_before_the_first_state_and_sun() -> None:
    rig = Rig()
    rig.camera.step(0)
    rig.source.out_state.write(state([0.0, 0.0, -20e6]), 0)
    rig.camera.step(0)
    assert rig.camera.out_image.latest() is None and rig.camera.out_camera.latest() is None


def test_near_bodies_hide_far_ones() -> None:
    """A dark moon in front of the planet, at its edge and behind it; the order of the list does not matter."""
    moon = DiskBody(body_id=401, axes=np.full(3, 300e3), albedo=0.05)
    for bodies in ([disk_body("Mars"), moon], [moon, disk_body("Mars")]):
        rig = Rig(bodies=bodies, moon=True)
        before = rig.picture(moon=ephemeris(401, [0.0, 0.0, -10e6])).image
        assert before[31, 31] == pytest.approx(0.05 * 255, abs=1.0)
        assert [t.body_id for t in rig.camera.truths()] == [499, 401]
        edge = rig.picture(moon=ephemeris(401, [MARS / 2.0, 0.0, -10e6])).image
        assert edge[31, 31] > 120 and edge[31, 49] == pytest.approx(0.05 * 255, abs=1.0)
        behind = rig.picture(moon=ephemeris(401, [0.0, 0.0, 10e6])).image
        np.testing.assert_array_equal(behind, Rig().picture().image)
        assert [t.body_id for t in rig.camera.truths()] == [401, 499]


def test_moons_and_the_planet_are_moved_to_the_time_of_the_picture() -> None:
    moon = DiskBody(body_id=401, axes=np.full(3, 300e3))
    rig = Rig(bodies=[disk_body("Mars"), moon], moon=True)
    rig.source.out_moon.write(ephemeris(401, [0.0, 0.0, -10e6], [1e5, 0.0, 0.0]), 0)
    rig.picture(t_ns=s(10))
    assert rig.camera.truths()[1].center_px == pytest.approx([31.5 + 10.0, 31.5])
    long = DiskBody(body_id=499, axes=np.array([5e6, 3e6, 3e6]), rate=0.01)
    turning = Rig(bodies=[long])
    source = turning.source.out_orientation
    source.connect(turning.camera.in_orientation)
    for seconds, angle in [(0, 0.3), (20, 0.5)]:
        if not seconds:
            dcm = Rotation.from_euler("z", 0.3).as_matrix().T
            source.write(PlanetOrientationMsg(dcm_EN=dcm, omega_EN_N=np.array([0.0, 0.0, 0.01])), 0)
        turning.picture(t_ns=s(seconds))
        assert turning.camera.truths()[0].ellipse.angle == pytest.approx(angle, abs=1e-9)
    alone = Rig(bodies=[long])
    alone.picture(t_ns=s(20))
    assert alone.camera.truths()[0].ellipse.angle == pytest.approx(0.2, abs=1e-9)


def catalogue(*u_N: tuple[float, float, float], magnitude: float = 2.0) -> StarCatalogue:
    u = np.array(u_N, float)
    u /= np.linalg.norm(u, axis=1)[:, None]
    n = len(u)
    return StarCatalogue(np.arange(1, n + 1), u, np.linspace(magnitude, magnitude + 0.5 * (n - 1), n), np.zeros(n))


def test_stars(criterion: Criterion) -> None:
    """Place and light, before the detector; none behind the planet, at night or not, none fainter than the limit."""
    stars = catalogue((0.25, 0.1, 1.0), (-0.231, 0.252, 1.0), (0.02, 0.03, 1.0), (0.26, -0.27, 1.0), (0.0, 0.3, -1.0))
    rig = Rig(stars=stars, star_light=3.0, faintest=3.1, full_well=1e6, bits=16)
    image = rig.picture(sun=(0.0, 0.0, 2e11)).image.astype(float)  # the Sun behind the planet: nothing of it is lit
    light = 3.0 * 10.0 ** (-0.4 * stars.magnitude[:2]) * 255.0
    assert image.sum() == pytest.approx(light.sum(), abs=4.0)
    for k, (x, y) in enumerate([(0.25, 0.1), (-0.231, 0.252)]):
        u, v = 31.5 + 100.0 * x, 31.5 + 100.0 * y
        rows, columns = slice(int(v) - 1, int(v) + 3), slice(int(u) - 1, int(u) + 3)
        spot = image[rows, columns]
        j, i = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
        assert spot.sum() == pytest.approx(light[k], abs=2.5)
        criterion("DISK-8", math.hypot((spot * j).sum() / spot.sum() - u, (spot * i).sum() / spot.sum() - v))


def test_colours_have_their_own_lens() -> None:
    """The planet in a corner: the red image lies farther out than the blue one, by the scale of the lens."""
    fringed = config(size=64, focal=100.0, chromatic=np.array([1.02, 1.0, 0.98]))
    bodies = [disk_body("Mars", colour=(1.0, 0.6, 0.3))]
    rig = Rig(bodies=bodies, camera=fringed, colour=True)
    image = rig.picture(dcm_BN=Rotation.from_euler("y", -0.12).as_matrix().T).image.astype(float)
    assert image.shape == (64, 64, 3)
    np.testing.assert_allclose(image.max(axis=(0, 1)), 255 * 0.5 * np.array([1.0, 0.6, 0.3]), atol=1.5)
    u = np.arange(64)
    middle = [(u * image[..., k].sum(axis=0)).sum() / image[..., k].sum() - 31.5 for k in range(3)]
    assert middle[0] / middle[1] == pytest.approx(1.02, abs=2e-3)
    assert middle[2] / middle[1] == pytest.approx(0.98, abs=2e-3)


def test_same_seed_same_picture_whatever_the_threads(monkeypatch: Any) -> None:
    noisy: dict[str, Any] = {"shot_noise": True, "read_noise": 20.0, "psf_sigma_px": 0.7}
    first = Rig(**noisy)
    pictures = [first.picture().image for _ in range(2)]
    assert not np.array_equal(pictures[0], pictures[1])
    for workers in (1, 3):
        monkeypatch.setattr(scene, "WORKERS", workers)
        again = Rig(**noisy)
        assert all(np.array_equal(again.picture().image, p) for p in pictures)


def test_reset_repeats_the_noise() -> None:
    rig = Rig(shot_noise=True)
    rig.picture()
    simulation = Simulation([Task("t", s(1), [rig.source, rig.camera])], seed=4)
    seen: list[Any] = []
    for _ in range(2):
        rig.source.out_state.write(state([0.0, 0.0, -20e6]), 0)
        rig.source.out_sun.write(ephemeris(10, [0.0, 0.0, -2e11]), 0)
        simulation.run_until(s(1))
        message = rig.camera.out_image.latest()
        assert message is not None
        seen.append(message.image)
        simulation.reset()
    assert np.array_equal(seen[0], seen[1])


def test_bodies_behind_and_beside_the_camera() -> None:
    rig = Rig()
    assert not rig.picture(r=(0.0, 0.0, 20e6)).image.any()
    assert np.isnan(rig.camera.truths()[0].center_px).all() and np.isnan(rig.camera.truths()[0].ellipse.area_px)
    # so near that its edge is beside the camera: the picture is full of it
    assert rig.picture(r=(0.0, 0.0, -3.45e6)).image.min() > 60
    # beside: half of the sphere is in front of the image plane, but none of it is in the picture
    assert not rig.picture(r=(20e6, 0.0, 0.0)).image.any()


def test_limb_that_leaves_the_picture() -> None:
    """A piece of a large disk: brute force again, on pixels of the border."""
    camera = config(size=48, focal=60.0)
    seen = Seen(DiskBody(body_id=1, axes=np.full(3, 1e6)), np.array([0.9e6, 0.3e6, 1.1e6]), np.eye(3), sun_at(0.5, 0.4))
    found = drawn(seen, camera)
    v, u = np.mgrid[:48, :48]
    expected = brute(seen, camera, np.column_stack([u.ravel(), v.ravel()]).astype(float), 16).reshape(48, 48)
    assert 0.2 < (expected > 0.0).mean() < 0.95
    assert np.abs(found - expected).max() < 0.03


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Rig(bodies=[]), "center_id: body 499 is none of those given"),
        (lambda: Rig(bodies=[disk_body("Mars"), disk_body("Mars")]), "expected each body once"),
        (lambda: Rig(star_light=1.0), "no catalogue is given"),
        (lambda: Rig(moon=True).picture(moon=ephemeris(401, [1e7, 0.0, 0.0])), "in_body_1: body 401 is none of"),
        (lambda: Rig().picture(r=(0.0, 0.0, -3e6)), "expected a camera outside of every body"),
        (lambda: disk_body("Mars", law="phong"), "expected one of lambert, lommel_seeliger, minnaert"),
        (lambda: disk_body("Mars", albedo=-0.1), "DiskBody.albedo"),
        (lambda: disk_body("Mars", dcm_PN=np.diag([1.0, 1.0, -1.0])), "mirror"),
        (lambda: disk_body("Mars", texture=np.full((4, 8), np.nan)), "DiskBody.texture"),
        (lambda: DiskBody(body_id=1, axes=np.array([1.0, 0.0, 1.0])), "three lengths above 0"),
        (lambda: disk_body("Marz"), "did you mean Mars"),
    ],
)
def test_what_cannot_be_right_is_refused(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()
