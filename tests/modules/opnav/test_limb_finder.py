"""LimbFinder: Basilisk's edges, and points on rendered limbs against where the limbs are."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fsw import Module, Out
from messages.environment import EphemerisMsg
from messages.opnav import CameraConfigMsg, CameraImageMsg, OpNavLimbMsg
from messages.states import NavAttMsg
from modules.opnav.disks import Light, find_disks
from modules.opnav.disks.sun import sun_at, view_of
from modules.opnav.limb_finder import LimbFinder
from tests.modules.opnav import disk_scenes as scenes

Measure = Callable[[str, float], None]
F64 = NDArray[np.float64]
NAMES = {
    "blurrSize": "blur_px",
    "cannyThreshLow": "canny_low",
    "cannyThreshHigh": "canny_high",
    "limbNumThresh": "least",
}


class Source(Module):
    """Writes what a test gives it."""

    out_image = Out(CameraImageMsg)


def look(image: NDArray[Any], **params: Any) -> OpNavLimbMsg:
    source, finder = Source("source"), LimbFinder("finder", LimbFinder.Params(**params))
    source.out_image.connect(finder.in_image)
    finder.step(0)
    assert finder.out_limb.latest() is None
    source.out_image.write(CameraImageMsg(image=image, exposure_ns=7), 0)
    finder.step(5)
    finder.step(6)
    assert finder.out_limb.seq == 1
    found = finder.out_limb.latest()
    assert found is not None and found.exposure_ns == 7
    assert np.isnan(found.limb_px[found.count :]).all() and np.isfinite(found.limb_px[: found.count]).all()
    assert found.valid == (found.count > 0) == (found.status == 0)
    return found


def test_basilisk(criterion: Measure) -> None:
    """LIMB-1: every stored case of limbFinding, to the bit."""
    vectors, rendered = scenes.vectors()
    wrong = 0
    for case in vectors["limb"]:
        settings = {NAMES[k]: v for k, v in case["settings"].items()}
        found = look(rendered[case["scene"]], basilisk=True, **settings)
        n, points = found.count, found.limb_px[: found.count]
        same = n == case["numLimbPoints"] and found.valid == bool(case["valid"])
        if n:
            same &= points[:5].tolist() == case["first"] and points[-3:].tolist() == case["last"]
            same &= points.sum(axis=0).tolist() == case["sum"]
        wrong += not same
    criterion("LIMB-1", wrong)


CASES = [
    (radius, phase, law, blur)
    for radius, phase, law, blur in (
        *((25.0, phase, law, 0.6) for phase in (0.0, 60.0, 120.0) for law in ("lambert", "lunar", "dark")),
        *((80.0, phase, law, 1.2) for phase in (0.0, 20.0, 60.0, 100.0) for law in ("lambert", "lunar", "dark")),
        *((250.0, phase, law, 0.8) for phase in (0.0, 90.0) for law in ("lunar", "dark")),
    )
]


def test_points_on_rendered_limbs(criterion: Measure) -> None:
    """LIMB-2 to LIMB-5: bias, scatter, honesty and the terminator."""
    rng, biases, scatters, honesty, dark = np.random.default_rng(3), [], [], [], 0
    for radius, phase, law, blur in CASES:
        side = int(2.2 * radius + 40)
        center = side / 2 + rng.uniform(-2, 2, 2)
        light = scenes.lit_disk((side, side), tuple(center), radius, phase, 30.0, law, over=5 if radius < 200 else 3)
        found = look(scenes.exposed(light, rng, blur=blur))
        assert found.valid, (radius, phase, law, blur)
        x, y = (found.limb_px[: found.count] - center).T
        error, sigma = np.hypot(x, y) - radius, found.sigma_px[: found.count]
        biases.append(abs(np.average(error, weights=sigma**-2)))
        scatters.append(np.sqrt(np.average((error - np.mean(error)) ** 2, weights=sigma**-2)))
        honesty.append(np.median(np.abs(error - np.average(error, weights=sigma**-2)) / sigma) / 0.6745)
        if phase >= 20.0 and law != "dark":  # which is lit head on whatever the phase
            dark += int((np.cos(np.arctan2(y, x) - math.radians(30.0)) < 0.0).sum())
    criterion("LIMB-2", float(np.percentile(biases, 90)))
    criterion("LIMB-3", float(np.median(scatters)))
    criterion("LIMB-4", float(np.median(honesty)))
    criterion("LIMB-5", dark)


def test_points_are_even_and_limited() -> None:
    """A limb of 3,100 px: at most 2000 points, or as many as are wanted, all round and without gaps."""
    rng = np.random.default_rng(1)
    light = scenes.lit_disk((1050, 1050), (524.2, 521.7), 500.0, 0.0, 0.0, "dark", over=2)
    image = scenes.exposed(light, rng)
    for most in (2000, 400):
        found = look(image, max_points=most)
        assert 0.9 * most < found.count <= most
        x, y = (found.limb_px[: found.count] - (524.2, 521.7)).T
        gaps: F64 = np.diff(np.sort(np.arctan2(y, x))).astype(float)
        assert gaps.max() < 6 * 2 * math.pi / most
        assert np.median(gaps) == pytest.approx(2 * math.pi / most, rel=0.1)


def test_what_stands_in_front_is_left_out() -> None:
    """Stars and tracks on the limb: the points keep to it, or are missing there."""
    rng = np.random.default_rng(11)
    light = scenes.lit_disk((400, 400), (200.0, 190.0), 120.0, 60.0, 0.0, "lunar")
    image = scenes.with_stars(scenes.exposed(light, rng), rng, 400)
    found = look(image)
    x, y = (found.limb_px[: found.count] - (200.0, 190.0)).T
    error = np.hypot(x, y) - 120.0
    assert found.count > 200
    assert np.percentile(np.abs(error), 95) < 0.4
    assert np.abs(error).max() < 1.5


def test_sigma_follows_the_noise() -> None:
    light = scenes.lit_disk((300, 300), (150.2, 148.9), 90.0, 0.0, 0.0, "lunar")
    sigma = []
    for noise in (1.0, 4.0):
        found = look(scenes.exposed(light, np.random.default_rng(2), noise=noise, shot=0.0))
        sigma.append(float(np.median(found.sigma_px[: found.count])))
    assert sigma[1] / sigma[0] == pytest.approx(4.0, rel=0.35)


def test_where_the_sun_stands() -> None:
    """Attitude and mounting turn it into the image; near the boresight it says nothing."""
    focal, center = np.array([900.0, 900.0]), np.array([255.5, 255.5])
    turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    camera = CameraConfigMsg(width_px=512, height_px=512, focal_px=focal, center_px=center, dcm_CB=turned)
    # MRP tan(90 deg / 4) about z: x_B is y_N
    attitude = NavAttMsg(sigma_BN=np.array([0.0, 0.0, math.tan(math.pi / 8)]), omega_BN_B=np.zeros(3))

    def sun(r_N: list[float]) -> EphemerisMsg:
        return EphemerisMsg(body_id=10, mu=1.3e20, radius=7e8, r_PN_N=1.5e11 * np.array(r_N), v_PN_N=np.zeros(3))

    def seen(r_N: list[float], x: float, y: float) -> Light:
        view = view_of(camera, attitude, sun(r_N))
        assert view is not None
        return sun_at(view, x, y)

    middle = seen([0.6, 0.0, -0.8], 255.5, 255.5)  # x_N is -y_B, which is -x_C
    assert middle.contrast > 0.5
    assert math.cos(middle.azimuth) == pytest.approx(-1.0, abs=1e-12)
    assert seen([0.01, 0.0, -1.0], 255.5, 255.5).contrast == 0.0
    # The Sun behind the camera: a body to the right of the axis is lit from the right
    aside = seen([0.0, 0.0, -1.0], 455.5, 255.5)
    assert aside.contrast > 0.5 and math.cos(aside.azimuth) == pytest.approx(1.0, abs=1e-12)
    # and one in the direction opposite to the Sun is full wherever it is
    off = 200.0 / 900.0
    assert seen([off, 0.0, -1.0], 455.5, 255.5).contrast == 0.0
    assert view_of(camera, None, sun([1.0, 0.0, 0.0])) is None


def test_nothing_and_bad_input() -> None:
    assert look(np.zeros((100, 100), np.uint8)).status == 1
    assert look(np.zeros((10, 100), np.uint8)).status == 3
    noisy = scenes.with_stars(np.full((200, 200), 5, np.uint8), np.random.default_rng(1), 50)
    assert look(noisy).status in (1, 2)
    assert not look(noisy, basilisk=True, least=10**6).valid
    with pytest.raises(ValueError, match="odd number, got 4"):
        LimbFinder("finder", LimbFinder.Params(blur_px=4))


def test_blur_is_found() -> None:
    """The Gaussian of the scene and the pixel's own 0.29 px."""
    rng = np.random.default_rng(4)
    for blur in (0.8, 1.5):
        light = scenes.lit_disk((300, 300), (150.0, 150.0), 100.0, 0.0, 0.0, "lunar")
        _, (disk,) = find_disks(scenes.exposed(light, rng, blur=blur))
        assert disk.limb.blur == pytest.approx(math.hypot(blur, 0.29), rel=0.05)
