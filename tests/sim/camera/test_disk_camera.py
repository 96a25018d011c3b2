"""The module: messages in, pictures out; what hides what, when, through which lens, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Simulation, Task, s
from fsw.math.stars import StarCatalogue
from messages.environment import PlanetOrientationMsg
from sim.camera.disk_camera import DiskBody, disk_body, scene
from tests.sim.camera.disk_rig import MARS, Rig, config, ephemeris, state

Criterion = Callable[[str, float], None]


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
