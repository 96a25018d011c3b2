"""The detector against the photon transfer curve, the Poisson distribution, and counts of what it was told to do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from fsw.math.compiled import COMPILE
from fsw.streams import stream_words
from messages.base import U64
from sim.camera import detector, detector_kernel
from sim.camera.detector import DetectorParams, expose

SIZE = 512 if COMPILE else 48


def stream(name: str = "noise") -> U64:
    return stream_words(5, "camera", name)


def flat(level: float, size: int = SIZE, colour: bool = False) -> Any:
    return np.full((size, size, 3) if colour else (size, size), level, np.float32)


def test_without_effects_the_image_is_the_rounded_light() -> None:
    light = np.linspace(0.0, 1.3, 4096, dtype=np.float32).reshape(64, 64)
    exact = np.minimum(np.float64(light) * 255.0, 255.0)
    grey = expose(light, DetectorParams(), stream())
    assert grey.dtype == np.uint8 and grey.shape == light.shape
    assert np.abs(grey - exact).max() <= 0.5 + 1e-4
    doubled = expose(light, DetectorParams(exposure=0.5, gain=2.0), stream())
    assert np.array_equal(doubled, grey) or np.abs(doubled.astype(int) - grey).max() <= 1


def test_bits_and_tone_curve() -> None:
    light = np.linspace(0.0, 1.0, 4096, dtype=np.float32).reshape(64, 64)
    assert len(np.unique(expose(light, DetectorParams(bits=4), stream()))) == 16
    fine = expose(light, DetectorParams(bits=12), stream())
    assert np.abs(fine - 255.0 * np.float64(light)).max() <= 0.5 + 255.0 / 8190.0 + 1e-4
    bright = expose(light, DetectorParams(bits=16, gamma=2.2), stream())
    assert np.abs(bright - 255.0 * np.float64(light) ** (1 / 2.2)).max() <= 0.51 + 255.0 * (0.5 / 65535.0) ** (1 / 2.2)
    assert expose(flat(0.0), DetectorParams(black_level=0.1), stream()).min() == 26  # 25.5, rounded up


def test_photon_transfer_curve() -> None:
    """Variance against mean is a line: its slope is levels per electron, its start read noise (and quantisation)."""
    params = DetectorParams(full_well=4000.0, gain=4.0, shot_noise=True, read_noise=25.0, black_level=0.15)
    per_electron = 4.0 * 255.0 / 4000.0
    levels = np.array([0.0, 0.002, 0.01, 0.02, 0.04, 0.08, 0.12, 0.16])
    noise = stream()
    frames = [expose(flat(float(x)), params, noise).astype(float) for x in levels]
    mean = np.array([f.mean() for f in frames]) - 0.15 * 255.0
    variance = np.array([f.var(ddof=1) for f in frames])
    error = variance * np.sqrt(2.0 / SIZE**2)
    expected = per_electron**2 * (levels * 4000.0 + 25.0**2) + 1.0 / 12.0
    assert np.abs((variance - expected) / error).max() < 4.0
    assert np.abs((mean - levels * 4000.0 * per_electron) / np.sqrt(variance / SIZE**2)).max() < 4.0
    slope, start = np.polyfit(mean, variance, 1, w=1.0 / error)
    assert slope == pytest.approx(per_electron, rel=0.02 if COMPILE else 0.3)
    assert np.sqrt(start - 1.0 / 12.0) / per_electron == pytest.approx(25.0, rel=0.02 if COMPILE else 0.3)


@pytest.mark.parametrize("mean", [0.3, 4.0, 29.0])
def test_small_signals_follow_the_poisson_distribution(mean: float) -> None:
    """One level for an electron, so that the image counts them."""
    params = DetectorParams(full_well=255.0, shot_noise=True)
    counts = np.bincount(expose(flat(mean / 255.0), params, stream()).ravel(), minlength=256)
    expected = stats.poisson.pmf(np.arange(256), mean) * SIZE**2
    used = expected > 10.0
    found = [*counts[used], counts[~used].sum()]
    wanted = [*expected[used], SIZE**2 - expected[used].sum()]
    assert 1e-4 < stats.chisquare(found, wanted).pvalue < 1.0 - 1e-4


def test_poisson_draws_at_the_limit_join_the_gaussian() -> None:
    """Means just below and above the change of method differ by no more than chance says."""
    for mean in (29.9, 30.1):
        grey = expose(flat(mean / 255.0), DetectorParams(full_well=255.0, shot_noise=True), stream()).astype(float)
        assert grey.mean() == pytest.approx(mean, abs=4.0 * np.sqrt(mean) / SIZE)
        assert grey.var() == pytest.approx(mean + (1.0 / 12.0 if mean > 30.0 else 0.0), rel=4.0 * np.sqrt(2.0) / SIZE)


def test_normal_numbers() -> None:
    out = np.empty(400_000 if COMPILE else 4000, np.float32)
    with np.errstate(over="ignore"):
        detector_kernel.normals(stream(), out)
    draws = out.astype(np.float64)
    for power, expected, spread in [(1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)]:
        assert abs(np.mean(draws**power) - expected) < 4.0 * np.sqrt(spread / len(draws))
    assert stats.kstest(draws, "norm").pvalue > 1e-4
    for lag in (1, 2, 3, 4, 8):
        assert abs(np.mean(draws[lag:] * draws[:-lag])) < 4.5 / np.sqrt(len(draws))


@pytest.mark.parametrize("sigma", [0.3, 0.7, 1.5, 4.0])
def test_width_of_the_point_spread_function(sigma: float) -> None:
    """Second moments of a point: sigma^2 along both axes, none across, all light kept; and nearly a Gaussian."""
    light = flat(0.0, 65)
    light[32, 32] = 1.0
    point = detector.blurred(light, sigma).astype(np.float64)
    y, x = np.mgrid[-32:33, -32:33]
    assert point.sum() == pytest.approx(1.0, abs=1e-6)
    moments = [(x * x * point).sum(), (y * y * point).sum(), (x * y * point).sum()]
    np.testing.assert_allclose(moments, [sigma**2, sigma**2, 0.0], rtol=2e-4, atol=1e-6)
    if sigma > 1.0:
        gaussian = np.exp(-(x * x + y * y) / (2.0 * sigma**2)) / (2.0 * np.pi * sigma**2)
        # at its middle the discrete Gaussian is higher by 1 / (8 sigma^2) and more along each axis
        assert np.abs(point - gaussian).max() < 0.4 / sigma**2 * gaussian.max()


def test_blur_keeps_colours_apart_and_flat_light_flat() -> None:
    light = flat(0.0, 33, colour=True)
    light[16, 16, 1] = 1.0
    out = detector.blurred(light, 1.0)
    assert np.all(out[..., [0, 2]] == 0.0) and out[16, 15, 1] > 0.05
    np.testing.assert_allclose(detector.blurred(flat(0.5), 3.0), 0.5, rtol=1e-6)


def test_saturation() -> None:
    """The well is full before the converter is, at low gain; the converter before the well, at high gain."""
    noisy: dict[str, Any] = {"shot_noise": True, "read_noise": 50.0}
    assert np.all(expose(flat(3.0), DetectorParams(**noisy, gain=2.0), stream()) == 255)
    low = expose(flat(3.0), DetectorParams(shot_noise=True, gain=0.6), stream())
    assert np.all(low == 153)  # without shot noise
    at_half = expose(flat(1.0), DetectorParams(**noisy, gain=0.5), stream()).astype(float)
    assert at_half.max() <= 131 and at_half.mean() < 127.5


def test_dead_and_hot_pixels_are_counted_and_stay() -> None:
    params = DetectorParams(dead_pixels=0.002, hot_pixels=0.01, hot_signal=6000.0, bits=12)
    first, second = (expose(flat(0.3), params, stream(name)) for name in "ab")
    assert np.array_equal(first, second)
    assert np.count_nonzero(first == 0) == round(0.002 * SIZE**2)
    assert np.count_nonzero(first == 153) == round(0.01 * SIZE**2)
    other = expose(flat(0.3), DetectorParams(dead_pixels=0.002, pattern_seed=2), stream())
    assert not np.array_equal(other == 0, first == 0)
    long = expose(flat(0.0), DetectorParams(hot_pixels=0.01, hot_signal=4000.0, exposure=3.0), stream())
    assert long.max() == 153  # the dark signal grows with the exposure


def test_vignetting_and_response() -> None:
    grey = expose(flat(1.0), DetectorParams(vignetting=0.4), stream())
    assert grey[0, 0] == grey[-1, -1] == 153
    assert grey[SIZE // 2, SIZE // 2] == 255
    edge = expose(flat(1.0), DetectorParams(vignetting=0.4), stream())[SIZE // 2, 0]
    assert edge == pytest.approx(255 * 0.8, abs=1)
    uneven = expose(flat(0.5), DetectorParams(response_sigma=0.05, bits=16), stream()).astype(float)
    assert uneven.std() == pytest.approx(0.05 * 127.5, rel=0.02 if COMPILE else 0.2)


def test_cosmic_rays() -> None:
    """Their number on average, and that each leaves a track of neighbouring pixels."""
    params = DetectorParams(cosmic_rays=40.0, cosmic_signal=1e9)
    noise, found = stream(), []
    for _ in range(20):
        grey = expose(flat(0.0), params, noise)
        found.append(detector.CV.connectedComponents((grey > 0).astype(np.uint8))[0] - 1)
    if COMPILE:  # a small image has tracks that cross
        assert np.mean(found) == pytest.approx(40.0, abs=4.0 * np.sqrt(40.0 / 20.0))
    assert np.all(expose(flat(0.0), DetectorParams(), noise) == 0)


def test_colours_have_noise_of_their_own() -> None:
    grey = expose(flat(0.5, colour=True), DetectorParams(shot_noise=True, full_well=500.0), stream()).astype(float)
    assert grey.shape == (SIZE, SIZE, 3)
    correlation = np.corrcoef(grey.reshape(-1, 3).T)
    assert np.abs(correlation - np.eye(3)).max() < 4.5 / SIZE


@pytest.mark.parametrize("workers", [1, 2, 3, 7])
def test_the_picture_does_not_depend_on_the_number_of_threads(monkeypatch: Any, workers: int) -> None:
    params = DetectorParams(shot_noise=True, read_noise=10.0, psf_sigma_px=0.8, cosmic_rays=20.0)
    light = np.random.default_rng(1).uniform(0.0, 1.2, (100, 90)).astype(np.float32)
    before = light.copy()
    noise = stream()
    expected = [expose(light, params, noise) for _ in range(2)]
    assert not np.array_equal(expected[0], expected[1]) and np.array_equal(light, before)
    monkeypatch.setattr(detector, "WORKERS", workers)
    again = stream()
    assert all(np.array_equal(expose(light, params, again), e) for e in expected)


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.1])
def test_bad_light_is_refused(value: float) -> None:
    light = flat(0.5)
    light[3, 4] = value
    with pytest.raises(ValueError, match="radiance: expected finite light of at least 0, got 1 values"):
        expose(light, DetectorParams(), stream())
    with pytest.raises(ValueError, match=r"expected the shape \(H, W\) or \(H, W, 3\), got \(4, 4, 2\)"):
        expose(np.zeros((4, 4, 2), np.float32), DetectorParams(), stream())


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1), (33, 3), (2, 2, 3)])
def test_tiny_images(shape: tuple[int, ...]) -> None:
    params = DetectorParams(shot_noise=True, read_noise=5.0, psf_sigma_px=1.0, vignetting=0.2, cosmic_rays=1.0)
    assert expose(np.full(shape, 0.5, np.float32), params, stream()).shape == shape
