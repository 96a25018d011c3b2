"""The detectors against what their papers promise: places, sizes, what turning, scaling and light leave unchanged."""

import math
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize_scalar
from scipy.special import erf

from modules.opnav.features import DETECTORS, detect, mutual_matches
from modules.opnav.features.surf import OCTAVES, surf
from modules.opnav.features.surf_kernel import box, haar, hessian

RNG = np.random.default_rng(3)


def integral(image: np.ndarray) -> Any:
    return cv2.integral(image, sdepth=cv2.CV_64F)


def ground(size: int = 400) -> np.ndarray:
    """A textured image: noise of several sizes, as the ground has."""
    noise = np.random.default_rng(5)
    layers = [s * gaussian_filter(noise.standard_normal((size, size)), s) for s in (1.5, 3.0, 6.0, 12.0)]
    total = np.sum(layers, axis=0)
    return np.clip(128.0 + 45.0 * total / total.std(), 0, 255).astype(np.uint8)


def blob(x: float, y: float, sigma: float, size: int = 96) -> np.ndarray:
    row, column = np.mgrid[:size, :size]
    return np.rint(30.0 + 200.0 * np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2.0 * sigma**2))).astype(np.uint8)


def test_box_and_haar_are_sums_of_pixels() -> None:
    image = RNG.integers(0, 256, (40, 50)).astype(np.uint8)
    total = integral(image)
    assert box(total, 3, 5, 7, 11) == image[3:10, 5:16].sum()
    assert box(total, -4, 45, 10, 20) == image[:6, 45:].sum()  # cut at the edge
    dx, dy = haar(total, 20, 22, 4)
    assert dx == image[16:24, 22:26].sum() - image[16:24, 18:22].sum(dtype=float)
    assert dy == image[20:24, 18:26].sum() - image[16:20, 18:26].sum(dtype=float)


@pytest.mark.parametrize("side", sorted({side for octave in OCTAVES for side in octave})[:5])
def test_hessian_by_boxes_is_the_filter_of_the_paper(side: int) -> None:
    """The masks of Bay et al. (2008), fig. 2: written out as arrays and correlated by OpenCV."""
    image = RNG.integers(0, 256, (130, 140)).astype(np.uint8)
    lobe, half = side // 3, (side - 1) // 2
    xx, xy = np.zeros((side, side)), np.zeros((side, side))
    middle = slice(half - lobe + 1, half + lobe)
    for k, weight in enumerate((1.0, -2.0, 1.0)):
        xx[middle, k * lobe : (k + 1) * lobe] = weight
    one, two = slice(half - lobe, half), slice(half + 1, half + 1 + lobe)
    xy[one, one] = xy[two, two] = 1.0
    xy[one, two] = xy[two, one] = -1.0
    responses = [cv2.filter2D(image / 255.0, -1, mask) / side**2 for mask in (xx, xx.T, xy)]
    expected = responses[0] * responses[1] - (0.9 * responses[2]) ** 2
    out = np.zeros(image.shape, np.float32)
    hessian(integral(image), side, 1, 0, len(image), out)
    inside = slice(half, -half)
    np.testing.assert_allclose(out[inside, inside], expected[inside, inside], rtol=1e-5, atol=1e-9)
    assert out[0].max() == 0.0


def best_side(sigma: float) -> float:
    """Side of the boxes that answer most to a Gaussian blob, from their integrals over it (error functions)."""

    def part(width: float) -> float:
        return erf(width / 2.0 / (math.sqrt(2.0) * sigma))

    def answer(side: float) -> float:
        lobe = side / 3.0
        return -(sigma**2) * part(2.0 * lobe - 1.0) * (3.0 * part(lobe) - part(side)) / side**2

    found: Any = minimize_scalar(answer, bounds=(sigma, 20.0 * sigma), method="bounded")
    return found.x


@pytest.mark.parametrize("sigma", [2.5, 4.0, 7.0, 11.0])
def test_surf_finds_a_blob_where_it_is_and_as_large_as_it_is(sigma: float) -> None:
    x, y = 47.3, 50.6
    place, size, _, _, _ = surf(blob(x, y, sigma), None, 1)
    assert np.hypot(*(place[0] - (x, y))) < 0.05
    assert size[0] == pytest.approx(1.2 / 9.0 * best_side(sigma), rel=0.1)


