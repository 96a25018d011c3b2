"""Chips and peaks with known answers."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from modules.opnav.cells import cell_of, cells_hit, evenly
from modules.opnav.landmark_finder import correlate
from modules.opnav.landmark_finder.consensus import homography_consensus, sigma_of
from modules.opnav.landmark_finder.correlate import HALF, chip_centres, edges, match_chips, peak
from modules.opnav.landmark_finder.render import View

CV: Any = cv2


def texture(rows: int = 200, columns: int = 240) -> NDArray[np.uint8]:
    noise = CV.GaussianBlur(np.random.default_rng(5).normal(size=(rows, columns)), (0, 0), 2.0)
    return np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)


def view_of(image: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> View:
    nothing = np.zeros((2, 2))
    known = np.ones(image.shape, np.bool_) if mask is None else mask
    return View(image, known, nothing, nothing, nothing, 1.0)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -5.0), (2.25, 1.5), (-0.4, 4.6)])
def test_a_shift_is_found_to_a_fraction_of_a_pixel(shift: tuple[float, float]) -> None:
    image = texture()
    move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    photo = CV.warpAffine(image, move, image.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    centres = chip_centres(view_of(image), 20)
    found = match_chips(edges(image), edges(photo), centres, 8, 0.5, 0.04)
    assert len(found.seen) > 0.8 * len(centres)
    error = found.seen - found.rendered - shift
    assert np.abs(np.median(error, axis=0)).max() < 0.05
    assert np.abs(error).max() < 0.4


def test_the_number_of_threads_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    image = texture()
    photo, centres = edges(np.roll(image, (2, 3), (0, 1))), chip_centres(view_of(image), 8)
    answers: list[bytes] = []
    for workers in (1, 2, 5):
        monkeypatch.setattr(correlate, "WORKERS", workers)
        answers.append(match_chips(edges(image), photo, centres, 8, 0.5, 0.04).seen.tobytes())
    assert len(set(answers)) == 1
    assert len(answers[0]) > 1000


def test_gain_and_a_reversed_contrast_do_not_matter() -> None:
    image = texture()
    photo = (220 - 0.6 * image).astype(np.uint8)
    found = match_chips(edges(image), edges(photo), chip_centres(view_of(image), 20), 8, 0.5, 0.04)
    assert len(found.seen) > 30
    np.testing.assert_allclose(found.seen, found.rendered, atol=0.2)


def test_nothing_is_found_in_something_else() -> None:
    image, other = texture(), texture(240, 200).T.copy()
    assert len(match_chips(edges(image), edges(other), chip_centres(view_of(image), 20), 8, 0.6, 0.04).seen) == 0
    black = np.zeros_like(image)
    assert len(match_chips(edges(image), edges(black), chip_centres(view_of(image), 20), 8, 0.25, 0.04).seen) == 0


def test_chips_lie_on_the_map_and_have_contrast() -> None:
    image = texture()
    image[:, :120] = 90
    mask = np.ones(image.shape, np.bool_)
    mask[:60] = False
    centres = chip_centres(view_of(image, mask), 4)
    assert len(centres)
    assert centres[:, 0].min() >= 120 - HALF
    assert centres[:, 1].min() >= 60 + HALF
    assert (centres % 4 == 0).all()


def surface(*peaks: tuple[float, float, float]) -> NDArray[np.float32]:
    rows, columns = np.mgrid[0:21, 0:25]
    heights = [h - 0.01 * ((columns - x) ** 2 + (rows - y) ** 2) for x, y, h in peaks]
    return np.max(heights, axis=0).astype(np.float32)


def test_peaks() -> None:
    out = np.full(3, np.nan)
    peak(surface((9.3, 11.6, 0.9)), 0.5, 0.04, out)
    np.testing.assert_allclose(out, [9.3, 11.6, 0.9], atol=0.01)
    refused: list[NDArray[np.float32]] = [
        surface((9.0, 11.0, 0.4)),  # too low
        surface((5.0, 5.0, 0.9), (18.0, 15.0, 0.88)),  # not the only one
        surface((0.0, 5.0, 0.9)),  # at the edge
        np.zeros((9, 9), np.float32),
        np.full((9, 9), np.nan, np.float32),
    ]
    for other in refused:
        out[:] = np.nan
        peak(other, 0.5, 0.04, out)
        assert np.isnan(out).all()
    peak(surface((5.0, 5.0, 0.9), (18.0, 15.0, 0.8)), 0.5, 0.04, out)
    np.testing.assert_allclose(out[:2], [5.0, 5.0], atol=1e-3)


def test_consensus_finds_the_true_half() -> None:
    rng = np.random.default_rng(8)
    a = rng.uniform(0, 1000, (200, 2))
    h = np.array([[1.01, 0.02, 5.0], [-0.015, 0.99, -8.0], [1e-5, -2e-5, 1.0]])
    b = np.asarray(CV.perspectiveTransform(a[None], h))[0] + rng.normal(0, 0.5, a.shape)
    b[100:] = rng.uniform(0, 1000, (100, 2))
    agree = homography_consensus(a, b, 4.0)
    assert agree[:100].sum() >= 98
    assert agree[100:].sum() <= 3
    np.testing.assert_array_equal(agree, homography_consensus(a, b, 4.0))
    assert not homography_consensus(a[:7], b[:7], 4.0).any()
    assert not homography_consensus(np.full((20, 2), np.nan), b[:20], 4.0).any()


def test_cells_and_thinning() -> None:
    rng = np.random.default_rng(1)
    pixel, score = rng.uniform(0, [600, 400], (3000, 2)), rng.uniform(0, 1, 3000)
    assert cells_hit(pixel, (400, 600)) == 24
    assert cells_hit(pixel[:0], (400, 600)) == 0
    assert cell_of(np.array([[0.0, 0.0], [599.0, 399.0]]), (400, 600)).tolist() == [0, 23]
    crowd = np.vstack([pixel, rng.uniform(0, 20, (3000, 2))])
    kept = evenly(crowd, np.concatenate([score, score]), (400, 600), 500)
    assert len(kept) == len(set(kept.tolist())) == 500
    assert (kept < 3000).sum() > 480  # the crowd in one corner does not displace the rest
    assert evenly(pixel, score, (400, 600), 5000).tolist() == list(range(3000))


def test_sigma_falls_with_the_score() -> None:
    sigma = sigma_of(np.array([0.25, 0.6, 0.99]))
    assert (np.diff(sigma) < 0).all()
    assert (sigma > 0.1).all()
