"""CenterOfBrightness on rendered spheres whose centre of light is integrated apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from messages.opnav import CameraImageMsg, OpNavBrightnessMsg
from modules.opnav.center_of_brightness import CenterOfBrightness
from modules.opnav.center_of_brightness.kernel import AT_EDGE, NOTHING, TOO_SMALL_IMAGE
from tests.modules.opnav.disk_truth import Criterion, camera, sources
from tests.modules.opnav.lit_sphere import lit_sphere, picture

CAMERA = camera(1000.0, 200)


def found(image: NDArray[np.uint8], **params: Any) -> OpNavBrightnessMsg:
    finder = CenterOfBrightness("finder", CenterOfBrightness.Params(body_id=499, **params))
    sources(finder)["in_image"].write(CameraImageMsg(image=image, exposure_ns=7), 0)
    finder.step(0)
    message = finder.out_brightness.latest()
    assert message is not None
    assert message.exposure_ns == 7
    return message


def body(radius: float, phase: float) -> tuple[Any, Any]:
    """A unit sphere at an odd place, and the Sun."""
    far = CAMERA.focal_px[0] / radius
    place = np.array([-0.0123, 0.0057, 1.0]) * far
    return place, np.array([np.sin(phase) * 0.8, np.sin(phase) * 0.6, -np.cos(phase)])


@pytest.mark.parametrize(("radius", "phase"), [(1.5, 30.0), (5.0, 0.0), (5.0, 90.0), (40.0, 60.0), (40.0, 90.0)])
def test_rendered_spheres(criterion: Criterion, radius: float, phase: float) -> None:
    place, sun = body(radius, np.radians(phase))
    image = picture(CAMERA, place, sun, 180.0, 12.0, 2.0, 1)
    if radius > 2.0:
        image[20:22, 30:32] = 255  # a star, brighter than the body, but with less light
        image[150:153, 150:153] = 90  # a smaller body
    center, area, _ = lit_sphere(CAMERA, place, sun, 1)
    message = found(image)
    assert message.valid
    criterion("LIGHT-1", float(np.max(np.abs(message.center_px - center))))
    if radius > 2.0:
        assert abs(message.area_px / area - 1.0) < 0.25  # the spec says so
    colour = found(np.repeat(image[:, :, None], 3, axis=2))
    np.testing.assert_allclose(colour.center_px, message.center_px, atol=1e-4)


def test_stated_noise(criterion: Criterion) -> None:
    place, sun = body(10.0, np.radians(40.0))
    clean, rng = picture(CAMERA, place, sun, 150.0, 20.0, 0.0, 0).astype(float), np.random.default_rng(4)
    noisy = [np.clip(np.round(clean + 4.0 * rng.normal(size=clean.shape)), 0, 255).astype(np.uint8) for _ in range(200)]
    seen = [found(image, sigma_floor=1e-3) for image in noisy]
    scatter = np.std([m.center_px for m in seen], axis=0)
    stated = np.sqrt(np.mean([np.diag(m.P_px) for m in seen], axis=0))
    criterion("LIGHT-2", float(np.max(np.abs(scatter / stated - 1.0))))


def test_no_light() -> None:
    rng = np.random.default_rng(3)
    noise = np.clip(rng.normal(40.0, 6.0, (120, 120)), 0, 255).astype(np.uint8)
    for image in (noise, np.zeros((120, 120), np.uint8), np.full((120, 120), 255, np.uint8)):
        message = found(image)
        assert (message.valid, message.status) == (False, NOTHING)
        assert np.all(np.isnan(message.center_px))
    cut = np.zeros((120, 120), np.uint8)
    cut[40:60, :15] = 200
    assert found(cut).status == AT_EDGE
    assert found(np.full((3, 3), 9, np.uint8)).status == TOO_SMALL_IMAGE


def test_parameters_and_no_image() -> None:
    with pytest.raises(ValueError, match=r"blur: expected an odd number, got 4"):
        CenterOfBrightness.Params(body_id=499, blur=4)
    finder = CenterOfBrightness("finder", CenterOfBrightness.Params(body_id=499))
    sources(finder)
    finder.step(0)
    assert finder.out_brightness.latest() is None