@pytest.mark.parametrize("name", DETECTORS)
@pytest.mark.parametrize(("turn_deg", "scale"), [(90.0, 1.0), (37.0, 1.0), (0.0, 0.7), (20.0, 1.3)])
def test_places_angles_and_sizes_follow_the_image(name: str, turn_deg: float, scale: float) -> None:
    image = ground()
    middle = (image.shape[1] - 1) / 2.0
    matrix = cv2.getRotationMatrix2D((middle, middle), turn_deg, scale)
    turned = cv2.warpAffine(image, matrix, image.shape[::-1], flags=cv2.INTER_CUBIC)
    a, b = detect(name, image, limit=800), detect(name, turned, limit=800)
    expected = a.place_px @ matrix[:, :2].T + matrix[:, 2]
    pairs = mutual_matches(a.words, b.words, 0.8)
    error = b.place_px[pairs[:, 1]] - expected[pairs[:, 0]]
    good = np.linalg.norm(error, axis=1) < 3.0
    assert len(pairs) > 60
    assert good.mean() > (0.9 if scale == 1.0 else 0.75)
    shift, noise = np.median(error[good], axis=0), 1.25 * error[good].std(axis=0) / math.sqrt(good.sum())
    assert np.all(np.abs(shift) < 4.0 * noise + 1e-6)  # no shift of the whole beyond chance
    turn = np.angle(np.exp(1j * (b.angle[pairs[good, 1]] - a.angle[pairs[good, 0]] + np.radians(turn_deg))))
    assert abs(np.median(turn)) < np.radians(2.0)
    ratio = b.size_px[pairs[good, 1]] / a.size_px[pairs[good, 0]]
    assert np.exp(np.log(ratio).mean()) == pytest.approx(scale, rel=0.12)


def test_surf_words_do_not_mind_brightness_and_contrast() -> None:
    image = ground()
    dim = np.rint(20.0 + 0.5 * image).astype(np.uint8)
    a, b = detect("surf", image, limit=300), detect("surf", dim, limit=300)
    pairs = mutual_matches(a.words, b.words, 0.8)
    same = np.linalg.norm(a.place_px[pairs[:, 0]] - b.place_px[pairs[:, 1]], axis=1) < 0.5
    assert len(pairs) > 200
    assert same.mean() > 0.98
    assert np.linalg.norm(a.words, axis=1) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("name", DETECTORS)
def test_same_image_same_features(name: str) -> None:
    for one, two in zip(detect(name, ground(200)), detect(name, ground(200)), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("name", DETECTORS)
def test_mask_limit_and_flat_images(name: str) -> None:
    image, mask = ground(200), np.zeros((200, 200), bool)
    mask[:, :100] = True
    found = detect(name, image, mask, limit=40)
    assert 0 < len(found.place_px) <= 40
    assert found.place_px[:, 0].max() < 101.0
    assert np.all(np.diff(found.response) <= 0.0)
    flat = detect(name, np.full((64, 64), 77, np.uint8))
    assert len(flat.place_px) == len(flat.words) == 0
    assert mutual_matches(flat.words, found.words, 0.8).shape == (0, 2)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("surd", np.zeros((64, 64), np.uint8)), "expected one of sift, surf, orb"),
        (("surf", np.zeros((64, 64), np.float64)), "image: expected uint8"),
        (("surf", np.zeros((64, 64, 4), np.uint8)), "image: expected uint8"),
        (("surf", np.zeros((20, 64), np.uint8)), "32 x 32 pixels or more, got 64 x 20"),
        (("surf", np.zeros((64, 64), np.uint8), np.zeros((63, 64))), "mask: expected the image's shape"),
        (("surf", np.zeros((64, 64), np.uint8), None, 0), "limit: expected 1 or more"),
    ],
)
def test_what_does_not_fit_is_refused(arguments: tuple, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        detect(*arguments)
